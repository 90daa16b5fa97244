"""Processes of agents: lifetime, steps, and state after a restart."""

import itertools
from types import SimpleNamespace

import msgspec
import pytest

from radron.agent.mission.memory import Memory
from radron.protocol.messages import Stage
from radron.sim.faults.kinds import KINDS
from radron.sim.faults.process import Agent, Crew
from radron.sim.faults.schedule import Schedule

SECOND = 1_000_000_000
NAMES = ("d1", "d2")


def fault(kind, at_s, **values):
    return msgspec.convert({"kind": kind, "at_s": at_s, "target": "d2", **values}, KINDS[kind])


class Standin:
    """A pilot with only stage and memory."""

    def __init__(self, stage=Stage.TRACK, memory=None):
        self.stage, self.memory, self.blocked, self.revocations = stage, memory, (), ()

    def block(self, problems):
        self.blocked = problems


class Flight:
    """Two agents in ticks of 50 ms."""

    def __init__(self, *faults, absent=()):
        self.schedule = Schedule(faults, NAMES, 1)
        self.autopilots = [SimpleNamespace(armed=True) for _ in NAMES]
        self.gone, self.started, self.reminded, self.steps = [], [], [], [[], []]
        agents = [Agent(Standin(), pilot, name in absent) for name, pilot in zip(NAMES, self.autopilots, strict=True)]
        self.crew = Crew(faults, self.schedule, agents, self.start, self.gone.append, self.remind)
        self.now_ns = 0

    def start(self, drone, starts, memory=None):
        self.started.append((drone, starts, memory))
        return Standin(Stage.PREFLIGHT)

    def remind(self, drone, pilot, held, now_ns):
        self.reminded.append((drone, held, now_ns))

    def go(self, time_s):
        while self.now_ns <= time_s * SECOND:
            self.schedule.advance(self.now_ns / SECOND)
            self.crew.advance(self.now_ns)
            for drone in range(2):
                if self.crew.steps(drone, self.now_ns):
                    self.steps[drone].append(self.now_ns / SECOND)
            self.now_ns += SECOND // 20

    @property
    def alive(self):
        return [agent.alive for agent in self.crew.agents]


def test_an_agent_that_is_started_again_knows_who_had_been_revoked_unless_its_disk_was_full():
    for faults, known in (((), True), ((fault("disk", 0.0, how="full"),), False)):
        flight = Flight(fault("kill", 5.0, for_s=10.0), *faults)
        flight.crew.agents[1].pilot.revocations = ("d3",)
        flight.go(15.0)
        assert flight.reminded == ([(1, ("d3",), 15 * SECOND)] if known else [])


def test_a_killed_agent_comes_back_with_what_its_disk_kept():
    flight = Flight(fault("kill", 5.0, for_s=10.0))
    memory = Memory(mission="m", stamp_ns=1, started_ns=1, stage=Stage.TRACK, resume=Stage.SURVEY)
    flight.crew.agents[1].pilot.memory = memory
    flight.go(6.0)
    assert flight.alive == [True, False]
    assert flight.crew.agents[1].stage is Stage.RETURN
    assert max(flight.steps[1]) == pytest.approx(4.95)
    flight.go(15.0)
    assert flight.alive == [True, True]
    assert flight.started == [(1, 1, memory)]
    assert len(flight.steps[0]) == 301


def test_what_a_step_changes_is_on_the_disk_before_the_next_one():
    """The shell saves it with the step, and looks twice a second for what that has left."""
    flight = Flight(fault("kill", 5.2, for_s=10.0))
    flight.go(5.05)
    memory = Memory(mission="m", stamp_ns=1, started_ns=1, stage=Stage.LANDING, resume=Stage.SURVEY)
    flight.crew.agents[1].pilot.memory = memory
    flight.go(16.0)
    assert flight.started == [(1, 1, memory)]


def test_a_dead_agent_has_landed_when_its_vehicle_has_and_waits_when_it_is_back():
    flight = Flight(fault("kill", 5.0, for_s=10.0))
    flight.go(6.0)
    flight.autopilots[1].armed = False
    assert flight.crew.agents[1].stage is Stage.LANDED
    flight.go(16.0)
    assert flight.crew.pilots[1].stage is Stage.PREFLIGHT
    assert flight.crew.agents[1].stage is Stage.LANDED  # no reason to go on with the flight


def test_without_an_end_it_stays_dead_whatever_other_fault_ends():
    flight = Flight(fault("kill", 5.0), fault("kill", 2.0, for_s=5.0), fault("freeze", 6.0, for_s=2.0))
    flight.go(30.0)
    assert flight.alive == [True, False]
    assert flight.started == []


@pytest.mark.parametrize(("for_s", "killed"), [(0.8, False), (3.0, True)])
def test_a_frozen_agent_is_killed_after_a_second(for_s, killed):
    flight = Flight(fault("freeze", 5.0, for_s=for_s))
    flight.go(5.9)
    pause = [time_s for time_s in flight.steps[1] if 4.99 < time_s < 5.79]
    assert pause == []
    flight.go(6.1)
    assert flight.alive == [True, not killed]
    flight.go(8.1)
    assert flight.alive == [True, True]
    assert len(flight.started) == killed


def test_a_late_agent_is_absent_then_started_and_called_until_it_flies():
    flight = Flight(fault("late", 5.0), absent=("d2",))
    flight.go(4.9)
    assert (flight.alive, flight.crew.called(flight.now_ns)) == ([True, False], [])
    flight.go(5.0)
    assert flight.alive == [True, True]
    calls = []
    for second in range(6, 12):
        flight.go(float(second))
        calls.append(flight.crew.called(flight.now_ns))
        if second == 9:
            flight.crew.pilots[1].stage = Stage.TAKEOFF
    assert calls == [[], [1], [1], [1], [], []]


def test_a_late_agent_that_the_operator_has_revoked_is_not_called():
    flight = Flight(fault("revoked", 3.0), fault("late", 5.0), absent=("d2",))
    flight.go(8.0)
    assert flight.alive == [True, True]
    assert flight.crew.called(flight.now_ns) == []


def test_a_slow_agent_leaves_out_steps():
    flight = Flight(fault("slow-cpu", 5.0, for_s=20.0, late_s=0.4))
    flight.go(30.0)
    slow = [time_s for time_s in flight.steps[1] if 5.0 <= time_s < 25.0]
    gaps = [after - before for before, after in itertools.pairwise(slow)]
    assert 0.3 < max(gaps) <= 0.45
    assert 65 < len(slow) < 120  # uniform delays of 0 to 0.4 s, to the next tick: 0.22 s in the mean
    assert flight.started == []
    assert len(flight.steps[0]) == 601


def test_one_that_is_too_slow_is_ended_and_started_again():
    flight = Flight(fault("slow-cpu", 5.0, for_s=20.0, late_s=2.0))
    flight.go(30.0)
    assert len(flight.started) >= 2
    assert flight.alive == [True, True]


def lost(how, at_s=0.0):
    """State that a killed agent gets back from its disk, and its reports."""
    flight = Flight(fault("disk", at_s, how=how), fault("kill", 5.0, for_s=1.0))
    memory = Memory(mission="m", stamp_ns=1, started_ns=1, stage=Stage.TRACK, resume=Stage.SURVEY)
    flight.crew.agents[1].pilot.memory = memory
    flight.go(4.0)
    told = flight.crew.pilots[1].blocked
    flight.go(7.0)
    return flight.started[0][2], told, flight.crew.pilots[1].blocked


def test_a_full_disk_keeps_what_was_there_before():
    kept, before, _ = lost("full")
    assert kept is None
    assert "not saved" in before[0]
    assert lost("full", at_s=3.0)[0] is not None


def test_a_slow_disk_has_not_written_yet():
    assert lost("slow") == (None, (), ())


def test_a_torn_state_is_not_flown_by_and_told():
    kept, before, after = lost("state-torn")
    assert (kept, before) == (None, ())
    assert "no readable state file" in after[0]
