"""The ``radron-sim`` command."""

from __future__ import annotations

import os

import typer

from radron.agent import version
from radron.agent.terminal import run_command
from radron.sim.commands.consistency import consistency
from radron.sim.commands.faults import faults
from radron.sim.commands.flights import campaign, run, scenarios, table
from radron.sim.commands.ground import ground
from radron.sim.commands.response import response
from radron.sim.live.command import live
from radron.sim.live.faults.command import live_faults
from radron.sim.px4test.command import px4_test
from radron.sim.radiation.hits import hits

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
app.command()(response)


def main() -> None:
    """Run the ``radron-sim`` command; an error that the user can fix ends in one line of text and the exit code 2."""
    for name in _ONE_THREAD:
        os.environ.setdefault(name, "1")
    run_command("radron-sim", app)
