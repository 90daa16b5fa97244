"""Measurements of a vehicle with an uncertain position, beside vehicles with certain ones."""

import math

import numpy as np
import pytest

from radron.agent.fusion.bayes.doubted import DOUBT_WINDOW_NS, MAX_DISTANCE_SIGMA_M, of_counting
from radron.agent.fusion.bayes.motion import BIAS
from support.flights.bayes import SOURCE, errors_of, flown, fusion_of, hypotheses


def test_who_does_not_know_its_place_moves_nothing_while_others_do(kit):
    """Half of the circle off, as by a clock that is 6 s ahead, and published so: it pulled the track along."""
    mission = kit.mission_of()
    entries = flown(kit, mission, of="c", since_s=40.0, until_s=65.0, sigma_m=20.0, off_m=(14.0, -18.0))
    without = [entry for entry in entries if not (entry.drone == "c" and 40.0 <= (entry.stamp_ns - kit.T0_NS) * 1e-9 < 65.0)]
    (end_s, found), (_, expected) = hypotheses(kit, mission, entries, 64.0)[-1], hypotheses(kit, mission, without, 64.0)[-1]
    assert end_s > 62.0
    assert found.cones == expected.cones
    assert found.position == pytest.approx(expected.position, abs=1e-3)  # predicted in other steps
    assert found.sight_of("a").covariance == pytest.approx(expected.sight_of("a").covariance, abs=1e-3)
    assert np.linalg.norm(errors_of([(end_s, found)], lambda _: SOURCE)) < 0.5


def test_who_does_not_know_its_place_counts_where_nobody_else_does(kit):
    """As where the clocks of a swarm split into halves: else nothing would be left."""
    mission = kit.mission_of()
    entries = flown(kit, mission, of="abc", since_s=0.0, until_s=math.inf, sigma_m=MAX_DISTANCE_SIGMA_M + 0.1)
    assert hypotheses(kit, mission, entries, 70.0)[-1][1].cones > 20


def test_a_place_that_is_doubted_does_not_end_a_track_when_others_are_heard_again(kit):
    """While it was alone it counted, and its position uncertainty is part of the track since then."""
    mission = kit.mission_of()
    entries = flown(kit, mission, of="c", since_s=40.0, until_s=65.0, sigma_m=20.0)
    gap = [entry for entry in entries if entry.drone == "c" or not 42.0 <= (entry.stamp_ns - kit.T0_NS) * 1e-9 < 49.0]
    found = hypotheses(kit, mission, gap, 64.0)
    assert len([time_s for time_s, _ in found if time_s > 52.0]) >= 23  # twice a second
    assert np.linalg.norm(errors_of(found[-1:], lambda _: SOURCE)) < 0.5


def test_the_order_of_arrival_leaves_no_trace(kit):
    mission = kit.mission_of()
    entries = flown(kit, mission, of="c", since_s=20.0, until_s=30.0, sigma_m=20.0, off_m=(9.0, 0.0), seconds=40.0)
    found = []
    for shuffled in (sorted(entries, key=lambda entry: entry.entry_id), sorted(entries, key=lambda entry: entry.stamp_ns)[::-1]):
        fusion = fusion_of(mission)
        kit.feed(fusion, shuffled)
        found.append(kit.settle(fusion, kit.T0_NS + 41_000_000_000))
    assert kit.same_bits(*found)


@pytest.mark.parametrize(
    ("later_ns", "kept"), [(0, [True, False]), (DOUBT_WINDOW_NS, [True, False]), (DOUBT_WINDOW_NS + 1, [True, True])]
)
def test_the_doubt_of_a_vehicle_counts_once_no_other_is_heard(later_ns, kept):
    variance = np.tile([0.0, 0.0, 0.1, 0.1], 2)
    variance[[0, 1]], variance[[BIAS, BIAS + 1]] = 0.5, 200.0
    counting = of_counting(variance, {0: 7, 1: 3}, 7 + later_ns)
    assert counting.reshape(2, BIAS).any(axis=1).tolist() == kept
