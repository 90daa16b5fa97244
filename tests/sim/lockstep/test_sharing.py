"""Agents that share a fold give the same results as alone, bit for bit."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.frames.estimate import Estimate
from radron.agent.frames.transform import Transform
from radron.agent.fusion.bayes.estimator import BayesEstimator
from radron.agent.fusion.estimator import GridStep
from radron.agent.fusion.observation import CountObservation
from radron.agent.fusion.registry import estimator_named
from radron.agent.pilot import Pilot
from radron.protocol.entries import EntryId
from radron.protocol.signing import signed_root
from radron.protocol.spectrum import SpectrumBin
from radron.sim.lockstep.flight import watched
from radron.sim.lockstep.sharedframes import SharedFrames
from radron.sim.lockstep.sharing import Descended, Folds, Results, SharedFold, SignedRoots
from radron.sim.scenario import load_scenario, override
from radron.sim.scoring.invariants.care import bytes_of

PARTITION = {"kind": "partition", "groups": [["d1", "d2"], ["d3"]], "at_s": 12.0, "for_s": 5.0}
CLOCK = {"kind": "clock", "at_s": 8.0, "jump_s": 1.5, "target": "d2"}


class Told(Pilot):
    """A pilot that keeps its publications."""

    def step(self, now_ns):
        step = super().step(now_ns)
        self.told = getattr(self, "told", []) + step.publications
        return step


def flown(scenario, until_s):
    """All that a flight's agents published, commanded and believed, and where their vehicles were."""
    seen, pilots = [], []

    def made(*args, **kwargs):
        pilots.append(Told(*args, **kwargs))
        return pilots[-1]

    def watch(moment):
        believed = [pilot and pilot.hypothesis for pilot in moment.pilots]
        bits = [one and (one.stamp_ns, one.position.tobytes(), one.covariance.tobytes(), one.evidence) for one in believed]
        seen.append((moment.position_m.tobytes(), moment.commands, bits))
        return moment.time_s > until_s

    watched(scenario, 1, watch, made)
    return seen, [pilot.told for pilot in pilots]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "until_s", "faults", "estimates_frames"),
    [("paper-demo", 30.0, [PARTITION], False), ("mixed-frames", 25.0, [PARTITION], True), ("mixed-frames", 25.0, [CLOCK], True)],
)
def test_a_flight_with_shared_folds_and_frames_is_the_same_to_the_bit(name, until_s, faults, estimates_frames, monkeypatch):
    """With exact frames and with estimated ones, while a partition parts the logs and heals, and where a clock is wrong."""
    scenario = override(load_scenario(name), {"fault": faults})
    computed = Counter()

    def count(of):
        step = of.step

        def counted(self, *args):
            computed[kind, of] += 1
            return step(self, *args)

        monkeypatch.setattr(of, "step", counted)

    count(BayesEstimator)
    count(Estimate)
    kind = "shared"
    shared = flown(scenario, until_s)
    monkeypatch.setattr(Folds, "__call__", lambda self, *what: estimator_named(*what))
    monkeypatch.setattr(SharedFrames, "__call__", lambda self, *what: Estimate(*what))
    monkeypatch.setattr(SignedRoots, "__call__", lambda self, *what: signed_root(*what))
    kind = "alone"
    alone = flown(scenario, until_s)
    assert shared == alone
    assert any(shared[0][-1][2])  # there are hypotheses
    for of in (BayesEstimator, Estimate) if estimates_frames else (BayesEstimator,):
        assert computed["shared", of] < 0.8 * computed["alone", of]


def test_all_agents_of_a_flight_have_one_fold():
    mission, folds = load_scenario("paper-demo").mission, Folds()
    assert isinstance(folds("bayes", mission), SharedFold)
    assert folds("bayes", mission) is folds("bayes", mission)
    assert folds("paper", mission) is not folds("bayes", mission)


@pytest.fixture
def counts():
    identity = EntryId("0" * 16, 1_000_000_000, "d1", "1" * 16, 1)
    frame = Transform(0.1, (1.0, 2.0, 3.0), np.eye(4))
    return CountObservation(1_000_000_000, 900_000_000, (1.0, 2.0, 8.0), 0.5, np.ones(3), 0.1, 0.01, frame, identity, 0)


def test_what_is_shared_depends_on_every_value_of_an_observation_and_on_no_object(counts):
    mission = load_scenario("paper-demo").mission
    fold = SharedFold(estimator_named("bayes", mission))
    state, step = fold.initial(None), GridStep(10, 1_000_000_000, 1_100_000_000)
    assert fold.initial(None) is state
    first = fold.step(state, step, [counts])
    assert fold.step(state, step, [counts]).lineage is first.lineage
    again = replace(counts, counts=np.ones(3), mission_from_local=Transform(0.1, (1.0, 2.0, 3.0), np.eye(4)))
    assert fold.step(state, step, [again]).state is first.state
    others = [
        replace(counts, stamp_ns=1_000_000_001),
        replace(counts, middle_ns=900_000_001),
        replace(counts, position=(1.0, 2.0, 8.5)),
        replace(counts, live_time_s=0.4),
        replace(counts, counts=np.array((1.0, 1.0, 2.0))),
        replace(counts, spectrum=(SpectrumBin(3, 1, 0),)),
        replace(counts, facing=(0.6, 0.8)),
        replace(counts, way_m=1.0),
        replace(counts, position_sigma_m=0.2),
        replace(counts, yaw_sigma_rad=0.02),
        replace(counts, identity=counts.identity._replace(sequence=2)),
        replace(counts, epoch=1),
        replace(counts, mission_from_local=Transform(0.2, (1.0, 2.0, 3.0), np.eye(4))),
        replace(counts, mission_from_local=Transform(0.1, (1.0, 2.0, 3.5), np.eye(4))),
        replace(counts, mission_from_local=Transform(0.1, (1.0, 2.0, 3.0), 2.0 * np.eye(4))),
        replace(counts, mission_from_local=Transform(0.1, (1.0, 2.0, 3.0))),
    ]
    found = [fold.step(state, step, [one]) for one in others]
    assert len({id(one.state) for one in [first, *found]}) == len({id(one.lineage) for one in [first, *found]}) == len(others) + 1
    for other in (fold.step(state, GridStep(11, 1_100_000_000, 1_200_000_000), [counts]), fold.step(first, step, [counts])):
        assert other.state is not first.state
        assert other.lineage is not first.lineage


@pytest.mark.parametrize(("name", "mixture"), [("bayes", "2 s later"), ("paper", None)])
def test_the_mixture_of_a_shared_fold_is_that_of_its_estimator(name, mixture):
    fold = SharedFold(estimator_named(name, load_scenario("paper-demo").mission))
    track = SimpleNamespace(later=lambda motion, time_s: f"{time_s:.0f} s later")
    assert fold.mixture(Descended(SimpleNamespace(track=track), object()), 2_000_000_000) == mixture


def test_agents_whose_states_have_been_forgotten_walk_together_again(counts, monkeypatch):
    """Before, the agents had two copies of equal states, and computed everything twice to the end of the flight."""
    monkeypatch.setattr("radron.sim.lockstep.sharing.MAX_SHARED_STEPS", 4)
    fold = SharedFold(estimator_named("bayes", load_scenario("paper-demo").mission))

    def walked(state, numbers):
        for number in numbers:
            at = number * 100_000_000
            one = replace(counts, stamp_ns=at, identity=counts.identity._replace(sequence=number))
            state = fold.step(state, GridStep(number, at, at + 100_000_000), [one])
        return state

    first = walked(fold.initial(None), range(10, 20))
    second = walked(fold.initial(None), range(10, 19))
    assert walked(second, [19]).lineage is first.lineage  # the second has a state of its own
    computed = Counter()
    step = BayesEstimator.step
    monkeypatch.setattr(BayesEstimator, "step", lambda *args: computed.update("s") or step(*args))
    assert walked(second, range(19, 22)).state is walked(first, range(20, 22)).state
    assert computed["s"] <= 3


def test_results_are_bounded_and_those_in_use_stay():
    results, computed = Results(10), []

    def compute(value):
        computed.append(value)
        return value

    for value in range(30):
        results.get(value, lambda value=value: compute(value))
        results.get(0, lambda: compute(0))
    assert computed == list(range(30))
    results.get(10, lambda: compute(-1))
    assert computed[-1] == -1
    results.get(("another", 0), lambda: compute(-2))
    assert computed[-1] == -2


def test_what_is_remembered_for_others_is_no_memory_of_an_agent(counts):
    mission = load_scenario("paper-demo").mission
    fold = SharedFold(estimator_named("bayes", mission))
    before = bytes_of(fold)
    step = GridStep(10, 1_000_000_000, 1_100_000_000)
    first = fold.step(fold.initial(None), step, [counts])
    assert bytes_of(first) > 100_000
    assert bytes_of(fold) < before + 10_000
