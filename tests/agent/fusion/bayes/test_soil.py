"""The count rates that the estimator expects over soil, against a simulated camera over it, with a transport code of its own."""

import msgspec
import numpy as np
import pytest

from radron.agent.config.estimators import FusionConfig
from radron.agent.config.mission import DetectionConfig
from radron.agent.config.section import content_of
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.fusion.bayes.response import REFERENCE_BQ, RESPONSES, response_of
from radron.agent.fusion.bayes.soil import IMAGE_DEPTH, SOIL
from radron.agent.fusion.facing import Facing

camera = pytest.importorskip("radron.sim.radiation.camera")
truth = pytest.importorskip("radron.sim.radiation.truth")

LIVE_S = 4.0
EVENTS_PS = 3000.0
OVER_SOIL = truth.CameraTruth(scatter_near=0.05, background_hits_per_s=0.3)


def counts(height_m: float, horizontal_m: float, heading_deg: float, source_m: float = 0.0):
    """(2,) counted by a camera at a height, a source at a horizontal distance and above the ground, and expected."""
    response = response_of("Cs-137", "soil")
    distance, image = np.hypot([height_m - source_m, height_m + IMAGE_DEPTH * source_m], horizontal_m)
    level, turn = horizontal_m / distance, np.deg2rad(heading_deg)
    towards = (float(level * np.sin(turn)), -float((height_m - source_m) / distance), float(level * np.cos(turn)))
    activity_bq = REFERENCE_BQ * EVENTS_PS / 60.0 / float(response.flux(distance))  # 60 mm2 for all hits, about
    view = camera.SourceView(towards, distance, activity_bq, camera_m=height_m, source_m=source_m)
    seen = camera.Camera(OVER_SOIL, "Cs-137", np.random.default_rng(3), 0, truth.GroundTruth())
    chain = DetectorChain(DetectionConfig(), "Cs-137", Calibration.nominal())
    found = [chain.process(seen.expose(k * 10**7, (k + 1) * 10**7, [view], height_m)) for k in range(round(100 * LIVE_S))]
    told = np.array([(one.hits, one.photopeak, one.coincidences) for one in found], dtype=np.float64).sum(axis=0)
    fluence = response.flux(distance) * (activity_bq / REFERENCE_BQ * LIVE_S)
    way = np.array(towards[2]), np.array(-towards[0])
    facing, turned = (Facing.of(*way, np.array(one / distance), 1.0, 0.0).cosine() for one in (distance, image))
    steepness = np.array((height_m + IMAGE_DEPTH * source_m) / image)
    by_soil = response.over_soil.by_soil(fluence * (distance / image) ** 2, steepness, turned)
    expected = sum(response.parts(fluence, distance, facing, by_soil)) + response.background_ps * LIVE_S
    return response.apart(told), expected


@pytest.mark.parametrize(
    ("height_m", "horizontal_m", "heading_deg", "source_m"),
    [
        (2.5, 4.0, 0.0, 0.0),
        (2.5, 8.0, 30.0, 0.0),
        (4.0, 4.0, 60.0, 0.0),
        (4.0, 10.0, 0.0, 0.0),
        (4.0, 10.0, 75.0, 0.0),
        (6.0, 12.0, 20.0, 0.0),
        (3.0, 15.0, 45.0, 0.0),
        (3.0, 3.0, 30.0, 1.0),  # soil scatters 0.4 times as much as from a source on the ground
        (2.5, 6.0, 0.0, 1.0),
        (4.0, 2.0, 60.0, 1.0),
        (3.0, 6.0, 90.0, 1.0),
        (3.0, 12.0, 45.0, 0.5),
    ],
)
def test_counts_over_soil(height_m, horizontal_m, heading_deg, source_m):
    """Without soil, the sum is expected to be less than half; without the image, up to twice as large for the raised ones."""
    counted, expected = counts(height_m, horizontal_m, heading_deg, source_m)
    print(height_m, horizontal_m, heading_deg, source_m, counted / expected)
    assert counted[0] == pytest.approx(expected[0], rel=0.12)
    assert counted[1] == pytest.approx(expected[1], rel=0.15)  # three sigmas of 500 events


def test_a_search_and_a_track_expect_the_same_in_the_mean_over_the_heading():
    response = response_of("Cs-137", "soil")
    distance, steep = np.array([4.0, 12.0]), np.array([0.7, 0.3])
    whole = response.signal(np.ones(2), distance, steep)
    facing = np.full(2, 0.565)
    direct, scattered = response.parts(np.ones(2), distance, facing, response.over_soil.by_soil(np.ones(2), steep, facing))
    assert whole == pytest.approx(direct + scattered, rel=0.04)  # ``edge`` has another mean of f


def test_every_nuclide_is_known_over_soil_and_counts_more_there():
    assert set(SOIL) == set(RESPONSES)
    for nuclide in RESPONSES:
        bare, over = response_of(nuclide), response_of(nuclide, "soil")
        one, distance = np.array(1.0), np.array(5.0)
        ratio = over.signal(one, distance, np.array(0.6)) / bare.signal(one, distance)
        assert 1.5 < ratio[0] < 4.5
        assert 0.85 < ratio[1] < 1.2
        assert (over.background_ps > bare.background_ps).all()
        assert bare.over_soil is None


def test_the_slope_is_the_derivative_of_what_soil_scatters():
    soil, way, step = response_of("Cs-137", "soil").over_soil, np.array([4.0, -2.0, -3.0]), 1e-5

    def logarithm(image):
        distance = np.sqrt(image @ image)
        return np.log(soil.by_soil(1.0 / distance**2, np.array(-image[2] / distance), 0.565).sum())

    distance = np.sqrt(way @ way)
    slope = soil.slope(way, np.array(distance), np.array(3.0 / distance))
    assert slope == pytest.approx([(logarithm(way + step * axis) - logarithm(way)) / step for axis in np.eye(3)], abs=2e-3)


def test_a_mission_without_soil_keeps_its_id():
    assert "ground" not in content_of(FusionConfig())
    assert content_of(FusionConfig(ground="soil"))["ground"] == "soil"
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"ground": "lava"}, FusionConfig)
