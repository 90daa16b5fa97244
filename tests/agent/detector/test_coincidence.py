import numpy as np

from agent.detector.clustering import Clusters
from agent.detector.coincidence import group, merge_satellites

WINDOW = 64.0


def clusters(*rows):
    """(tick, energy, pixels, x, y) rows."""
    tick, energy, pixels, x, y = (np.array(column) for column in zip(*rows, strict=True))
    return Clusters(tick, energy.astype(float), pixels, x.astype(float), y.astype(float), np.full(len(tick), 5.0))


def test_events_are_chained_within_the_window():
    events = group(clusters((0, 100, 5, 0, 0), (60, 200, 6, 3, 0), (120, 300, 6, -3, 0), (300, 50, 3, 0, 0)), WINDOW)
    assert events.multiplicity.tolist() == [3, 1]
    assert events.first.tolist() == [0, 3]
    np.testing.assert_allclose(events.energy_kev, [600.0, 50.0])


def test_a_satellite_returns_to_its_parent():
    before = clusters((10, 23.2, 2, 0.1, 0.0), (12, 635.0, 20, 0.0, 0.0))
    merged = merge_satellites(before, WINDOW)
    assert merged.energy_kev.tolist() == [658.2]
    assert merged.pixels.tolist() == [22]
    assert merged.x_mm.tolist() == [0.0]  # the parent's place
    assert merged.tick.tolist() == [10]  # the earliest time
    assert merged.tick[0] + merged.delay[0] == 12 + 5  # the parent's mean time of arrival


def test_satellites_of_a_coincidence_leave_two_clusters():
    events = group(clusters((0, 27.0, 1, 5.15, 0), (1, 250.0, 9, 5, 0), (30, 23.0, 1, -5, -0.1), (31, 361.0, 12, -5, 0)), WINDOW)
    assert events.multiplicity.tolist() == [2]
    np.testing.assert_allclose(events.clusters.energy_kev, [277.0, 384.0])


def test_two_satellites_of_each_other_end_in_the_largest():
    merged = merge_satellites(clusters((0, 23.0, 1, 0.2, 0), (1, 27.0, 2, 0.1, 0), (2, 600.0, 20, 0, 0)), WINDOW)
    assert merged.energy_kev.tolist() == [650.0]


def test_what_is_no_satellite_stays():
    far = clusters((0, 25.0, 2, 3.0, 0), (1, 600.0, 20, 0, 0))
    strong = clusters((0, 60.0, 2, 0.2, 0), (1, 600.0, 20, 0, 0))
    long = clusters((0, 25.0, 12, 0.2, 0), (1, 600.0, 20, 0, 0))
    late = clusters((0, 25.0, 2, 0.2, 0), (100, 600.0, 20, 0, 0))
    for case in (far, strong, long, late):
        assert len(merge_satellites(case, WINDOW)) == 2


def test_order_by_time_holds_after_merging():
    merged = merge_satellites(
        clusters((0, 25.0, 1, 0.2, 0), (5, 100.0, 4, 5, 0), (20, 300.0, 9, 0, 0), (500, 80.0, 3, 0, 0)), WINDOW
    )
    assert merged.tick.tolist() == [0, 5, 500]
    np.testing.assert_allclose(merged.energy_kev, [325.0, 100.0, 80.0])


def test_nothing_in_nothing_out():
    empty = clusters((0, 10, 1, 0, 0)).take(np.zeros(1, bool))
    assert len(group(empty, WINDOW).first) == 0
