"""The end of a run, and the results of flights that find nothing."""

from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace

from radron.protocol.codes import Code
from radron.protocol.messages import Stage
from radron.protocol.texts import CodedText
from radron.sim.live.monitor import Belief
from radron.sim.scenario import load_scenario, override
from radron.sim.scoring.recorder import Recorder
from radron.sim.world.frame import LocalFrames
from radron.sim.world.sources import Source

SOURCES = (Source("Cs-137", 3e9, (0.0, 0.0, 0.0)),)


@pytest.mark.parametrize("stage", [Stage.RETURN, Stage.LANDING, Stage.SURVEY])
@pytest.mark.parametrize("duration_s", [60.0, 500.0])
def test_a_drone_that_never_lands_ends_no_run(stage, duration_s):
    scenario = override(load_scenario("paper-demo"), {"mission.track.duration_s": duration_s, "end.search_s": 100.0, "drones": 1})
    pilot = SimpleNamespace(alive=True, stage=Stage.SURVEY, hypothesis=Belief(np.zeros(3), np.eye(3)), outlook=None, finding=None)
    recorder = Recorder(scenario, [pilot], LocalFrames([((0.0, 0.0, 0.0), 0.0)]), 0.05)
    position, velocity = np.array([[0.0, 0.0, 3.0]]), np.zeros((1, 3))
    assert not recorder.sample(1.0, position, velocity, SOURCES)
    pilot.stage = stage
    longest_s = 100.0 + max(180.0, duration_s) + 300.0
    assert not recorder.sample(1.0 + longest_s, position, velocity, SOURCES)
    assert recorder.sample(1.05 + longest_s, position, velocity, SOURCES)


class Watched:
    """An agent that surveys."""

    def __init__(self):
        self.alive = True
        self.stage, self.hypothesis, self.outlook, self.finding = Stage.SURVEY, None, None, None


def flown(agent, recorder, seconds):
    position = np.array([[0.0, 0.0, 3.0]])
    for tick in range(1, round(seconds / 0.05)):
        recorder.sample(0.05 * tick, position, np.zeros((1, 3)), (), np.zeros((1, 3)))
    return recorder.result(1, 1.0)


def without_source(estimator="bayes"):
    scenario = replace(override(load_scenario("paper-demo"), {"drones": 1, "mission.fusion.estimator": estimator}), source=None)
    agent = Watched()
    return agent, Recorder(scenario, [agent], LocalFrames([((0.0, 0.0, 0.0), 0.0)]), 0.05)


def test_without_a_source_the_result_says_what_would_have_been_found():
    agent, recorder = without_source()
    agent.outlook = SimpleNamespace(excluded_bq=None, exclusion=None)
    assert not flown(agent, recorder, 1.0).nothing_found
    exclusion = SimpleNamespace(known_bq={"Cs-137": 4e7, "Co-60": 2e7})
    agent.outlook, agent.finding = (
        SimpleNamespace(excluded_bq=4e7, exclusion=exclusion),
        CodedText(Code.NOTHING_FOUND, "any words"),
    )
    result = flown(agent, recorder, 2.0)
    assert (result.finding, result.finding_code) == ("any words", "nothing-found")
    assert (result.nothing_found, result.excluded_bq, result.false_hypothesis) == (True, 4e7, False)
    assert result.excluded_nuclides_bq == {"Cs-137": 4e7, "Co-60": 2e7}
    assert (result.time_to_x0_s, result.error_median_m, result.region) == (None, None, None)


def test_a_hypothesis_without_a_source_is_a_false_one_even_when_it_is_taken_back():
    agent, recorder = without_source()
    agent.hypothesis = Belief(np.zeros(3), np.eye(3))
    flown(agent, recorder, 1.0)
    agent.hypothesis, agent.outlook = None, SimpleNamespace(excluded_bq=4e7, exclusion=None)
    result = flown(agent, recorder, 2.0)
    assert result.false_hypothesis
    assert result.x0_rms_m == pytest.approx(2.0**0.5)
    assert result.x0_error_m is None


def test_an_estimator_that_only_listened_finds_nothing_once_it_excludes_what_the_mission_is_after():
    scenario = replace(override(load_scenario("paper-demo"), {"drones": 1, "mission.survey.least_activity_bq": 1e8}), source=None)
    agent, listener = Watched(), SimpleNamespace(hypothesis=None, outlook=SimpleNamespace(excluded_bq=2e8, exclusion=None))
    recorder = Recorder(scenario, [agent], LocalFrames([((0.0, 0.0, 0.0), 0.0)]), 0.05, {"bayes": listener})
    flown(agent, recorder, 1.0)
    assert not recorder.listened(1, 1.0)["bayes"].nothing_found
    listener.outlook.excluded_bq = 5e7
    heard = recorder.listened(1, 1.0)["bayes"]
    assert (heard.nothing_found, heard.excluded_bq) == (True, 5e7)


def test_the_result_has_errors_and_bounds_of_the_flight_in_the_true_frame_and_the_vehicles():
    """A circle around a source at rest; the estimate is exact for the vehicle, with its localisation off by (0.6, 0.8) m."""
    scenario = override(load_scenario("biased-static-solo"), {"end.track_s": 20.0})
    source, offset = (40.0, 50.0), np.array([[0.6, 0.8, 0.0]])
    agent = Watched()
    recorder = Recorder(scenario, [agent], LocalFrames([((0.0, 0.0, 0.0), 0.0)]), 0.05)
    sources = [Source("Cs-137", scenario.source.activity_bq, (*source, 0.0))]
    seen = np.array([40.6, 50.8, 0.0])
    over, tick = False, 0
    while not over:
        tick += 1
        if tick == 40:
            agent.stage, agent.hypothesis = Stage.TRACK, Belief(seen, np.diag([2.0, 1.0, 0.0]))
        angle = 0.3 * 0.05 * tick
        position = np.array([[source[0] + 10.0 * np.cos(angle), source[1] + 10.0 * np.sin(angle), 3.0]])
        over = recorder.sample(0.05 * tick, position, np.zeros((1, 3)), sources, offset)
    result, trace = recorder.result(1, 1.0), recorder.trace()
    assert result.error_median_m == pytest.approx(1.0)
    assert result.error_relative_median_m == pytest.approx(0.0, abs=1e-9)
    assert (result.error_sample_m, result.nees_sample) == pytest.approx((1.0, 0.36 / 2.0 + 0.64))
    assert result.x0_rms_m == pytest.approx(3.0**0.5)
    # The vehicle's own bias of 1 m along each axis stays; 20 s of measurements from there carry much information.
    assert result.bound_median_m is not None
    assert result.bound_relative_median_m is not None
    assert result.bound_median_m > 1.177
    assert 0.1 < result.bound_relative_median_m < 1.0
    tracked = trace.stage[:, 0] == "track"
    assert np.isfinite(trace.bound_m[tracked]).all()
    assert trace.own_error_m[tracked] == pytest.approx(0.0, abs=1e-9)
    assert (trace.own_bound_m[tracked] < trace.bound_m[tracked]).all()
    assert trace.source_bq == scenario.source.activity_bq
    assert trace.covariance_m2[tracked][0].tolist() == [[2.0, 0.0], [0.0, 1.0]]
    assert np.isnan(trace.covariance_m2[~tracked]).all()


def test_the_swarm_is_judged_by_its_first_drone_while_that_lives_then_by_the_next_one_alive():
    scenario = override(load_scenario("paper-demo"), {"drones": 3})
    agents = [Watched() for _ in range(3)]
    for place, agent in enumerate(agents):
        agent.stage, agent.hypothesis = Stage.TRACK, Belief(np.array([10.0 * place, 0.0, 0.0]), np.eye(3))
    recorder = Recorder(scenario, agents, LocalFrames([((0.0, 0.0, 0.0), 0.0)] * 3), 0.05)
    position = np.tile([0.0, 0.0, 3.0], (3, 1))

    def fly(since_s):
        for tick in range(1, 9):
            recorder.sample(since_s + 0.05 * tick, position, np.zeros((3, 3)), SOURCES)

    fly(0.0)
    agents[0].alive = False
    fly(1.0)
    agents[0].alive = True  # back with an empty log: no drone changes over to it
    fly(2.0)
    agents[1].alive = False
    fly(3.0)
    trace = recorder.trace()
    assert trace.judged.tolist() == [0, 0, 1, 1, 1, 1, 0, 0]
    assert trace.estimate_m[:, 0].tolist() == [0.0, 0.0, 10.0, 10.0, 10.0, 10.0, 0.0, 0.0]


def test_tracking_lasts_as_long_as_the_truths_say_even_where_a_busy_machine_drops_some_of_them():
    agent, recorder = without_source()
    agent.stage = Stage.TRACK
    position = np.array([[0.0, 0.0, 3.0]])
    for tick in (*range(1, 41), *range(81, 121)):  # at 20 Hz, and 2 s of them lost
        recorder.sample(0.05 * tick, position, np.zeros((1, 3)), (), np.zeros((1, 3)))
    assert recorder.result(1, 1.0).tracking_time_s == pytest.approx(6.0, abs=0.2)
