"""Contaminated ground by ordinary detectors, with counts of the simulation's own transport."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.config.drone import DetectorConfig
from radron.agent.config.loading import with_files
from radron.agent.config.mission import DroneInMission
from radron.agent.detector.channels import Channels
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import ConfigError
from radron.agent.fusion.field.detectors import detector_of
from radron.agent.fusion.field.estimator import FieldEstimator
from radron.agent.fusion.field.grid import Grid
from radron.agent.fusion.field.kernel import backgrounds, kernels_of
from radron.agent.fusion.field.sums import Sums, rows_of
from radron.sim.radiation.camera import SourceView
from radron.sim.radiation.crystal.emulated import DEVICE_STEP_KEV, Ordinary, OrdinaryTruth
from radron.sim.radiation.truth import GroundTruth

STEP_S = 0.5
PATCH = (10.0, 30.0)  # of east and north, m
POINT_M = 2.0
BQ_M2 = 200e3


def mission_with(lawn, *responses, detector="spectrum"):
    drones = tuple(
        DroneInMission(id=name, detector=detector if response else "minipix", response=response)
        for name, response in zip("ab", responses, strict=True)
    )
    return with_files(replace(lawn.mission_of(), drones=drones), Path())


def view(place, point, activity_bqm2):
    distance_m = math.dist(place, (*point, 0.0))
    return SourceView((0.0, 0.0, -1.0), distance_m, activity_bqm2 * POINT_M**2, camera_m=place[2])


def survey(lawn, mission, activity_bqm2):
    """Observations of two ordinary detectors over a square patch, made of points."""
    line = np.arange(PATCH[0] + POINT_M / 2, PATCH[1], POINT_M)
    points = [(x, y) for x in line for y in line]
    found = []
    for drone, way in zip("ab", lawn.lanes(3.0, 1, 8.0), strict=True):
        truth = Ordinary(
            OrdinaryTruth(detector=mission.member(drone).response),
            ["Cs-137"],
            np.random.default_rng(ord(drone)),
            0,
            GroundTruth(),
        )
        channels = Channels(DetectorConfig(energy_kev=(0.0, DEVICE_STEP_KEV)), mission.table(drone))
        for number, place in enumerate(way):
            views = [view(place, point, activity_bqm2) for point in points]
            readout = truth.expose(0, round(STEP_S * 1e9), views if activity_bqm2 else [], place[2])
            bins = channels.detections(Readout(0, round(STEP_S * 1e9), 0, STEP_S, PixelHits.none(), counts=readout.counts)).bins
            one = lawn.observation(drone, number, place, (sum(bins), 0), (number + 1) * STEP_S)
            found.append(replace(one, bins=bins))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("responses", [("nai-2x2", "nai-2x2"), ("nai-2x2", "csi-1cm3")])
def test_patch_is_mapped_by_ordinary_detectors(lawn, responses):
    mission = mission_with(lawn, *responses)
    estimator = FieldEstimator(mission, Polygon(mission.area.polygon_m))
    state = lawn.folded(estimator, survey(lawn, mission, BQ_M2))
    found = state.newest.contamination
    total = BQ_M2 * (PATCH[1] - PATCH[0]) ** 2
    assert found.total_bq.low < total < found.total_bq.high
    if len(set(responses)) == 1:  # a crystal of 1 cm3 over half of the area leaves the total uncertain by 40 %
        assert found.total_bq.median == pytest.approx(total, rel=0.2)  # two transports and soils: 12 %
    x, y, _ = found.highest_m
    assert PATCH[0] < x < PATCH[1]
    assert PATCH[0] < y < PATCH[1]


def test_kernels_of_a_mixed_swarm_are_those_of_each_kind(lawn):
    mission = mission_with(lawn, "nai-2x2", None)
    mixed, sodium, camera = (
        detector_of(mission),
        detector_of(mission_with(lawn, "nai-2x2", "nai-2x2")),
        detector_of(lawn.mission_of()),
    )
    estimator = FieldEstimator(mission, Polygon(mission.area.polygon_m))
    numbers, height = {"a": 0, "b": 1}, lambda one: one.position[2]
    places = [(5.0 * k, 12.0, 3.0) for k in range(4)]
    observations = [replace(lawn.observation("a", k, place, (64, 0), 1.0), bins=(1,) * 64) for k, place in enumerate(places)]
    observations += [lawn.observation("b", k, place, (6, 1), 1.0) for k, place in enumerate(places)]
    assert all(map(mixed.fits, observations))
    sums = Sums.none(2).plus(rows_of(observations, numbers, height, mixed.counted))
    heights, grid = np.full(len(sums), 3.0), Grid.around(Polygon(mission.area.polygon_m))
    found = kernels_of(sums, heights, grid, mixed)
    for number, kind in enumerate((sodium, camera)):
        own = sums.drone == number
        alone = kernels_of(Sums(sums.table[own]), heights[own], grid, kind)
        assert np.array_equal(found.direct[own], alone.direct)
        assert np.array_equal(found.scattered[own], alone.scattered)
        assert np.array_equal(found.beyond[:, own], alone.beyond)
        assert np.array_equal(backgrounds(mixed, sums.drone)[own], np.tile(kind.background_ps, (int(own.sum()), 1)))
    assert estimator.initial(None).sums.counts.shape == (0, 2)


def test_camera_exposures_do_not_count_for_ordinary_detectors_nor_the_other_way(lawn):
    mission = mission_with(lawn, "nai-2x2", "nai-2x2")
    exposure = lawn.observation("a", 1, (1.0, 1.0, 3.0), (5, 1), 0.5)
    assert not detector_of(mission).fits(exposure)
    assert detector_of(mission).fits(replace(exposure, bins=(1,) * 64))
    assert detector_of(lawn.mission_of()).fits(exposure)
    assert not detector_of(lawn.mission_of()).fits(replace(exposure, bins=(1,) * 64))


def test_detectors_that_cannot_be_mapped_are_refused(lawn):
    mission = mission_with(lawn, "nai-2x2", "nai-2x2")
    with pytest.raises(ConfigError, match=r"fusion\.ground: ordinary detectors need 'soil'"):
        detector_of(replace(mission, fusion=replace(mission.fusion, ground="none")))
