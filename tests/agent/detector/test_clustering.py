import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from radron.agent.detector.clustering import cluster_few, cluster_many
from radron.agent.detector.readout import SATURATED_TOT, PixelHits


def hits(rows):
    """(tick, column, row) rows -> sorted arrays."""
    rows = sorted(rows)
    tick = np.array([row[0] for row in rows], np.int64)
    index = np.array([256 * row[2] + row[1] for row in rows], np.uint16)
    return tick, index


def pixels(tick, index, tot=50):
    return PixelHits(tick, index, np.broadcast_to(np.uint16(tot), len(tick)))


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
    return label


def expected_clusters(tick, index, energy, gap):
    """Rows (tick, energy, pixels, x, y, delay) in order of time, from the definition."""
    label = np.array(brute_force(tick, index, gap))
    rows = []
    for first in sorted(set(label.tolist())):
        own = label == first
        weight = energy[own] / energy[own].sum()
        x = (weight @ (index[own] & 255) - 127.5) * 0.055
        y = (weight @ (index[own] >> 8) - 127.5) * 0.055
        rows.append((tick[first], energy[own].sum(), own.sum(), x, y, weight @ (tick[own] - tick[first])))
    return np.array(rows)


def as_rows(clusters):
    return np.array([tuple(cluster)[:-1] for cluster in clusters])


corner = st.sampled_from([0, 1, 2, 3, 253, 254, 255])
pixel = st.tuples(st.integers(0, 300), corner, corner)


@settings(max_examples=150)
@given(st.lists(pixel, min_size=1, max_size=14), st.sampled_from([0.0, 20.0, 64.0]))
def test_both_implementations_follow_the_definition(rows, gap):
    tick, index = hits(rows)
    energy = np.linspace(5.0, 60.0, len(tick))
    expected = expected_clusters(tick, index, energy, gap)
    np.testing.assert_allclose(as_rows(cluster_few(pixels(tick, index), energy, gap).each()), expected, atol=1e-9)
    np.testing.assert_allclose(as_rows(cluster_many(pixels(tick, index), energy, gap).each()), expected, atol=1e-9)


def test_both_implementations_agree_on_a_crowded_sensor():
    rng = np.random.default_rng(7)
    for density in (200, 3000):
        tick = np.sort(rng.integers(0, 20_000, density))
        index = rng.integers(0, 1024, density).astype(np.uint16)
        energy = rng.uniform(5.0, 60.0, density)
        few = as_rows(cluster_few(pixels(tick, index), energy, 64.0).each())
        many = as_rows(cluster_many(pixels(tick, index), energy, 64.0).each())
        assert len(few) < density
        np.testing.assert_allclose(few, many, atol=1e-9)


def test_properties_of_a_cluster():
    tick, index = hits([(100, 10, 20), (104, 11, 20), (102, 11, 21), (5000, 10, 20)])
    energy = np.array([30.0, 20.0, 50.0, 7.0])  # in the order of time
    clusters = cluster_few(pixels(tick, index), energy, 64.0)
    assert len(clusters) == 2
    assert clusters.tick.tolist() == [100, 5000]
    assert clusters.pixels.tolist() == [3, 1]
    np.testing.assert_allclose(clusters.energy_kev, [100.0, 7.0])
    column, row, delay = (30 * 10 + 70 * 11) / 100, (20 * 21 + 80 * 20) / 100, (20 * 2 + 50 * 4) / 100
    np.testing.assert_allclose(clusters.x_mm[0], (column - 127.5) * 0.055)
    np.testing.assert_allclose(clusters.y_mm[0], (row - 127.5) * 0.055)
    np.testing.assert_allclose(clusters.delay, [delay, 0.0])


def test_the_last_column_does_not_touch_the_first_of_the_next_row():
    tick, index = hits([(0, 255, 10), (1, 0, 11), (2, 0, 10), (3, 255, 11)])
    energy = np.array([1.0, 2.0, 4.0, 8.0])
    for cluster in (cluster_few, cluster_many):
        assert cluster(pixels(tick, index), energy, 64.0).energy_kev.tolist() == [9.0, 6.0]


def test_all_eight_neighbours_touch_whichever_comes_first():
    for column, row in ((9, 9), (10, 9), (11, 9), (9, 10), (11, 10), (9, 11), (10, 11), (11, 11)):
        for rows in ([(0, 10, 10), (1, column, row)], [(1, 10, 10), (0, column, row)]):
            tick, index = hits(rows)
            energy = np.array([1.0, 2.0])
            for cluster in (cluster_few, cluster_many):
                assert cluster(pixels(tick, index), energy, 64.0).pixels.tolist() == [2]


def test_a_cluster_with_a_full_counter_is_marked():
    tick, index = hits([(100, 10, 20), (104, 11, 20), (5000, 10, 20)])
    tot = np.array([50, SATURATED_TOT, 50], np.uint16)
    for cluster in (cluster_few, cluster_many):
        assert cluster(PixelHits(tick, index, tot), np.array([30.0, 600.0, 7.0]), 64.0).saturated.tolist() == [True, False]
