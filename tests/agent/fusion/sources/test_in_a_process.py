"""The estimator in a process of its own, as on board: its results, its end, and how long the agent's loop is held."""

from __future__ import annotations

import asyncio
import gc
import os
import selectors
import signal
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import psutil
import pytest

from radron.agent.fusion import deferred
from radron.agent.fusion.estimator import Hypothesis
from radron.agent.fusion.registry import deferred_named
from radron.agent.shell.folding import Folding
from radron.agent.shell.foldworker import LENGTH, packed
from support.flights.fusions import fusion_of

DEADLINE_S = 120.0  # the machine is shared
MOST_HELD_S = 0.01  # processor time of the loop between two waits
TWO = [("Cs-137", 12.0, 20.0, 6e8), ("Ir-192", 30.0, 15.0, 1e9)]


class Watched(selectors.DefaultSelector):
    """Measures the processor time for which the loop is held, whatever else the machine computes."""

    def __init__(self):
        super().__init__()
        self.most_s, self._since_s = 0.0, time.thread_time()

    def select(self, timeout=None):
        self.most_s = max(self.most_s, time.thread_time() - self._since_s)
        events = super().select(timeout)
        self._since_s = time.thread_time()
        return events


class Told:
    """Takes the place of the agent's log, and keeps the processes' ids and ends."""

    def __init__(self):
        self.pids, self.ends = [], []

    def info(self, _, pid):
        self.pids.append(pid)

    def error(self, _, **why):
        self.ends.append(why)


class Aboard:
    """A fusion and the process that computes for it."""

    def __init__(self, mission):
        self.fusion = fusion_of(mission, deferred_named("sources", mission))
        self.log = Told()
        self.folding = Folding(self.fusion.estimator, mission, self.fusion.answered, self.log, pause_s=0.05)

    async def until(self, condition, now_ns):
        deadline_s = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < deadline_s, self.folding.problem
            self.fusion.advance(now_ns)
            await asyncio.sleep(0.005)

    async def settled(self, now_ns):
        self.fusion.advance(now_ns)
        await self.until(lambda: not self.fusion.pending, now_ns)
        return self.fusion.hypothesis


def flown(mission, flight):
    """Run a flight, and its process, in a loop; return its results, and the longest hold of the loop."""
    selector = Watched()

    async def run():
        aboard = Aboard(mission)
        computing = asyncio.create_task(aboard.folding.run())
        try:
            await aboard.until(lambda: aboard.log.pids, 0)
            selector.most_s = 0.0
            return await flight(aboard)
        finally:
            computing.cancel()
            await asyncio.gather(computing, return_exceptions=True)

    gc.collect()
    gc.freeze()  # as the agent does
    try:
        with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(selector)) as runner:
            return runner.run(run()), selector.most_s
    finally:
        gc.unfreeze()


def test_an_estimate_can_be_sent_whatever_of_it_has_its_default():
    """A default that cannot be pickled ended the process with its first estimate, again and again."""
    three = np.zeros(3)
    estimate = Hypothesis(stamp_ns=1, position=three, covariance=np.eye(3), velocity=three.copy(), cones=0, x0_stamp_ns=1)
    sent = packed((frozenset(), deferred.Told(estimate)))
    assert len(sent) > LENGTH.size


@pytest.mark.slow
def test_the_same_bits_and_a_loop_that_is_free_although_the_process_is_killed(kit, among):
    mission = among.mission_of()
    entries = among.entries_of(mission, np.random.default_rng(2), 30.0, TWO)
    in_place = fusion_of(mission)
    kit.feed(in_place, entries)

    async def flight(aboard):
        assert aboard.folding.problem is None
        found = []
        for until_s in range(2, 34, 2):
            now_ns = kit.T0_NS + until_s * 1_000_000_000
            for entry in entries:
                if until_s - 2 <= (entry.stamp_ns - kit.T0_NS) * 1e-9 < until_s:
                    kit.feed(aboard.fusion, [entry])
                    await asyncio.sleep(0.0)
            found.append(await aboard.settled(now_ns))
            if until_s == 20:
                os.kill(aboard.log.pids[-1], signal.SIGKILL)
                await aboard.until(lambda: aboard.folding.problem is not None, now_ns)
                assert "has ended, and starts again" in aboard.folding.problem
                assert aboard.fusion.hypothesis is found[-1]
        return found, aboard.log, aboard.folding.problem

    (found, log, problem), held_s = flown(mission, flight)
    for number, hypothesis in enumerate(found, 1):
        assert kit.same_bits(hypothesis, kit.settle(in_place, kit.T0_NS + number * 2_000_000_000))
    assert len(found[-1].others) == 1
    assert (len(log.pids), len(log.ends), problem) == (2, 1, None)
    assert held_s < MOST_HELD_S
    for pid in log.pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.slow
def test_the_process_ends_with_an_agent_that_is_killed():
    parent = """
import os, subprocess, sys, time
command = [sys.executable, "-m", "radron.agent.shell.foldworker", str(os.getpid())]
print(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL).pid, flush=True)
time.sleep(600)
"""
    agent = subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True)
    try:
        pid = int(agent.stdout.readline())
    finally:
        agent.kill()
        agent.wait()
        agent.stdout.close()
    deadline_s = time.monotonic() + DEADLINE_S
    while runs(pid):
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def runs(pid):
    """Whether a process is there, and no zombie without a waiting parent."""
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False
