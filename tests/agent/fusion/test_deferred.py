"""An estimator computed elsewhere returns the same hypotheses as in place, in any order of computation."""

import pickle
import random

import numpy as np
import pytest

from radron.agent.fusion import observations
from radron.agent.fusion.deferred import MAX_TASK_OBSERVATIONS, Deferred, Folder
from radron.agent.fusion.registry import deferred_named, estimator_named
from support.flights.fusions import fusion_of

MOST_IN_A_STEP = 20  # cones of the flight in one step of the grid


def sent(thing):
    """As it comes out on the other side of a pipe."""
    return pickle.loads(pickle.dumps(thing, protocol=pickle.HIGHEST_PROTOCOL))


class Elsewhere:
    """Computes at most one task in each call."""

    def __init__(self, fusion):
        self.fusion, self.deferred = fusion, fusion.estimator
        self.begin()

    def begin(self):
        """All that it held is gone."""
        self.folder = Folder(self.deferred.estimator)
        self.sizes, self.answers, self.begun = [], 0, None

    def work(self):
        task = self.deferred.next_task(self.folder.held, self.begun)
        if task is not None:
            self.sizes.append(sum(len(observations) for _, _, observations in task.links))
            told = self.folder.fold(sent(task))
            self.begun = task.question if told is None else None
            if told is not None:
                self.answers += 1
                self.fusion.answered(task.question, sent(told))

    def settle(self, now_ns):
        self.fusion.advance(now_ns)
        while self.fusion.pending:
            self.work()
            self.fusion.advance(now_ns)
        return self.fusion.hypothesis


@pytest.fixture(scope="module")
def cones(kit, mission):
    return kit.flight(mission, np.random.default_rng(5), 60.0, lambda _: (40.0, 60.0))


def in_place(kit, mission, cones, now_ns):
    fusion = fusion_of(mission, estimator_named("paper", mission))
    kit.feed(fusion, cones)
    return kit.settle(fusion, now_ns)


@pytest.mark.parametrize("seed", range(4))
def test_the_same_bits_in_whatever_order_entries_come_and_tasks_are_computed(kit, mission, cones, seed):
    rng = random.Random(seed)
    fusion = fusion_of(mission, Deferred(estimator_named("paper", mission)))
    elsewhere = Elsewhere(fusion)
    late = [cone for cone in cones if rng.random() < 0.2]
    for cone in sorted(cones, key=lambda cone: cone.stamp_ns + (rng.randrange(20_000_000_000) if cone in late else 0)):
        kit.feed(fusion, [cone])
        fusion.advance(max(cone.stamp_ns, kit.T0_NS))
        if rng.random() < 0.3:
            elsewhere.work()
        if rng.random() < 0.05:
            elsewhere.begin()
    for after_s in (60, 75, 50):
        now_ns = kit.T0_NS + after_s * 1_000_000_000
        assert kit.same_bits(elsewhere.settle(now_ns), in_place(kit, mission, cones, now_ns))


def test_the_older_hypothesis_serves_until_the_new_one_is_there(kit, mission, cones):
    fusion = fusion_of(mission, Deferred(estimator_named("paper", mission)))
    elsewhere = Elsewhere(fusion)
    half = len(cones) // 2
    kit.feed(fusion, cones[:half])
    older = elsewhere.settle(cones[half].stamp_ns)
    kit.feed(fusion, cones[half:])
    for after_s in (50, 60, 61):
        fusion.advance(kit.T0_NS + after_s * 1_000_000_000)
        assert fusion.hypothesis is older
        assert fusion.pending
    newer = elsewhere.settle(kit.T0_NS + 61_000_000_000)
    assert newer.stamp_ns > older.stamp_ns
    assert newer.cones > older.cones


def test_the_hypothesis_is_told_with_the_digest_of_the_log_that_it_follows_from(kit, mission, cones):
    fusion = fusion_of(mission, Deferred(estimator_named("paper", mission)))
    elsewhere = Elsewhere(fusion)
    half = len(cones) // 2
    kit.feed(fusion, cones[:half])
    elsewhere.settle(cones[half].stamp_ns)
    digest = fusion.digest
    assert fusion.hypothesis_digest == digest
    kit.feed(fusion, cones[half:])
    fusion.advance(kit.T0_NS + 60_000_000_000)
    assert fusion.hypothesis_digest == digest != fusion.digest
    elsewhere.settle(kit.T0_NS + 60_000_000_000)
    assert fusion.hypothesis_digest == fusion.digest


def test_old_observations_are_made_again_within_the_budget_of_a_call(kit, mission, cones, monkeypatch):
    monkeypatch.setattr(observations, "MAX_HELD_OBSERVATIONS", 16)
    made = []
    observe = observations.observe
    monkeypatch.setattr(observations, "observe", lambda *given: made.append(given) or observe(*given))
    fusion = fusion_of(mission, Deferred(estimator_named("paper", mission)))
    fusion.estimator.work = lambda *_: 0
    kit.feed(fusion, cones)
    most, calls = 0, 0
    while fusion.pending or not calls:
        made.clear()
        fusion.advance(kit.T0_NS + 60_000_000_000, budget=20)
        most, calls = max(most, len(made)), calls + 1
        if calls > 5 and not made:
            break
    assert 0 < most <= 20 + MOST_IN_A_STEP


def test_a_long_way_is_made_in_small_tasks(kit, mission, cones):
    fusion = fusion_of(mission, Deferred(estimator_named("paper", mission)))
    kit.feed(fusion, cones)
    elsewhere = Elsewhere(fusion)
    elsewhere.settle(kit.T0_NS + 60_000_000_000)
    assert sum(elsewhere.sizes) == len(cones) > MAX_TASK_OBSERVATIONS
    assert len(elsewhere.sizes) > 1
    assert max(elsewhere.sizes) <= MAX_TASK_OBSERVATIONS


def test_late_entries_that_keep_coming_keep_no_answer_back(kit, mission, cones):
    """Each changes a way of several tasks from its beginning on, and the next one comes before that way is made."""
    fusion = fusion_of(mission, Deferred(estimator_named("paper", mission)))
    late, rest = cones[:20], cones[20:]
    kit.feed(fusion, rest)
    elsewhere = Elsewhere(fusion)
    elsewhere.settle(kit.T0_NS + 60_000_000_000)
    elsewhere.sizes, elsewhere.answers = [], 0
    for number, cone in enumerate(late):
        kit.feed(fusion, [cone])
        for part in range(10):
            fusion.advance(kit.T0_NS + 61_000_000_000 + number * 1_000_000_000 + part * 100_000_000)
        elsewhere.work()
    assert len(elsewhere.sizes) == len(late)
    assert 5 <= elsewhere.answers < len(late)


def test_a_new_mission_begins_without_the_last_ones_hypothesis(kit, mission, cones):
    fusion = fusion_of(mission, Deferred(estimator_named("paper", mission)))
    kit.feed(fusion, cones)
    elsewhere = Elsewhere(fusion)
    assert elsewhere.settle(kit.T0_NS + 60_000_000_000) is not None
    fusion.start(kit.T0_NS + 300_000_000_000)
    fusion.advance(kit.T0_NS + 301_000_000_000)
    assert fusion.hypothesis is None
    assert elsewhere.settle(kit.T0_NS + 302_000_000_000) is None


def test_an_answer_that_comes_twice_or_too_late_changes_nothing(kit, mission, cones):
    fusion = fusion_of(mission, Deferred(estimator_named("paper", mission)))
    kit.feed(fusion, cones)
    folder = Folder(fusion.estimator.estimator)
    for after_s in (60, 61):
        fusion.advance(kit.T0_NS + after_s * 1_000_000_000)
    first, second = folder.answer(fusion.estimator, 1), folder.answer(fusion.estimator, 2)
    for question, told in ((2, second), (1, first), (2, second)):
        fusion.answered(question, told)
        fusion.advance(kit.T0_NS + 61_000_000_000)
        assert fusion.hypothesis is second.hypothesis


def test_only_a_slow_estimator_is_computed_elsewhere(kit, mission):
    assert isinstance(deferred_named("sources", mission), Deferred)
    assert not any(isinstance(deferred_named(name, mission), Deferred) for name in ("bayes", "paper"))
