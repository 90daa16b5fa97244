import numpy as np
import pytest

from agent.config.mission import DetectionConfig
from agent.detector.clustering import Clusters
from agent.detector.events import EventReader


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
    )
    energies: dict[str, list[float]] = {"few": [], "many": []}
    few = EventReader(DetectionConfig(), "Cs-137", energies["few"].extend).read_few(clusters.each(), 99)
    many = EventReader(DetectionConfig(), "Cs-137", energies["many"].extend).read_many(clusters, 99)
    assert (few.hits, few.photopeak, few.coincidences) == (many.hits, many.photopeak, many.coincidences)
    assert [cone.stamp_ns for cone in few.cones] == [cone.stamp_ns for cone in many.cones]
    assert len(few.cones) > 5
    np.testing.assert_allclose(sorted(energies["few"]), sorted(energies["many"]))
    assert sum(energies["few"]) == pytest.approx(clusters.energy_kev.sum())


def test_the_nearest_of_several_lines_counts():
    reader = EventReader(DetectionConfig(energy_window=0.2), "Co-60")
    for energy, line in ((1170.0, 1173.23), (1260.0, 1332.49), (1245.0, 1173.23), (1590.0, 1332.49)):
        found = reader._windows.line_of(energy)
        assert found is not None
        assert found.energy_kev == line
    assert reader._windows.line_of(930.0) is None
    assert reader._windows.line_of(1605.0) is None
