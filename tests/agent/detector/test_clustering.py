import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agent.detector.clustering import cluster, labels_of_few, labels_of_many


def hits(rows):
    """(tick, column, row) rows -> sorted arrays."""
    rows = sorted(rows)
    tick = np.array([row[0] for row in rows], np.int64)
    index = np.array([256 * row[2] + row[1] for row in rows], np.uint16)
    return tick, index


def brute_force(tick, index, gap):
    """Connected components of the definition itself, all pairs."""
    n = len(tick)
    label = list(range(n))
    column, row = index.astype(int) & 255, index.astype(int) >> 8
    for _ in range(n):
        for i in range(n):
            for j in range(n):
                if abs(row[i] - row[j]) <= 1 and abs(column[i] - column[j]) <= 1 and abs(tick[i] - tick[j]) <= gap:
                    label[i] = label[j] = min(label[i], label[j])
    order = {value: number for number, value in enumerate(dict.fromkeys(label))}
    return [order[value] for value in label]


corner = st.sampled_from([0, 1, 2, 3, 253, 254, 255])
pixel = st.tuples(st.integers(0, 300), corner, corner)


@settings(max_examples=150, deadline=None)
@given(st.lists(pixel, min_size=1, max_size=14), st.sampled_from([0.0, 20.0, 64.0]))
def test_both_implementations_follow_the_definition(rows, gap):
    tick, index = hits(rows)
    expected = brute_force(tick, index, gap)
    for labels in (labels_of_few, labels_of_many):
        label, count = labels(tick, index, gap)
        assert label.tolist() == expected, labels.__name__
        assert count == max(expected) + 1


def test_both_implementations_agree_on_a_crowded_sensor():
    rng = np.random.default_rng(7)
    for density in (200, 3000):
        tick = np.sort(rng.integers(0, 20_000, density))
        index = rng.integers(0, 1024, density).astype(np.uint16)
        few, count_few = labels_of_few(tick, index, 64.0)
        many, count_many = labels_of_many(tick, index, 64.0)
        assert count_few == count_many < density
        np.testing.assert_array_equal(few, many)


def test_properties_of_a_cluster():
    tick, index = hits([(100, 10, 20), (104, 11, 20), (102, 11, 21), (5000, 10, 20)])
    energy = np.array([30.0, 20.0, 50.0, 7.0])  # in the order of time
    clusters = cluster(tick, index, energy, 64.0)
    assert len(clusters) == 2
    assert clusters.tick.tolist() == [100, 5000]
    assert clusters.pixels.tolist() == [3, 1]
    np.testing.assert_allclose(clusters.energy_kev, [100.0, 7.0])
    column, row, delay = (30 * 10 + 70 * 11) / 100, (20 * 21 + 80 * 20) / 100, (20 * 2 + 50 * 4) / 100
    np.testing.assert_allclose(clusters.x_mm[0], (column - 127.5) * 0.055)
    np.testing.assert_allclose(clusters.y_mm[0], (row - 127.5) * 0.055)
    np.testing.assert_allclose(clusters.delay, [delay, 0.0])


@pytest.mark.parametrize("labels", [labels_of_few, labels_of_many])
def test_the_last_column_does_not_touch_the_first_of_the_next_row(labels):
    tick, index = hits([(0, 255, 10), (1, 0, 11), (2, 0, 10), (3, 255, 11)])
    label, count = labels(tick, index, 64.0)
    assert count == 2
    assert label.tolist() == [0, 1, 1, 0]
