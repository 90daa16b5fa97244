"""Subcommands of ``radron-agent`` on board and for operators. Slow imports are left to the command that needs them."""

from __future__ import annotations

import asyncio
import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radron.protocol.messages import Action

if TYPE_CHECKING:
    from rich.table import Table

    from radron.agent.vehicle.interface import Finding

ConfigOption = Annotated[Path, typer.Option(metavar="DRONE.toml", help="The drone file; RADRON_ variables override it.")]
ConnectOption = Annotated[
    list[str], typer.Option(metavar="tls/HOST:PORT", help="A drone's endpoint; may be given several times.")
]
IdentityOption = Annotated[
    Path | None, typer.Option(envvar="RADRON_IDENTITY", metavar="FOLDER", help="The operator's certificate and key.")
]
InsecureOption = Annotated[bool, typer.Option("--insecure", help="The swarm's links are not encrypted (tcp/HOST:PORT).")]
_COLOURS = {"ok": "green", "not yet": "yellow", "failed": "red"}


def run(
    config: ConfigOption,
    verbose: Annotated[bool, typer.Option("--verbose", help="Also log the counters every 10 s.")] = False,
    wait: Annotated[
        bool, typer.Option("--wait", help="Wait for what is missing before a flight, and say for what, instead of ending.")
    ] = False,
) -> None:
    """Fly this drone's part of the mission, until SIGINT or SIGTERM.

    Nothing moves without an operator's start command. This process becomes the watchdog, and the agent is its child. Exit codes:
    0 stopped on request; 2 an error that the user can fix, in one line; 70 the agent hung or crashed: the autopilot
    took over.
    """
    agent = [
        sys.executable,
        "-m",
        "radron.agent",
        str(config),
        *(["--verbose"] if verbose else []),
        *(["--wait"] if wait else []),
    ]
    sys.stderr.flush()
    os.execv(
        sys.executable, [sys.executable, "-m", "radron.agent.shell.supervisor", *agent]
    )  # without this command's imports: 12 MB


def preflight(
    config: ConfigOption,
    wait: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.0, max=600.0, help="How long to wait until all is ready.")
    ] = 10.0,
) -> None:
    """Connect everything, command nothing, and report what is ready. Exit code 0 if everything is ready, else 1."""
    from rich.console import Console  # noqa: PLC0415
    from rich.live import Live  # noqa: PLC0415

    from radron.agent.preflight.check import Preflight  # noqa: PLC0415
    from radron.agent.shell.overrides import load_drone  # noqa: PLC0415

    drone, mission = load_drone(config, os.environ)
    check = Preflight(drone, mission)
    terminal = Console()
    if terminal.is_terminal:
        with Live(console=terminal, auto_refresh=False) as live:
            ready = asyncio.run(check.run(wait, lambda found: live.update(_table(drone.id, found), refresh=True)))
    else:
        ready = asyncio.run(check.run(wait, lambda found: None))
        terminal.print(_table(drone.id, check.findings))
    if not ready:
        raise typer.Exit(1)


def doctor(
    config: ConfigOption,
    json: Annotated[
        bool, typer.Option("--json", help="As JSON, for `radron-deploy doctor`; progress goes to standard error.")
    ] = False,
    write: Annotated[
        bool, typer.Option("--write", help="Set the autopilot's parameters that are wrong, while disarmed.")
    ] = False,
    wait: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.0, max=600.0, help="How long to wait until all is ready.")
    ] = 30.0,
    smart: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Output of `smartctl --json` about the disk.", show_default="none")
    ] = None,
) -> None:
    """Examine this drone on the bench: the preflight check, and camera, parameters, computer, and links to the other drones.

    Exit code 0: all green; 1: something failed; 3: nothing failed, but not all is green; 2: it could not be examined.
    """
    import msgspec  # noqa: PLC0415

    from radron.agent.doctor.examination import examine  # noqa: PLC0415
    from radron.agent.doctor.report import page  # noqa: PLC0415
    from radron.agent.shell.overrides import load_drone  # noqa: PLC0415

    drone, mission = load_drone(config, os.environ)
    report = asyncio.run(examine(drone, mission, wait, smart, write, lambda text: print(text, file=sys.stderr, flush=True)))
    if json:
        print(msgspec.json.encode(report).decode())
    else:
        from rich.console import Console  # noqa: PLC0415

        Console().print(page(report, "this computer"))
    if report.code:
        raise typer.Exit(report.code)


def command(
    action: Annotated[Action, typer.Argument(help="What the swarm is to do.")],
    swarm: Annotated[str, typer.Option(metavar="NAME", help="The swarm's name, as in its mission file.")],
    connect: ConnectOption,
    identity: IdentityOption = None,
    insecure: InsecureOption = False,
    drones: Annotated[str, typer.Option(metavar="d1,d2", help="Only these drones.", show_default="all")] = "",
    without: Annotated[
        str, typer.Option(metavar="d3", help="All but these, which need not be there; their absence is no obstacle to a start.")
    ] = "",
    anyway: Annotated[bool, typer.Option("--anyway", help="Start those that can, although others report problems.")] = False,
    mission: Annotated[
        str,
        typer.Option(
            metavar="ID", help="The mission that is meant: refuse where drones have another one.", show_default="theirs"
        ),
    ] = "",
) -> None:
    """Command a swarm, and wait until it has obeyed. Exit code 2 if a drone refuses, with its reasons."""
    from radron.agent.operator import groundcontrol  # noqa: PLC0415
    from radron.agent.operator.groundcontrol import CommandError  # noqa: PLC0415

    names, left = (tuple(name for name in listed.split(",") if name) for listed in (drones, without))
    if names and left:
        raise CommandError("--drones and --without exclude each other: give one of them")
    _check_links(identity, insecure)
    order = groundcontrol.Order(action, swarm, tuple(connect), names, left, anyway, identity, mission)
    asyncio.run(groundcontrol.command(order, print))


def upload(
    mission: Annotated[Path, typer.Argument(metavar="MISSION.toml", help="The mission file.")],
    connect: ConnectOption,
    identity: IdentityOption = None,
    insecure: InsecureOption = False,
    without: Annotated[
        str, typer.Option(metavar="d3", help="Drones of the mission that do not get it.", show_default="none")
    ] = "",
) -> None:
    """Give the drones of a mission this mission, while all are on the ground and disarmed.

    Each drone checks it, keeps it, and begins anew with it, which takes some seconds; one that refuses says why, and keeps the
    mission that it has. Exit code 0: all have it; 1: not all; 2: nothing was sent.
    """
    from radron.agent.config.loading import load_mission  # noqa: PLC0415
    from radron.agent.operator.missionupload import UploadOrder  # noqa: PLC0415
    from radron.agent.operator.missionupload import upload as upload_mission  # noqa: PLC0415

    _check_links(identity, insecure)
    left = tuple(name for name in without.split(",") if name)
    order = UploadOrder(load_mission(mission), tuple(connect), left, identity)
    results = asyncio.run(upload_mission(order, print))
    without_it = [name for name, reason in results.items() if reason]
    if without_it:
        have = [name for name, reason in results.items() if not reason]
        print(
            f"upload: {', '.join(without_it)} kept another mission"
            + (f", {', '.join(have)} took it: no start until all have the same" if have else "")
        )
        raise typer.Exit(1)


def _check_links(identity: Path | None, insecure: bool) -> None:
    from radron.agent.operator.groundcontrol import CommandError  # noqa: PLC0415

    if insecure == (identity is not None):
        make = "run `radron-deploy pki issue NAME --role operator`, and give the folder that it makes"
        raise CommandError(f"--identity or --insecure: give one of them; for a certificate, {make}")


Swarm = Annotated[str, typer.Option(metavar="NAME", help="The swarm's name, as in its mission file.")]
Connect = Annotated[list[str], typer.Option(metavar="tls/HOST:PORT", help="A drone's endpoint; may be given several times.")]
AnyIdentity = Annotated[
    Path | None,
    typer.Option("--identity", envvar="RADRON_IDENTITY", metavar="FOLDER", help="Any certificate of the swarm and its key."),
]
Insecure = Annotated[bool, typer.Option("--insecure", help="The swarm's links are not encrypted (tcp/HOST:PORT).")]
MissionFile = Annotated[
    Path | None, typer.Option(metavar="MISSION.toml", help="Adds latitude and longitude, and the drones that are not heard.")
]


def status(
    swarm: Swarm, connect: Connect, identity: AnyIdentity = None, insecure: Insecure = False, mission: MissionFile = None
) -> None:
    """Print a line for each drone of a swarm, and the source that they tell. Exit code 2 if none is heard."""
    from rich.console import Console  # noqa: PLC0415

    from radron.agent.operator import overview  # noqa: PLC0415

    place = overview.place_of(swarm, connect, identity, insecure, mission)
    Console().print(overview.table(asyncio.run(overview.show(place, None))))


def watch(
    swarm: Swarm, connect: Connect, identity: AnyIdentity = None, insecure: Insecure = False, mission: MissionFile = None
) -> None:
    """As ``status``, again and again, until SIGINT."""
    from contextlib import suppress  # noqa: PLC0415

    from rich.console import Console  # noqa: PLC0415
    from rich.live import Live  # noqa: PLC0415

    from radron.agent.operator import overview  # noqa: PLC0415

    place, terminal = overview.place_of(swarm, connect, identity, insecure, mission), Console()
    with suppress(KeyboardInterrupt):
        if not terminal.is_terminal:
            asyncio.run(overview.show(place, lambda seen: terminal.print(overview.table(seen))))
            return
        with Live(console=terminal, auto_refresh=False) as live:
            asyncio.run(overview.show(place, lambda seen: live.update(overview.table(seen), refresh=True)))


def revoke(
    member: Annotated[str, typer.Argument(help="A drone's id, or an operator's name.")],
    swarm: Annotated[str, typer.Option(metavar="NAME", help="The swarm's name, as in its mission file.")],
    connect: Annotated[list[str], typer.Option(metavar="tls/HOST:PORT", help="A drone's endpoint; may be given several times.")],
    identity: Annotated[
        Path, typer.Option(envvar="RADRON_IDENTITY", metavar="FOLDER", help="Certificate of an operator who may revoke.")
    ],
    nothing: Annotated[bool, typer.Option("--nothing", help="None of the drone's log entries count.")] = False,
    last: Annotated[
        list[str] | None,
        typer.Option(metavar="BOOT=N", help="Its entries of this boot count up to number N.", show_default="all that are held"),
    ] = None,
    days: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=3650, help="When its certificates have ended.", show_default="as the authority"),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Revoke a member of a swarm in flight: nothing of it counts any more, and its links end. It cannot be undone.

    Exit code 2 if that is not in effect at every drone that is heard.
    """
    from radron.agent.operator.revocation import Request, RevocationError  # noqa: PLC0415
    from radron.agent.operator.revocation import revoke as revoke_member  # noqa: PLC0415

    if nothing and last:
        raise RevocationError("--nothing and --last exclude each other: give one of them")
    numbers = {}
    for text in last or ():
        boot, _, number = text.partition("=")
        if re.fullmatch("[0-9a-f]{16}", boot) is None or not number.isdecimal():
            raise RevocationError(f"--last {text}: expected BOOT=N, such as 00112233445566aa=1200")
        numbers[boot] = int(number)

    def confirmed(text: str) -> bool:
        print(text)
        return yes or (sys.stdin.isatty() and typer.confirm(f"Revoke {member}?"))

    asyncio.run(revoke_member(Request(member, swarm, tuple(connect), identity, nothing, numbers, days), confirmed, print))


def _table(drone: str, findings: list[Finding]) -> Table:
    from rich.markup import escape  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    table = Table(title=f"preflight of {drone}", show_header=False)
    for finding in findings:
        table.add_row(finding.name, f"[{_COLOURS[finding.verdict]}]{finding.verdict}[/]", escape(finding.text))
    return table
