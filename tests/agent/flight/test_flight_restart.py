"""A whole mission in which one agent is killed and restarted: it resumes, agrees with the others, and all of it replays."""

import itertools

import pytest

from radron.agent.flight.header import FlightHeader
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.flight.replay import replay
from radron.agent.pilot import Pilot, Step
from radron.agent.vehicle.interface import FlightMode, Request, VehicleCommand
from radron.protocol.messages import Stage
from radron.sim.lockstep.world import TICK_NS, World
from radron.sim.scenario import load_scenario, override
from radron.sim.scoring.moment import EPOCH_NS
from support.flights.one_pilot import SECOND

DIES_NS = EPOCH_NS + 20 * SECOND
BACK_NS = DIES_NS + 3 * SECOND  # the failsafe trips after 1 s


class Mortal:
    """An agent in the lockstep; between ``DIES_NS`` and ``BACK_NS`` its vehicle is alone."""

    def __init__(self, folder, mission, config, boot, trust, mortal):
        self.folder, self.mission, self.config, self.trust, self.mortal = folder, mission, config, trust, mortal
        self.listeners = {}
        self.boots = itertools.count()
        self.modes, self.requests = [], []
        self.others = []
        self.start(boot, None)

    def start(self, boot, memory):
        begun_ns, key = SECOND * (1_800_000_000 + next(self.boots)), {"nonce_key": boot.encode()}
        header = FlightHeader.of(self.mission, self.config, boot, begun_ns, memory, self.trust, **key)
        self.recorder = FlightRecorder(self.folder, 100, header)
        self.bare = Pilot(self.mission, self.config, boot, memory=memory, trust=self.trust, **key)
        self.fusion = self.bare.fusion
        self.pilot = RecordedPilot(self.bare, self.recorder)

    stage = property(lambda self: self.bare.stage)
    hypothesis = property(lambda self: self.bare.hypothesis)
    outlook = property(lambda self: self.bare.outlook)
    finding = property(lambda self: self.bare.finding)

    def ticket(self, now_ns):
        return self.pilot.ticket(now_ns)

    def observe_clock(self, ahead_ns, now_ns):
        if not self.is_dead(now_ns):
            self.pilot.observe_clock(ahead_ns, now_ns)

    def observe_vehicle(self, state):
        self.modes.append(state.mode)
        if not self.is_dead(state.stamp_ns):
            self.pilot.observe_vehicle(state)

    def observe_detector(self, readout):
        return [] if self.is_dead(readout.end_ns) else self.pilot.observe_detector(readout)

    def receive(self, key, payload, now_ns):
        if not self.is_dead(now_ns):
            self.pilot.receive(key, payload, now_ns)

    def advance(self, now_ns):
        if not self.is_dead(now_ns):
            self.pilot.advance(now_ns)

    def step(self, now_ns):
        if self.is_dead(now_ns):
            return Step([], VehicleCommand(Request.RELEASE))
        if self.mortal and now_ns == BACK_NS:
            self.recorder.close()
            self.start("f" * 16, self.pilot.memory)
        if now_ns % (2 * SECOND) == 0:
            self.ask(now_ns)
        step = self.pilot.step(now_ns)
        self.requests.append(step.command.request)
        return step

    def ask(self, now_ns):
        """Get the log's missing entries."""
        for other in self.others:
            for key, payload in other.pilot.log_answer(self.pilot.log_summary()):
                self.pilot.receive(key, payload, now_ns)

    def is_dead(self, now_ns):
        return self.mortal and DIES_NS <= now_ns < BACK_NS


@pytest.mark.slow
def test_a_restarted_agent_flies_on_and_everything_replays(tmp_path):
    agents = []

    def made(mission, config, boot, listeners, memory, trust, *, nonce_key, computing):
        agents.append(Mortal(tmp_path / config.id, mission, config, boot, trust, mortal=config.id == "d2"))
        return agents[-1]

    world = World(override(load_scenario("paper-demo"), {"mission.track.duration_s": 25.0}), 1, (), made)
    for agent in agents:
        agent.others = [other for other in agents if other is not agent]
    stages = []
    while not world.tick():
        stages.append([agent.stage for agent in agents])
    world.close()
    end_ns = EPOCH_NS + world.ticks * TICK_NS
    for agent in agents:
        agent.ask(end_ns)  # messages under way at the end of the world
        agent.pilot.advance(end_ns)
        agent.recorder.close()
    d2 = agents[1]
    back = round((BACK_NS - EPOCH_NS) / TICK_NS)
    assert d2.modes[back] is FlightMode.RETURN  # the failsafe had it
    assert set(d2.modes[back + 2 : back + 100]) == {FlightMode.OFFBOARD}
    assert {seen[1] for seen in stages[back + 2 : back + 40]} == {Stage.SURVEY, Stage.TRACK}  # no log yet, at first
    assert {seen[1] for seen in stages[back + 40 : back + 100]} == {Stage.TRACK}
    began, ended = (
        [next(tick for tick, seen in enumerate(stages) if seen[k] is stage) for k in range(3)]
        for stage in (Stage.TRACK, Stage.RETURN)
    )
    tracked = [end - begin for begin, end in zip(began, ended, strict=True)]
    assert max(tracked) - min(tracked) <= 2  # for as long as the others, from before the restart
    assert len({agent.pilot.digest for agent in agents}) == 1
    assert len({agent.hypothesis.position.tobytes() for agent in agents}) == 1
    files = sorted(file for folder in tmp_path.iterdir() for file in folder.iterdir())
    assert len(files) == 4
    assert all(replay(file).identical for file in files)
    assert replay(files[2]).calls["call/step"] > 100
