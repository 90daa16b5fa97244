import numpy as np
import pytest

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.clustering import Cluster, Clusters
from radron.agent.detector.events import EventReader


def test_many_are_read_like_few():
    rng = np.random.default_rng(4)
    count = 400
    clusters = Clusters(
        np.sort(rng.integers(0, 40_000, count)),
        rng.uniform(5.0, 700.0, count),
        rng.integers(1, 20, count),
        rng.uniform(-7.0, 7.0, count),
        rng.uniform(-7.0, 7.0, count),
        rng.uniform(0.0, 40.0, count),
        rng.random(count) < 0.1,
    )
    energies: dict[str, list[float]] = {"few": [], "many": []}
    few = EventReader(DetectionConfig(), "Cs-137", energies["few"].extend).read_few(clusters.each(), 99)
    many = EventReader(DetectionConfig(), "Cs-137", energies["many"].extend).read_many(clusters, 99)
    assert (few.hits, few.photopeak, few.coincidences) == (many.hits, many.photopeak, many.coincidences)
    assert [cone.stamp_ns for cone in few.cones] == [cone.stamp_ns for cone in many.cones]
    assert len(few.cones) > 5
    np.testing.assert_allclose(sorted(energies["few"]), sorted(energies["many"]))
    alone = clusters.energy_kev[~clusters.saturated].sum()
    assert 0.8 * alone < sum(energies["few"]) <= alone  # without events with a saturated cluster


def test_the_nearest_of_several_lines_counts():
    reader = EventReader(DetectionConfig(energy_window=0.2), "Co-60")
    for energy, line in ((1170.0, 1173.23), (1260.0, 1332.49), (1245.0, 1173.23), (1590.0, 1332.49)):
        found = reader._windows.line_of(energy)
        assert found is not None
        assert found.energy_kev == line
    assert reader._windows.line_of(930.0) is None
    assert reader._windows.line_of(1605.0) is None


def test_an_event_with_a_full_counter_is_counted_without_energy() -> None:
    energies: list[float] = []
    reader = EventReader(DetectionConfig(), "Cs-137", energies.extend)
    full = Cluster(100, 277.0, 6, 0.0, 0.0, 5.0, saturated=True)
    other = Cluster(130, 384.66, 6, 3.0, 0.0, 5.0)
    tally = reader.read_few([full, other, Cluster(50_000, 661.66, 9, 0.0, 0.0, 5.0, saturated=True)], 0)
    assert (tally.hits, tally.coincidences, tally.photopeak, tally.cones, energies) == (3, 1, 0, [], [])
    whole = reader.read_few([full._replace(saturated=False), other], 0)
    assert (whole.hits, whole.coincidences, whole.photopeak, len(whole.cones)) == (2, 1, 1, 1)


def test_the_depth_between_two_clusters_follows_from_thickness_and_drift_time() -> None:
    """6 ticks of 1.5625 ns are 0.484 of 19.35 ns: 0.484 mm in a sensor of 1 mm; 20 ticks are beyond its thickness."""
    reader = EventReader(DetectionConfig(), "Cs-137", thickness_mm=1.0, drift_ns=19.35)
    for ticks, depth_mm in ((6, 0.4845), (20, 1.0)):
        electron = Cluster(100 + ticks, 277.0, 6, 0.0, 0.0, 0.0, saturated=False)
        (cone,) = reader.read_few([Cluster(100, 384.66, 6, 3.0, 0.0, 0.0, saturated=False), electron], 0).cones
        assert cone.separation_mm == pytest.approx(np.hypot(3.0, depth_mm), abs=1e-3)
