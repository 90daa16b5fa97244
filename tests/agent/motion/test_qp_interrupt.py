"""The tracker's solver and Ctrl-C: OSQP catches SIGINT itself while it solves, and no signal may get lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

# Solves one problem after another, and says of each SIGINT that it came, and of each problem that was not solved.
SOLVE = """
import signal, sys, threading
import numpy as np, shapely
from radron.agent.config.mission import LimitsConfig
from radron.agent.motion.fence import Fence
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.tracker import Status, Tracker

if sys.argv[1] == "counts, threaded":
    threading.Thread(target=threading.Event().wait, daemon=True).start()  # SIGINT may go to any thread that takes it
if sys.argv[1].startswith("counts"):
    signal.signal(signal.SIGINT, lambda *_: print("came", flush=True))
elif sys.argv[1] == "ignores":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
tracker = Tracker(LimitsConfig(), Fence(shapely.box(-50.0, -50.0, 50.0, 50.0), 1.5, 60.0))
goals = [Reference(np.tile([x, -x, 3.0], (31, 1)), np.zeros((31, 3)), 0.2) for x in (-40.0, 40.0)]
print("solving", flush=True)
step = 0
while True:
    step += 1
    plan = tracker.plan(step * 200_000_000, PeerState((0.0, 0.0, 3.0)), goals[step % 2])
    if plan.status is not Status.CONSTRAINED:
        print("not solved", flush=True)
    if sys.argv[1] == "ignores" and step % 50 == 0:
        print("solved", flush=True)
"""


@pytest.fixture
def solver(request: pytest.FixtureRequest) -> Iterator[subprocess.Popen[str]]:
    """A process that solves until it is ended; the parameter: its reaction to SIGINT."""
    process = subprocess.Popen(
        [sys.executable, "-c", SOLVE, request.param],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "solving\n"
    yield process
    process.kill()
    process.communicate()


@pytest.mark.parametrize("solver", ["counts", "counts, threaded"], indirect=True)
def test_no_interrupt_gets_lost(solver: subprocess.Popen[str]) -> None:
    assert solver.stdout is not None
    for _ in range(300):
        solver.send_signal(signal.SIGINT)
        line = solver.stdout.readline()
        while line == "Solver interrupted\n":  # OSQP's own words, where another thread has let the signal through
            line = solver.stdout.readline()
        assert line == "came\n"


@pytest.mark.parametrize("solver", ["ends"], indirect=True)
def test_an_interrupt_ends_what_it_interrupts(solver: subprocess.Popen[str]) -> None:
    solver.send_signal(signal.SIGINT)
    _, errors = solver.communicate(timeout=20.0)
    assert errors.endswith("KeyboardInterrupt\n")


@pytest.mark.parametrize("solver", ["ignores"], indirect=True)
def test_who_ignores_interrupts_gets_the_solution(solver: subprocess.Popen[str]) -> None:
    """As an agent under a supervisor that gets the terminal's SIGINT, too."""
    assert solver.stdout is not None
    for _ in range(20):
        for _ in range(10):
            solver.send_signal(signal.SIGINT)
        assert solver.stdout.readline() == "solved\n"
