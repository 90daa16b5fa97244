"""``radron-deploy bundle``, ``push``, ``logs`` and ``status``: updates of a fleet's onboard computers."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from radron.deploy.remote import Host, RemoteError
from radron.deploy.update.errors import UpdateError

if TYPE_CHECKING:
    from radron.deploy.update.hosts import Tell
    from radron.deploy.update.logs import Fetched
    from radron.deploy.update.status import Answer

bundle_app = typer.Typer(no_args_is_help=True, help="Signed bundles, by which onboard computers are updated (docs/nuc.md).")
HostsArgument = Annotated[
    list[str] | None, typer.Argument(metavar="[HOST]...", help="[USER@]ADDRESS[:PORT], or ids of the fleet's drones.")
]
FleetOption = Annotated[Path | None, typer.Option(metavar="FLEET.toml", help="The fleet file: without HOSTs, all its drones.")]
SshOption = Annotated[
    list[str] | None, typer.Option("--ssh", metavar="NAME=VALUE", help="An option for ssh, such as IdentityFile=key; repeatable.")
]
T = TypeVar("T")


@bundle_app.command("build")
def build_bundle(
    signer: Annotated[Path, typer.Option(metavar="FOLDER", help="A certificate with the role release, and its key.")],
    image: Annotated[Path, typer.Option(metavar="FILE", help="Image of the new system.")] = Path("nuc.img"),
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The bundle to make.", show_default="radron-VERSION.raucb")
    ] = None,
) -> None:
    """Make a signed bundle of an image's system; drones of the signer's authority install it."""
    from radron.deploy.image.build import read_manifest  # noqa: PLC0415
    from radron.deploy.update.bundle import build_bundle as build  # noqa: PLC0415
    from radron.deploy.update.bundle import manifest_file  # noqa: PLC0415

    made = out if out is not None else Path(f"radron-{read_manifest(image).version}.raucb")
    manifest = build(image, signer, made, print)
    size = f"{manifest.size / 1e6:.0f} MB"
    print(f"{made}: radron {manifest.release}, {size}; keep {manifest_file(made).name} beside it")


def push(
    hosts: HostsArgument = None,
    bundle: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The bundle; with its .json beside it.", show_default="none")
    ] = None,
    fleet: FleetOption = None,
    rollback: Annotated[bool, typer.Option("--rollback", help="Go back to the other slot's release instead.")] = False,
    older: Annotated[bool, typer.Option("--older", help="Also a release that is older than what runs there.")] = False,
    ssh: SshOption = None,
) -> None:
    """Update onboard computers, all at once, and wait until each has decided: it runs the new release, or has fallen back.

    Refused while a vehicle is armed or a flight is under way. Exit code 0: all run it; 1: not all; 2: nothing was sent.
    """
    from radron.deploy.update.bundle import read_bundle_manifest  # noqa: PLC0415
    from radron.deploy.update.hosts import find_hosts  # noqa: PLC0415
    from radron.deploy.update.push import Push  # noqa: PLC0415
    from radron.deploy.update.push import push as push_to  # noqa: PLC0415

    if rollback == (bundle is not None):
        raise UpdateError("--bundle FILE or --rollback: give one of them")
    manifest = read_bundle_manifest(bundle) if bundle is not None else None
    found, _ = find_hosts(hosts or [], fleet, ssh or [])
    with _interruptible("what has begun on board goes on by itself"), _progress() as tell:
        done = asyncio.run(push_to(found, Push(bundle, manifest, older, tell)))
    failed = False
    for host, result in zip(found, done, strict=True):
        failed |= isinstance(result, RemoteError) or result.kind != "good"
        if isinstance(result, RemoteError):
            print(f"radron-deploy: {result}", file=sys.stderr)
        else:
            print(f"{host.name}: {result.text}")
    if failed:
        raise typer.Exit(1)


def logs(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Target folder; it gets a folder for each computer.")],
    hosts: HostsArgument = None,
    fleet: FleetOption = None,
    ssh: SshOption = None,
) -> None:
    """Fetch the flight records of onboard computers that are not there yet; each is verified by its digest.

    An interrupted copy is completed by the next one. Exit code 1: not all computers have answered.
    """
    from radron.deploy.update.hosts import find_hosts  # noqa: PLC0415
    from radron.deploy.update.logs import fetch_logs  # noqa: PLC0415

    found, _ = find_hosts(hosts or [], fleet, ssh or [])

    async def one(host: Host) -> Fetched:
        return await fetch_logs(host, out, tell)

    with _interruptible("what is copied stays"), _progress() as tell:
        done = _at_all(found, one)
    for host, result in done:
        if not isinstance(result, RemoteError):
            print(f"{host.name}: {result.new} of {result.records} records were new; {result.folder}")
    _tell_failures(done)


def status(hosts: HostsArgument = None, fleet: FleetOption = None, ssh: SshOption = None) -> None:
    """Show the onboard computers in one table: release, slot, last update, agent, autopilot, disk, clock, certificate.

    What differs within the fleet, or needs a look, is marked with "!". Exit code 1: not all computers have answered.
    """
    from rich.console import Console  # noqa: PLC0415

    from radron.deploy.update.hosts import ask, find_hosts  # noqa: PLC0415
    from radron.deploy.update.status import Answer, rows, table  # noqa: PLC0415

    found, known = find_hosts(hosts or [], fleet, ssh or [])

    async def one(host: Host) -> Answer:
        asked_ns = time.time_ns()
        computer = await ask(host)
        return Answer(computer, asked_ns, time.time_ns())

    done = _at_all(found, one)
    answers = [(host, result) for host, result in done if not isinstance(result, RemoteError)]
    if answers:
        Console(width=None if sys.stdout.isatty() else 250).print(table(rows(answers, known)))
    _tell_failures(done)


def _at_all(hosts: Sequence[Host], work: Callable[[Host], Awaitable[T]]) -> list[tuple[Host, T | RemoteError]]:
    from radron.deploy.remote import at_all  # noqa: PLC0415

    return list(zip(hosts, asyncio.run(at_all(hosts, work)), strict=True))


def _tell_failures(done: Sequence[tuple[Host, object]]) -> None:
    failures = [result for _, result in done if isinstance(result, RemoteError)]
    for failure in failures:
        print(f"radron-deploy: {failure}", file=sys.stderr)
    if failures:
        raise typer.Exit(1)


@contextmanager
def _interruptible(what: str) -> Iterator[None]:
    """End an interruption by Ctrl-C in one line."""
    try:
        yield
    except KeyboardInterrupt:
        raise UpdateError(f"interrupted: {what}; run this again to complete the copies") from None


@contextmanager
def _progress() -> Iterator[Tell]:
    """Yield a progress report: a bar for each computer on a terminal, else a line for each step and each tenth of a copy."""
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import BarColumn, DownloadColumn, Progress, TaskID, TextColumn, TransferSpeedColumn  # noqa: PLC0415

    terminal = Console(stderr=True)
    if not terminal.is_terminal:
        told: dict[Host, str] = {}

        def tell_line(host: Host, what: str, done: int, total: int) -> None:
            text = f"{host.name}: {what}" + (f", {10 * done // total * 10} %" if total else "")
            if told.get(host) != text:
                told[host] = text
                print(text, file=sys.stderr, flush=True)

        yield tell_line
        return
    columns = TextColumn("{task.fields[name]}"), BarColumn(bar_width=20), DownloadColumn(), TransferSpeedColumn()
    with Progress(*columns, TextColumn("{task.description}"), console=terminal) as bar:
        tasks: dict[Host, TaskID] = {}

        def tell_bar(host: Host, what: str, done: int, total: int) -> None:
            if host not in tasks:
                tasks[host] = bar.add_task(what, total=None, name=host.name)
            if total:
                bar.update(tasks[host], description=what, completed=done, total=total)
            else:
                bar.update(tasks[host], description=what)

        yield tell_bar
