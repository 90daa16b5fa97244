"""However the launcher ends, no process of its flight is left."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from support.live.run import live_run

UP_S, DOWN_S = 180.0, 20.0  # the machine is shared: 10 s and 3 s on an unshared machine


@pytest.mark.slow
def test_nothing_survives_a_killed_launcher(tmp_path: Path) -> None:
    with live_run(tmp_path, "paper-demo", "--drones", "2") as run:
        run.until(run.agents_up, UP_S)
        assert len(run.processes()) >= 5  # the world, and two agents with their watchdogs
        run.process.send_signal(signal.SIGKILL)
        run.process.wait()
        run.until(lambda: not run.processes() and not run.busy_ports(), DOWN_S)


@pytest.mark.slow
def test_an_interrupt_ends_everything_and_says_so(tmp_path: Path) -> None:
    with live_run(tmp_path, "paper-demo", "--drones", "1") as run:
        run.until(run.agents_up, UP_S)
        run.process.send_signal(signal.SIGINT)
        assert run.process.wait(DOWN_S) == 128 + signal.SIGINT, run.said
        assert run.processes() == []
        run.until(lambda: not run.busy_ports(), DOWN_S)
        assert "stopped on request before the end" in run.said
        assert "Traceback" not in run.said
