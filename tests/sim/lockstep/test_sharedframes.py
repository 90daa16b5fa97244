"""Agents that share their estimates of the frames have the same estimates as alone, bit for bit."""

import random
from collections import Counter

import pytest

from radron.agent.frames.estimate import Estimate
from radron.agent.frames.swarm import SwarmFrames
from radron.protocol.codec import encode
from radron.sim.lockstep.sharedframes import SharedFrames
from support.flights.estimated_frames import DRIFT, UNKNOWN, anchored, lines, satellites, told_later
from support.flights.sighted_swarm import SECOND, Drone, arrival_ns, fly, settle


def jumping(seed):
    """A jump, a liar, and a heading that is not known."""
    drones = [
        Drone("d1", kind="gnss", wander_m=1.0, fixes=True, shift_m=(12.0, -16.0, 0.0)),
        Drone("d2", kind="rtk", wander_m=0.03, fixes=True),
        Drone("d3", yaw_deg=100.0, shift_m=(5.0, 5.0, 0.0), shift_s=8.0, shift_announced=True, **UNKNOWN, **DRIFT),
    ]
    return fly(drones, 14.0, seed, datum=True)


def wrongly_timed(seed):
    """The clock of d2 is ahead from a certain time on; its exposures show it some seconds later."""
    flown = fly(anchored(**UNKNOWN), 14.0, seed)
    half_ns = int(flown.stamps_ns[len(flown.stamps_ns) // 2])
    flown.entries[:] = [
        told_later(one, 1.5, 4.5 if one.stamp_ns > half_ns + 3 * SECOND else 0.0)
        if one.drone == "d2" and one.stamp_ns > half_ns
        else one
        for one in flown.entries
    ]
    return flown


def by_satellites(seed):
    """Three that have nothing but receivers."""
    return fly(satellites(), 14.0, seed, datum=True)


class Agent:
    """Gets the entries of a flight in an order of its own, some of them seconds late, and takes the same ones back again."""

    def __init__(self, flown, seed, estimates, lost=0.0):
        """``lost``: share of the entries of the second half that never arrive."""
        rng = random.Random(seed)
        self.frames = SwarmFrames(flown.mission, estimates)
        half_ns = int(flown.stamps_ns[len(flown.stamps_ns) // 2])
        arriving = [
            (arrival_ns(entry) + round(rng.expovariate(1.0 if rng.random() < 0.02 else 50.0) * SECOND), number, entry)
            for number, entry in enumerate(flown.entries)
            if entry.stamp_ns < half_ns or rng.random() >= lost
        ]
        self._arriving = sorted(arriving, key=lambda one: one[:2])

    def until(self, now_ns):
        while self._arriving and self._arriving[0][0] <= now_ns:
            _, number, entry = self._arriving.pop(0)
            self.frames.receive(entry, encode(entry))
            if number % 97 == 13:
                self.frames.retract([entry.entry_id])
        self.frames.advance(now_ns)


def all_lines(agents, flown):
    return [lines(agent.frames, flown) for agent in agents]


@pytest.mark.parametrize("make", [jumping, wrongly_timed, by_satellites])
@pytest.mark.parametrize("seed", range(2))
def test_agents_that_share_their_frames_have_the_same_as_alone_at_all_times(make, seed, monkeypatch):
    """Also where the log of one lacks entries: it parts from the others, and goes on by its own."""
    flown, computed, active = make(seed), Counter(), [""]
    step = Estimate.step
    monkeypatch.setattr(Estimate, "step", lambda self, *args: computed.update(active) or step(self, *args))
    shared, alone = (
        [Agent(flown, 10 * seed + number, estimates, 0.05 * (number == 2)) for number in range(3)]
        for estimates in (SharedFrames(), Estimate)
    )
    begin_ns, end_ns = int(flown.stamps_ns[0]), int(flown.stamps_ns[-1]) + 8 * SECOND
    for now_ns in range(begin_ns, end_ns, SECOND // 4):
        for active[0], agents in (("shared", shared), ("alone", alone)):
            for agent in agents:
                agent.until(now_ns)
        if (now_ns - begin_ns) % (2 * SECOND) == 0:
            assert all_lines(shared, flown) == all_lines(alone, flown)
    for active[0], agents in (("shared", shared), ("alone", alone)):
        for agent in agents:
            settle(agent.frames, end_ns)
    first, second, third = all_lines(shared, flown)
    assert [first, second, third] == all_lines(alone, flown)
    assert first == second != third
    assert any(one is not None for one in first)
    assert computed["shared"] < 0.8 * computed["alone"]
