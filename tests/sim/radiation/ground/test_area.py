"""Contaminated ground in a simulated camera, against an independent Monte Carlo and against point sources."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radron.sim.radiation.bank import bin_of
from radron.sim.radiation.camera import Camera, SourceView
from radron.sim.radiation.emission import Emission
from radron.sim.radiation.ground.area import AreaInCamera, AreaPose, AreaSource, AreaView, flux_by_angle
from radron.sim.radiation.ground.areafield import PLACES, area_field
from radron.sim.radiation.ground.bank import direction_of
from radron.sim.radiation.ground.field import point_field
from radron.sim.radiation.ground.photons import GROUPS
from radron.sim.radiation.ground.shares import isotropic_mm2
from radron.sim.radiation.individual import Individual
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.truth import CameraTruth, GroundTruth

QUIET = CameraTruth(background_hits_per_s=0.0, scatter_near=0.0, scatter_air=0.0)
SOIL = GroundTruth(natural=0.0)
AHEAD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # the camera looks to the north, its y axis down
TICKS = 400  # 625 ns


def square(side_m: float, cell_m: float, within_m: float = math.inf) -> AreaSource:
    """1 MBq/m2 of Cs-137 on a square around the origin, of the places within a distance of it."""
    axis = (np.arange(round(side_m / cell_m)) + 0.5) * cell_m - 0.5 * side_m
    x, y = (places.ravel() for places in np.meshgrid(axis, axis))
    kept = np.hypot(x, y) < within_m
    return AreaSource("Cs-137", x[kept], y[kept], np.full(int(kept.sum()), 1e6 * cell_m**2), cell_m)


def look(area: AreaSource, place: tuple[float, float, float], ground: GroundTruth = SOIL) -> AreaView:
    own = Individual(QUIET, np.random.default_rng(1))
    return AreaInCamera(area, Emission(area.nuclide, QUIET), ground, own).see(AreaPose(np.array(place), AHEAD), (0.5, 0.5))


def rates(seen: AreaView) -> tuple[float, float]:
    """Events per second of unscattered photons, and of scattered ones if their directions did not matter."""
    flux = seen.towards.sum(axis=(0, 1)) + seen.around
    return float(seen.rates.sum()), float(flux @ isotropic_mm2()) * 1e-6


PLANE = {2.0: 124.0, 5.0: 119.0, 10.0: 116.0}  # counts/s of an endless plane of 1 MBq/m2: independent Monte Carlo
PATCH = {2.0: 31.0, 5.0: 20.0, 10.0: 11.0}  # of a patch of 20 m, from above its middle


@pytest.mark.parametrize("height_m", PLANE)
def test_counts_above_a_plane_and_above_a_patch(height_m: float) -> None:
    """Within 10 %: the study's detector has no mounting and no directions, and its soil another composition."""
    plane = sum(rates(look(square(600.0, 4.0, 300.0), (0.0, 0.0, height_m))))
    patch = sum(rates(look(square(20.0, 1.0), (0.0, 0.0, height_m))))
    assert plane == pytest.approx(PLANE[height_m], rel=0.1)
    assert patch == pytest.approx(PATCH[height_m], rel=0.12)


def test_a_small_cell_is_a_point_source() -> None:
    """The same photons as of a source in the tables for points, straight and scattered, from the same directions."""
    height_m, north_m = 3.5, 6.0  # a level of both tables, and within their rings
    cell = AreaSource("Cs-137", np.array([0.0]), np.array([north_m]), np.array([3e8]), 0.01)
    seen = look(cell, (0.0, 0.0, height_m))
    distance_m = math.hypot(height_m, north_m)
    direction = (0.0, height_m / distance_m, north_m / distance_m)
    assert (seen.bins[0], seen.symmetries[0]) == bin_of(math.acos(direction[2]), math.pi / 2.0)
    square_m2 = point_field("Cs-137", "soil", 0.0).times_square(height_m, north_m)[:, :GROUPS]
    flux = 3e8 / (4.0 * math.pi * distance_m**2) * square_m2
    sides = np.argwhere(seen.towards.any(axis=2))
    assert [tuple(side[::-1]) for side in sides.tolist()] == [direction_of(direction)]
    assert seen.towards.sum() == pytest.approx(flux[0].sum(), rel=0.02)
    assert seen.around.sum() == pytest.approx(flux[1].sum(), rel=0.03)


def test_directions_are_those_of_the_banks() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-30.0, 30.0, (2, 400))
    seen = look(AreaSource("Cs-137", x, y, np.ones(400), 0.01), (0.0, 0.0, 4.0))
    for k, (east, north) in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
        unit = AHEAD @ np.array((east, north, -4.0)) / math.sqrt(east**2 + north**2 + 16.0)
        assert (seen.bins[k], seen.symmetries[k]) == bin_of(math.acos(unit[2]), math.atan2(unit[1], unit[0]))


@pytest.mark.slow
def test_buried_activity_is_weakened_by_the_soil_on_the_way() -> None:
    """0.5 g/cm2 of soil stop a quarter of the straight photons of a plane (3.75 % straight up); in counts, most of them return
    as softer ones."""
    bare, buried = (look(square(300.0, 3.0), (0.0, 0.0, 3.5), GroundTruth(natural=0.0, depth_m=d)) for d in (0.0, 0.5 / 150.0))
    assert 0.6 < buried.rates.sum() / bare.rates.sum() < 0.9
    assert 0.9 < sum(rates(buried)) / sum(rates(bare)) < 1.0


def test_a_camera_counts_the_photons_of_the_area_and_none_without_a_pose() -> None:
    area = square(20.0, 1.0)
    expected = sum(rates(look(area, (0.0, 0.0, 5.0))))

    def events_per_s(pose: AreaPose | None) -> float:
        camera = Camera(QUIET, "Cs-137", np.random.default_rng(4), 0, SOIL, [area])
        slices = (camera.expose(k * 10**8, (k + 1) * 10**8, [], 5.0, pose).hits.tick for k in range(300))
        return sum(1 + int(np.count_nonzero(np.diff(np.sort(ticks)) > TICKS)) for ticks in slices if len(ticks)) / 30.0

    assert events_per_s(AreaPose(np.array((0.0, 0.0, 5.0)), AHEAD)) == pytest.approx(expected, rel=0.25)
    assert events_per_s(None) == 0.0


@pytest.mark.slow
def test_an_area_of_another_nuclide_beside_a_point_source() -> None:
    camera = Camera(QUIET, ["Co-60", "Cs-137"], np.random.default_rng(5), 0, SOIL, [square(20.0, 2.0)])
    view = SourceView((0.0, 0.6, 0.8), 5.0, 1e8, camera_m=3.0, nuclide="Co-60")
    pose = AreaPose(np.array((0.0, 0.0, 3.0)), AHEAD)
    both, point = (
        sum(len(camera.expose(k * 10**8, (k + 1) * 10**8, [view], 3.0, seen).hits) for k in range(50)) for seen in (pose, None)
    )
    assert both > 1.5 * point


def test_dose_rate_above_a_plane() -> None:
    """3.08e-12 Sv/h of H*(10) 1 m above 1 Bq/m2 is 2.57e-12 Gy/h, of which the unscattered photons of Cs-137 are 1.96e-12."""
    field = area_field("Cs-137", "soil", 0.0).at(1.0)[:, :, GROUPS].sum(axis=1)
    edges = np.sinh(np.linspace(0.0, math.asinh(150.0), 200))
    radius = 0.5 * (edges[1:] + edges[:-1])
    kerma = np.interp(np.arcsinh(radius), PLACES, field) / (4.0 * math.pi * (1.0 + radius**2))
    scattered = float(kerma @ (math.pi * np.diff(edges**2))) * 3600.0
    assert scattered == pytest.approx(0.61e-12, rel=0.2)


def test_the_flux_by_angle_is_that_of_the_camera() -> None:
    """The same photons, for detectors without azimuth: totals by line, from the cells' side, and from elsewhere."""
    area, place = square(20.0, 1.0), np.array((3.0, -2.0, 5.0))
    seen = look(area, (3.0, -2.0, 5.0))
    straight, towards, around = flux_by_angle(area, SOIL, place, (0.5, 0.5), np.linspace(0.0, 90.0, 5))
    distance_m = np.sqrt((area.x_m - 3.0) ** 2 + (area.y_m + 2.0) ** 2 + 25.0)
    direct = 0.851 * area.activity_bq / (4.0 * math.pi * distance_m**2) * np.exp(-distance_m * air_attenuation_per_m(661.657))
    assert straight.sum() == pytest.approx(direct.sum(), rel=1e-6)
    assert towards.sum(axis=0) == pytest.approx(seen.towards.sum(axis=(0, 1)), rel=1e-6)
    assert around == pytest.approx(seen.around, rel=1e-6)
    assert straight[-1].sum() < 0.1 * straight[:3].sum()  # hardly a cell is seen at 67 degrees and more
