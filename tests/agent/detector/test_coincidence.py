import pytest

from radron.agent.detector.clustering import Cluster
from radron.agent.detector.coincidence import events_of, merge_satellites


def cluster(tick, energy, pixels, x, y=0.0):
    return Cluster(tick, energy, pixels, x, y, delay=5.0)


def test_events_are_chained_within_the_window():
    clusters = [cluster(0, 100, 5, 0.0), cluster(60, 200, 6, 3.0), cluster(120, 300, 6, -3.0), cluster(300, 50, 3, 0.0)]
    assert events_of(clusters, 64.0) == [clusters[:3], clusters[3:]]
    assert events_of([], 64.0) == []


def test_a_satellite_returns_to_its_parent():
    (merged,) = merge_satellites([cluster(10, 23.2, 2, 0.1), cluster(12, 635.0, 20, 0.0)])
    assert merged.energy_kev == pytest.approx(658.2)
    assert merged.pixels == 22
    assert merged.x_mm == 0.0  # the parent's place
    assert merged.tick == 10  # the earliest time
    assert merged.tick + merged.delay == 12 + 5  # the parent's mean time of arrival


def test_satellites_of_a_coincidence_leave_two_clusters():
    event = [cluster(0, 27.0, 1, 5.15), cluster(1, 250.0, 9, 5.0), cluster(30, 23.0, 1, -5.0, -0.1), cluster(31, 361.0, 12, -5.0)]
    assert [one.energy_kev for one in merge_satellites(event)] == [277.0, 384.0]


def test_two_satellites_of_each_other_end_in_the_largest():
    event = [cluster(0, 23.0, 1, 0.2), cluster(1, 27.0, 2, 0.1), cluster(2, 600.0, 20, 0.0)]
    assert [one.energy_kev for one in merge_satellites(event)] == [650.0]


def test_a_satellite_may_reach_its_parent_by_way_of_another():
    event = [cluster(0, 23.0, 1, 1.8), cluster(1, 27.0, 2, 1.0), cluster(2, 600.0, 20, 0.0)]
    assert [one.energy_kev for one in merge_satellites(event)] == [650.0]


@pytest.mark.parametrize(
    "other",
    [cluster(0, 25.0, 2, 3.0), cluster(0, 60.0, 2, 0.2), cluster(0, 25.0, 12, 0.2)],
    ids=["too far", "too strong", "too long"],
)
def test_what_is_no_satellite_stays(other):
    event = [other, cluster(1, 600.0, 20, 0.0)]
    assert merge_satellites(event) == event


def test_a_pile_up_is_left_alone():
    event = [cluster(0, 25.0, 1, 0.2)] + [cluster(i, 300.0, 9, 0.0) for i in range(1, 12)]
    assert merge_satellites(event) == event


def test_order_by_time_holds_after_merging():
    merged = merge_satellites([cluster(0, 25.0, 1, 0.2), cluster(5, 100.0, 4, 5.0), cluster(20, 300.0, 9, 0.0)])
    assert [(one.tick, one.energy_kev) for one in merged] == [(0, 325.0), (5, 100.0)]
