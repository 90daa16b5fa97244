"""Walls known to the mission: their transmission, and the estimator's use of it."""

import gc
import weakref

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.buildings import BuildingConfig, BuildingsConfig
from radron.agent.config.mission import GroundConfig
from radron.agent.fusion.sources.counts import CountModel
from radron.agent.fusion.sources.data import Rows
from radron.agent.fusion.sources.shades import KnownWalls, Shades
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import Spectra
from radron.agent.terrain.buildings import attenuation_per_m
from radron.agent.terrain.ground import Ground

SOURCE = ("Cs-137", 18.0, 22.0, 3e9)
WEST_M, THICKNESS_M, SOUTH_M, NORTH_M, HEIGHT_M = 14.9, 0.2, 16.0, 32.0, 2.5
WALL = BuildingConfig(
    footprint_m=(
        (WEST_M, SOUTH_M),
        (WEST_M + THICKNESS_M, SOUTH_M),
        (WEST_M + THICKNESS_M, NORTH_M),
        (WEST_M, NORTH_M),
    ),
    height_m=HEIGHT_M,
)
SPECTRA = Spectra.of(("Cs-137", "Co-60"))
FLAT = Ground(GroundConfig())


def walls(*known):
    return KnownWalls(BuildingsConfig(known=known), SPECTRA.air_per_m, FLAT)


def passing(camera, source):
    """Share that passes the wall, by its middle plane: the truth of the synthetic flights."""
    along = (WEST_M + THICKNESS_M / 2.0 - camera[0]) / (source[0] - camera[0])
    if not 0.0 < along < 1.0:
        return 1.0
    _, y, z = camera + along * (source - camera)
    length_m = THICKNESS_M * np.linalg.norm(source - camera) / abs(source[0] - camera[0])
    per_m = attenuation_per_m(WALL, SPECTRA.air_per_m[0])
    return float(np.exp(-per_m * length_m)) if SOUTH_M < y < NORTH_M and z < HEIGHT_M else 1.0


def test_what_passes_is_that_of_the_nuclide_and_the_material():
    source, camera = np.array([18.0, 24.0, 0.0]), np.array([[5.0, 24.0, 1.0], [18.0, 40.0, 1.0]])
    shades = Shades(walls(WALL), camera)
    for n in range(2):
        assert shades.passing(n, (18.0, 24.0, 0.0)) == pytest.approx([_through(n, camera[0], source), 1.0], rel=1e-3)


def _through(n, camera, source):
    length_m = THICKNESS_M * np.linalg.norm(source - camera) / abs(source[0] - camera[0])
    return np.exp(-attenuation_per_m(WALL, SPECTRA.air_per_m[n]) * length_m)


def test_a_given_attenuation_is_that_of_all_nuclides():
    shades = Shades(walls(replace(WALL, attenuation_per_m=5.0)), np.array([[18.0, 24.0, 0.5], [12.0, 24.0, 0.5]]))
    shares = [shades.passing(n, (20.0, 24.0, 0.5)) for n in range(2)]
    assert shares[0] == pytest.approx(shares[1])
    assert shares[0] == pytest.approx([1.0, np.exp(-5.0 * THICKNESS_M)], rel=0.01)


def test_at_the_edge_of_the_shadow_some_may_pass_and_nobody_knows_how_much():
    shades = Shades(walls(WALL), np.array([[12.0, 8.0 + off, 1.0] for off in (-3.0, 0.0, 3.0)]))
    source = (18.0, 24.0, 1.0)  # from (12, 8) the line meets the wall's southern end
    share, sigma = shades.spread(0, source, np.array([0.1, 0.1]))
    assert share[0] == 1.0
    assert 0.1 < share[1] < 0.9
    assert share[2] < 0.1
    assert sigma[1] > 0.2
    assert max(sigma[0], sigma[2]) < 0.05


def test_what_a_fit_has_asked_for_goes_with_it_where_gc_is_off():
    """As in simulated time, where gc waits for the end of a run."""
    known, places = walls(WALL), np.array([[12.0, 24.0, 0.5]])
    gc.disable()
    try:
        shades = Shades(known, places)
        shades.spread(0, (18.0, 24.0, 1.0), np.array([0.1, 0.1]))
        left = weakref.ref(shades), weakref.ref(shades.passing(0, (18.0, 24.0, 1.0)))
        assert left[1]() is not None  # kept
        del shades
        assert [one() for one in left] == [None, None]
    finally:
        gc.enable()


def test_without_a_map_there_are_none():
    assert not walls()
    assert walls(WALL)


@pytest.fixture(scope="module")
def flown(among):
    """A mission that knows the wall, and the measurements around it."""
    mission = replace(among.mission_of(moved_s=20.0), buildings=BuildingsConfig(known=(WALL,)))
    return mission, among.entries_of(mission, np.random.default_rng(6), 40.0, [SOURCE], passing=passing)


def test_a_source_behind_a_known_wall_is_one_source_where_it_is(flown, estimated):
    """Within four standard deviations, or 5 cm more."""
    mission, entries = flown
    hypothesis = estimated(mission, entries, 42.0)
    assert hypothesis.others == ()
    sigma_m = np.sqrt(np.diag(hypothesis.covariance)[:2])
    assert np.all(np.abs(hypothesis.position[:2] - SOURCE[1:3]) < 4.0 * sigma_m + 0.05)
    assert hypothesis.activity_bq == pytest.approx(SOURCE[3], rel=0.15)


@pytest.fixture(scope="module")
def models(among):
    """Expected counts of places along x = 12, with and without the map; between y = 8 and 40 the wall hides the source."""
    table = np.zeros((41, 43), np.int64)
    table[:, 4] = 1_000_000_000
    table[:, 5] = 12_000 * table[:, 4]
    table[:, 6] = 1_000 * np.arange(4, 45) * table[:, 4]
    table[:, 7] = 1_000 * table[:, 4]
    table[:, 11:] = 1
    known, blind = (CountModel(Rows(table), SPECTRA, FLAT, 1, each) for each in (walls(WALL), None))
    return known, blind, Solution((0,), np.array([(18.0, 24.0)]), np.array([1.0]), 0.0, np.zeros((1, 3)))


def test_behind_the_wall_only_what_is_scattered_is_left(models):
    known, blind, solution = models
    with_wall, without = known.expected(solution), blind.expected(solution)
    y = known.place[:, 1]
    behind, beside = (y > 9.0) & (y < 39.0), (y < 7.0) | (y > 41.0)
    assert with_wall.clear[beside] == pytest.approx(without.clear[beside])
    assert with_wall.direct[behind].sum() < 0.05 * without.direct[behind].sum()
    lost = (without.clear - with_wall.clear)[behind]
    assert lost == pytest.approx((without.direct - with_wall.direct)[behind])


@pytest.mark.parametrize("number", [2, 3, 6])
def test_the_gradient_is_that_of_the_value(models, number):
    """By log activity, background and sensitivity; by the place, derivatives of the transmission are left out."""
    known, _, solution = models
    step = np.zeros(7)
    step[number] = 1e-5
    after, before = (known.log_likelihood(known.expected(solution.moved(solution.vector + sign * step))) for sign in (1, -1))
    by_drone, _ = known.scored(solution)[1]()
    gradient = by_drone[0, number] if number < 4 else by_drone[0, 2] + by_drone[0, 3]  # sensitivity strengthens both
    assert gradient == pytest.approx((after - before) / 2e-5, rel=1e-3, abs=0.05)


def test_places_at_an_edge_weigh_less(models):
    known, blind, solution = models
    doubting = known.doubting(solution, np.array([(0.5, 0.5)]))
    assert (doubting.weight <= known.weight).all()
    y = known.place[:, 1]
    assert (doubting.weight[(y == 8.0) | (y == 40.0)] < 0.5 * known.weight[0]).all()
    assert doubting.weight[(y < 5.0) | ((y > 20.0) & (y < 28.0))] == pytest.approx(known.weight[0], rel=0.02)
    assert np.array_equal(blind.doubting(solution, np.array([(0.5, 0.5)])).weight, blind.weight)
