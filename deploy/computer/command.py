"""``radron-deploy install``, ``packages``, ``uninstall`` and ``doctor``: one onboard computer over SSH."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from radron.deploy.image.command import CACHE, CacheOption
from radron.deploy.image.wheels import IMAGE, Platform
from radron.deploy.pki.command import KeyOption, PkiOption, drone_issuer
from radron.deploy.update.command import SshOption

if TYPE_CHECKING:
    from radron.deploy.remote import Progress

HostArgument = Annotated[str, typer.Argument(metavar="HOST", help="[USER@]ADDRESS[:PORT], as for ssh; by default root.")]


def install(
    host: HostArgument,
    fleet: Annotated[Path, typer.Option(metavar="FLEET.toml", help="The fleet file.")],
    drone: Annotated[str, typer.Option(metavar="ID", help="Id of the drone.")],
    pki: PkiOption = Path("pki"),
    key: KeyOption = None,
    online: Annotated[
        bool, typer.Option("--online", help="The computer fetches the packages itself, instead of getting them from here.")
    ] = False,
    source: Annotated[Path, typer.Option(metavar="FOLDER", help="The checkout to install from.")] = Path(),
    ssh: SshOption = None,
    cache: CacheOption = CACHE,
) -> None:
    """Install the agent on an existing Debian or Ubuntu computer, as this drone, with its service; or bring it up to date."""
    from radron.deploy.computer.install import Order  # noqa: PLC0415
    from radron.deploy.computer.install import install as install_there  # noqa: PLC0415
    from radron.deploy.fleet.loading import load_fleet  # noqa: PLC0415
    from radron.deploy.pki.authority import PkiFolder  # noqa: PLC0415
    from radron.deploy.remote import Host  # noqa: PLC0415

    loaded, authority = load_fleet(fleet), PkiFolder(pki, key)
    authority.authority()  # checked before the first copy
    order = Order(loaded, loaded.drone(drone), authority, source.resolve(), cache.resolve(), online)
    issue, place = drone_issuer(authority, drone, loaded.config.certificate_days), Host.parse(host, ssh or ())
    asyncio.run(install_there(place, order, issue, time.time_ns(), _say, _quarters()))
    print(f"{host}: is {drone} now; examine it with `radron-deploy doctor {host}`")


def packages(
    machine: Annotated[Literal["amd64", "arm64"], typer.Option(help="Its processor.")] = "arm64",
    python: Annotated[str, typer.Option(metavar="VERSION", help="Its Python: 3.11 of Debian 12, 3.12 of Ubuntu 24.04.")] = "3.11",
    glibc: Annotated[int, typer.Option(metavar="MINOR", help="Its C library: 36 of 2.36, Debian 12.")] = IMAGE.glibc,
    source: Annotated[Path, typer.Option(metavar="FOLDER", help="The checkout.")] = Path(),
    cache: CacheOption = CACHE,
) -> None:
    """Collect the packages that `install` takes to a kind of computer, without one: is there a wheel of each for it?"""
    from radron.deploy.computer.host import MACHINES  # noqa: PLC0415
    from radron.deploy.computer.install import collect  # noqa: PLC0415

    name = next(name for name, debian in MACHINES.items() if debian == machine)
    found = collect(source.resolve(), cache.resolve(), Platform(python, name, glibc))
    size = sum(wheel.stat().st_size for wheel in found) / 1e6
    print(f"Python {python} on {machine}: all {len(found)} packages, {size:.0f} MB")


def uninstall(
    host: HostArgument,
    purge: Annotated[bool, typer.Option("--purge", help="Also flight records, state and measurements.")] = False,
    ssh: SshOption = None,
) -> None:
    """Remove from a computer what `install` has put there, keys included; records and state stay."""
    from radron.deploy.computer.install import uninstall as uninstall_there  # noqa: PLC0415
    from radron.deploy.remote import Host  # noqa: PLC0415

    print(f"{host}: {asyncio.run(uninstall_there(Host.parse(host, ssh or ()), purge))}")


def doctor(
    host: Annotated[str, typer.Argument(metavar="HOST", help="[USER@]ADDRESS[:PORT], as for ssh; by default root.")] = "",
    local: Annotated[bool, typer.Option("--local", help="This computer itself.")] = False,
    config: Annotated[
        Path | None, typer.Option(metavar="DRONE.toml", help="With --local: the drone file, instead of the installed agent's.")
    ] = None,
    write: Annotated[bool, typer.Option("--write", help="Set the autopilot's parameters that are wrong.")] = False,
    wait: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.0, max=600.0, help="How long to wait until all is ready.")
    ] = 30.0,
    ssh: SshOption = None,
) -> None:
    """Examine a drone on the bench: computer, clock, camera, autopilot, swarm, on one page. Its agent is stopped meanwhile.

    Exit code 0: all green; 1: something failed; 3: nothing failed, but not all is green; 2: it could not be examined.
    """
    from rich.console import Console  # noqa: PLC0415

    from radron.agent.doctor.report import page  # noqa: PLC0415
    from radron.deploy.computer.doctor import examine, examine_here, options_of  # noqa: PLC0415
    from radron.deploy.remote import Host, RemoteError  # noqa: PLC0415

    if bool(host) == local:
        raise RemoteError("HOST or --local: give one of them")
    if config is not None and not local:
        raise RemoteError("--config: is for --local; a drone elsewhere has its own")
    options = options_of(write, wait)
    if local:
        report = asyncio.run(examine_here(config, options, _say))
    else:
        report = asyncio.run(examine(Host.parse(host, ssh or ()), options, _say))
    Console().print(page(report, host or "this computer"))
    if report.code:
        raise typer.Exit(report.code)


def _say(text: str) -> None:
    typer.echo(text, err=True)


def _quarters() -> Progress:
    """Return a progress report of a copy in quarters, suitable for a log, too."""
    told = -1

    def progress(done: int, total: int) -> None:
        nonlocal told
        quarter = 4 * done // total if total else 4
        if quarter != told:
            told = quarter
            _say(f"sent {done / 1e6:.0f} of {total / 1e6:.0f} MB")

    return progress


COMMANDS: tuple[Callable[..., None], ...] = (install, packages, uninstall, doctor)
