"""``radron-agent run``, ``preflight`` and ``command``. Slow imports are left to the command that needs them."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from protocol.messages import Action

if TYPE_CHECKING:
    from rich.table import Table

    from agent.vehicle.interface import Finding

ConfigOption = Annotated[Path, typer.Option(metavar="DRONE.toml", help="The drone file; RADRON_ variables override it.")]
_COLOURS = {"ok": "green", "not yet": "yellow", "failed": "red"}


def run(
    config: ConfigOption, verbose: Annotated[bool, typer.Option("--verbose", help="Also log the counters every 10 s.")] = False
) -> None:
    """Fly this drone's part of the mission, until SIGINT or SIGTERM.

    Nothing moves without an operator's start command. This process becomes the watchdog, and the agent is its child. Exit codes:
    0 stopped on request; 2 an error that the user can fix, in one line; 70 the agent hung or crashed: the autopilot took over.
    """
    agent = [sys.executable, "-m", "agent", str(config), *(["--verbose"] if verbose else [])]
    sys.stderr.flush()
    os.execv(sys.executable, [sys.executable, "-m", "agent.shell.supervisor", *agent])  # without this command's imports: 12 MB


def preflight(
    config: ConfigOption,
    wait: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.0, max=600.0, help="How long to wait until all is ready.")
    ] = 10.0,
) -> None:
    """Connect everything, command nothing, and report what is ready. Exit code 0 if everything is ready, else 1."""
    from rich.console import Console  # noqa: PLC0415
    from rich.live import Live  # noqa: PLC0415

    from agent.preflight.check import Preflight  # noqa: PLC0415
    from agent.shell.overrides import load_drone  # noqa: PLC0415

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


def command(
    action: Annotated[Action, typer.Argument(help="What the swarm is to do.")],
    swarm: Annotated[str, typer.Option(metavar="NAME", help="The swarm's name, as in its mission file.")],
    connect: Annotated[list[str], typer.Option(metavar="tls/HOST:PORT", help="A drone's endpoint; may be given several times.")],
    identity: Annotated[
        Path | None, typer.Option(envvar="RADRON_IDENTITY", metavar="FOLDER", help="The operator's certificate and key.")
    ] = None,
    insecure: Annotated[bool, typer.Option("--insecure", help="The swarm's links are not encrypted (tcp/HOST:PORT).")] = False,
    drones: Annotated[str, typer.Option(metavar="d1,d2", help="Only these drones.", show_default="all")] = "",
    without: Annotated[
        str, typer.Option(metavar="d3", help="All but these, which need not be there; their absence is no obstacle to a start.")
    ] = "",
    anyway: Annotated[bool, typer.Option("--anyway", help="Start those that can, although others report problems.")] = False,
) -> None:
    """Command a swarm, and wait until it has obeyed. Exit code 2 if a drone refuses, with its reasons."""
    from agent import groundcontrol  # noqa: PLC0415
    from agent.groundcontrol import CommandError  # noqa: PLC0415

    names, left = (tuple(name for name in listed.split(",") if name) for listed in (drones, without))
    if names and left:
        raise CommandError("--drones and --without exclude each other: give one of them")
    if insecure == (identity is not None):
        make = "run `radron-deploy pki issue NAME --role operator`, and give the folder that it makes"
        raise CommandError(f"--identity or --insecure: give one of them; for a certificate, {make}")
    order = groundcontrol.Order(action, swarm, tuple(connect), names, left, anyway, identity)
    asyncio.run(groundcontrol.command(order, print))


def _table(drone: str, findings: list[Finding]) -> Table:
    from rich.markup import escape  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    table = Table(title=f"preflight of {drone}", show_header=False)
    for finding in findings:
        table.add_row(finding.name, f"[{_COLOURS[finding.verdict]}]{finding.verdict}[/]", escape(finding.text))
    return table
