"""The estimator on synthetic flights: its results, and their dependence on nothing but the log."""

import random

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.errors import ConfigError
from radron.agent.fusion.estimator import GridStep
from radron.agent.fusion.registry import estimator_named
from radron.agent.fusion.sources.data import Rows
from radron.agent.fusion.sources.estimator import _strongest_first
from radron.agent.fusion.sources.fit import Fitted
from radron.agent.fusion.sources.handover import FollowingState
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.state import SourcesState
from support.flights.fusions import fusion_of

TWO = [("Cs-137", 12.0, 20.0, 6e8), ("Ir-192", 30.0, 15.0, 1e9)]


def after(kit, mission, entries, seconds):
    fusion = fusion_of(mission)
    assert all(kit.feed(fusion, entries))
    return kit.settle(fusion, kit.T0_NS + round(seconds * 1e9))


def sources_of(hypothesis):
    return [hypothesis, *hypothesis.others]


@pytest.fixture(scope="module")
def flight(among):
    mission = among.mission_of()
    return mission, among.entries_of(mission, np.random.default_rng(2), 30.0, TWO)


def test_two_sources_of_unknown_nuclides_are_found(kit, flight):
    """Each coordinate within four standard deviations, or 5 cm more: positions are drawn as measured, without error."""
    hypothesis = after(kit, *flight, 32.0)
    found = sources_of(hypothesis)
    assert [one.nuclide for one in found] == ["Ir-192", "Cs-137"]  # the stronger one first
    assert hypothesis.evidence > 10.0
    for one, (_, x, y, becquerel) in zip(found, reversed(TWO), strict=True):
        sigma_m = np.sqrt(np.diag(one.covariance)[:2])
        assert np.all(np.abs(one.position[:2] - (x, y)) < 4.0 * sigma_m + 0.05)
        assert one.activity_bq == pytest.approx(becquerel, abs=4.0 * one.activity_sigma_bq)
        assert one.rms_m < 1.0
        assert 0.0 < one.watched_s < 60.0  # of two cameras for half a minute, within 13 m of it


@pytest.mark.parametrize("activity_bq", [(1e9, 1e9), (1e9, 1e6)])
def test_limits_of_activity_in_the_wrong_order_are_one_clear_line(among, activity_bq):
    mission = among.mission_of()
    fusion = replace(mission.fusion, sources=replace(mission.fusion.sources, activity_bq=activity_bq))
    with pytest.raises(ConfigError, match=r"fusion\.sources\.activity_bq: 1e\+09 is not less than"):
        estimator_named("sources", replace(mission, fusion=fusion))


def test_nothing_is_found_where_nothing_is(kit, among):
    mission = among.mission_of()
    assert after(kit, mission, among.entries_of(mission, np.random.default_rng(3), 30.0, []), 32.0) is None


def test_the_order_of_arrival_does_not_matter(kit, flight):
    """All at once, as to a late joiner, and mixed up in parts with the fusion advancing in between."""
    mission, entries = flight
    mixed = random.Random(1).sample(entries, len(entries))
    fusion = fusion_of(mission)
    part = len(mixed) // 4 + 1
    for number, start in enumerate(range(0, len(mixed), part)):
        kit.feed(fusion, mixed[start : start + part])
        fusion.advance(kit.T0_NS + round(8e9 * number))
    late = kit.settle(fusion, kit.T0_NS + 32_000_000_000)
    in_order = after(kit, mission, sorted(entries, key=lambda entry: entry.entry_id), 32.0)
    assert len(sources_of(late)) == len(sources_of(in_order)) == 2
    assert all(kit.same_bits(*both) for both in zip(sources_of(late), sources_of(in_order), strict=True))
    assert late.evidence == in_order.evidence


def test_entries_on_the_way_do_not_move_the_solution_between_its_times(kit, flight):
    mission, entries = flight
    fusion = fusion_of(mission)
    kit.feed(fusion, entries)
    places = []
    for time_s in (20.3, 21.9, 22.9):  # fits at 20 and 22, and by then with what came before
        fusion.advance(kit.T0_NS + round(time_s * 1e9))
        places.append(kit.settle(fusion, kit.T0_NS + round(time_s * 1e9)).position.tobytes())
    assert places[0] == places[1] != places[2]


def test_each_drone_sees_the_source_with_its_own_error(kit, among):
    """Two drones' source positions differ by their biases: each coordinate to three of its sigmas, 0.3 m."""
    mission = among.mission_of()
    bias = ((0.0, 0.0), (1.5, -1.2))
    entries = among.entries_of(mission, np.random.default_rng(4), 40.0, [("Cs-137", 20.0, 20.0, 3e9)], bias=bias)
    entries = [_with_sigma(entry, 2.1) for entry in entries]
    hypothesis = after(kit, mission, entries, 42.0)
    apart = hypothesis.sight_of("b").position - hypothesis.sight_of("a").position
    assert apart[:2] == pytest.approx(bias[1], abs=1.0)
    assert hypothesis.sight_of("a").rms_m < hypothesis.rms_m


def _with_sigma(entry, sigma_m):
    name = "apex_sigma_m" if hasattr(entry, "apex_sigma_m") else "position_sigma_m"
    return replace(entry, **{name: sigma_m})


def test_candidates_that_nobody_knows_are_refused(kit, among):
    with pytest.raises(ConfigError, match=r"nuclide 'K-40': estimator 'sources' does not know .*; it knows Am-241, "):
        estimator_named("sources", among.mission_of(nuclides=("Cs-137", "K-40")))


@pytest.mark.parametrize(("second", "first_place"), [(1.9, 1.0), (2.1, 2.0)])
def test_the_swarm_stays_with_a_source_until_another_is_twice_as_strong(second, first_place):
    solution = Solution((0, 1), np.array([(1.0, 1.0), (2.0, 2.0)]), np.log([1.0, second]), 0.0, np.zeros((1, 3)))
    covariance = np.diag(np.arange(10.0))
    fitted = _strongest_first(Fitted(solution, 0.0, covariance, 0.0))
    assert fitted.solution.place[0, 0] == first_place
    assert fitted.covariance[0, 0] == (0.0 if first_place == 1.0 else 3.0)


def test_a_source_that_is_told_first_because_the_strongest_is_not_known_well_has_the_evidence(kit, among):
    """By the evidence the flight knows that the stated errors can be relied on."""
    estimator = estimator_named("sources", among.mission_of(drones=("a",)))
    solution = Solution((0, 1), np.array([(1.0, 1.0), (2.0, 2.0)]), np.log([2.0, 1.0]), 0.0, np.zeros((1, 3)))
    covariance = np.diag([100.0, 100.0, *np.full(8, 0.01)])
    rest = SourcesState(fitted=Fitted(solution, 0.0, covariance, 25.0), none=5.0, x0_stamp_ns=kit.T0_NS)
    told = estimator.hypothesis(FollowingState(rest), GridStep(1, kit.T0_NS, kit.T0_NS + 1))
    assert (told.position[0], told.evidence, told.others) == (2.0, 20.0, ())


def test_steps_without_a_new_fit_tell_the_same_sources_at_their_own_times(kit, among):
    estimator = estimator_named("sources", among.mission_of(drones=("a",)))
    solution = Solution((0,), np.array([(1.0, 1.0)]), np.zeros(1), 0.0, np.zeros((1, 3)))
    rest = SourcesState(fitted=Fitted(solution, 0.0, 0.01 * np.eye(7), 25.0), x0_stamp_ns=kit.T0_NS)
    steps = [GridStep(k, kit.T0_NS + k * 10, kit.T0_NS + k * 10 + 10) for k in range(2)]
    first, second = (estimator.hypothesis(FollowingState(rest), step) for step in steps)
    assert first.sights is second.sights
    assert second.stamp_ns - first.stamp_ns == 10


def test_an_agent_that_catches_up_refines_once_and_tells_the_same(kit, flight):
    """One agent is asked at every step, the other only at the end."""
    mission, entries = flight
    asked, late = Asked(estimator_named("sources", mission)), Asked(estimator_named("sources", mission))
    always, once = (fusion_of(mission, one.estimator) for one in (asked, late))
    in_time = sorted(entries, key=lambda entry: entry.stamp_ns)
    for half_s in range(58):  # the last moves at 25 s, refinements at 26 and 28
        now_ns = kit.T0_NS + half_s * 500_000_000
        kit.feed(always, [entry for entry in in_time if now_ns - 500_000_000 < entry.stamp_ns <= now_ns])
        told = kit.settle(always, now_ns)
    kit.feed(once, [entry for entry in in_time if entry.stamp_ns <= now_ns])
    assert all(kit.same_bits(*both) for both in zip(sources_of(told), sources_of(kit.settle(once, now_ns, 10**6)), strict=True))
    assert (asked.refinements > 5, late.refinements) == (True, 1)


class Asked:
    """Counts the refinements of an estimator."""

    def __init__(self, estimator):
        self.estimator, self.refinements = estimator, 0
        at_rest = estimator._at_rest
        self._refined, at_rest._refined = at_rest._refined, self.refined

    def refined(self, state):
        self.refinements += 1
        return self._refined(state)


def test_moves_are_computed_once_although_an_observation_of_their_step_comes_late(kit, flight):
    """And again from another state."""
    mission, entries = flight
    fusion = fusion_of(mission)
    kit.feed(fusion, entries)
    kit.settle(fusion, kit.T0_NS + 29_000_000_000)
    late_ns = kit.T0_NS + 31_000_000_000
    step = GridStep(late_ns // 500_000_000, late_ns, late_ns + 500_000_000)
    estimator, state = fusion.estimator, fusion.state
    late = state.rest.pending[-1]
    without, with_late = (estimator.step(state, step, observations).rest for observations in ((), (late,)))
    assert without.moved > state.rest.moved
    assert with_late.fitted is without.fitted
    assert with_late.pending == (late,)
    other = replace(state, rest=replace(state.rest, pending=state.rest.pending[:-1]))
    assert estimator.step(other, step, ()).rest.fitted is not without.fitted


def test_a_drone_alone_on_the_outermost_ring_watches_a_source_too(among):
    """Of three drones, which do not hear each other: 18 m away; a lane farther out is no watch."""
    estimator = estimator_named("sources", among.mission_of(drones=("a", "b", "c")))

    def watched_s(away_m):
        table = np.zeros((1, 40), np.int64)
        table[0, 4:8] = 10 * 10**9, round(1e3 * away_m) * 10 * 10**9, 0, 0
        return estimator._telling.watched_s(Rows(table), np.zeros(2))

    assert watched_s(6.0) == watched_s(12.5) == pytest.approx(10.0)
    assert 3.0 < watched_s(18.0) < 10.0
    assert watched_s(25.0) == 0.0
