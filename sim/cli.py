"""The ``radron-sim`` command."""

from __future__ import annotations

import os

import typer

from agent import version
from agent.terminal import run_command
from sim.commands.consistency import consistency
from sim.commands.faults import faults
from sim.commands.flights import campaign, run, scenarios, table
from sim.commands.ground import ground
from sim.live.command import live
from sim.live.faults.command import live_faults
from sim.px4test.command import px4_test
from sim.radiation.hits import hits

_HELP = "The simulated world: radiation, detectors, vehicles, radio."
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")  # unless set: matrices are small, and Ctrl-C must reach the main thread
app = typer.Typer(no_args_is_help=True, add_completion=False)


app.callback(help=_HELP)(version.options)
app.command()(scenarios)
app.command()(live)
app.command()(px4_test)
app.command()(run)
app.command()(campaign)
app.command()(table)
app.command()(consistency)
app.command()(faults)
app.command()(live_faults)
app.command()(hits)
app.command()(ground)


def main() -> None:
    """Run the command; errors that the user can fix end in one line and exit code 2."""
    for name in _ONE_THREAD:
        os.environ.setdefault(name, "1")
    run_command("radron-sim", app)
