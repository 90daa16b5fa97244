"""The ``radron-sim`` command."""

from __future__ import annotations

import sys

import typer

from agent.errors import RadronError
from protocol.errors import ProtocolError
from sim.commands import campaign, run, table
from sim.consistency_command import consistency
from sim.live_command import live
from sim.radiation.hits import hits

app = typer.Typer(no_args_is_help=True, add_completion=False, help="The simulated world: radiation, detectors, vehicles, radio.")


app.command()(live)
app.command()(run)
app.command()(campaign)
app.command()(table)
app.command()(consistency)
app.command()(hits)


def main() -> None:
    """Run the command; what the user can mend ends in one line and exit code 2."""
    try:
        app()
    except (RadronError, ProtocolError) as error:
        print(f"radron-sim: {error}", file=sys.stderr)
        sys.exit(2)
