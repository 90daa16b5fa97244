"""The search on a grid: motion of the source, and limits of its activity."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from shapely import Polygon, box, distance, points

from radron.agent.config.estimators import BayesEstimatorConfig
from radron.agent.fusion.bayes.grid import OUTSIDE_PRIOR, Grid
from radron.agent.fusion.bayes.response import response_of
from radron.agent.fusion.bayes.search import SearchState
from radron.agent.terrain.ground import Ground


@pytest.mark.parametrize("side_m", [50.0, 100.0, 300.0, 1000.0])
def test_a_source_diffuses_alike_in_small_and_large_areas(kit, side_m):
    """As far in cells of 16 m as in such of 2.5 m."""
    config = BayesEstimatorConfig()
    grid = Grid(box(0.0, 0.0, side_m, side_m), 30.0, config, Ground.from_config(kit.mission_of()))
    state = SearchState.prior(grid, 0.0)
    weight = np.zeros_like(state.weight)
    middle = int(np.hypot(grid.x - side_m / 2.0, grid.y - side_m / 2.0).argmin())
    weight[:, 0, middle] = 1.0
    state = replace(state, weight=weight)
    for step in range(1, 21):
        state = state.later(grid, 0.5 * step)
    at = state.weight[:, 0].astype(float)
    at /= at.sum(axis=1, keepdims=True)
    variance = (at * (grid.x - grid.x[middle]) ** 2).sum(axis=1)
    assert variance[0] == 0.0
    slow_m2ps, fast_m2ps = config.search_diffusion_m2ps
    assert variance[1] == pytest.approx(10.0 * slow_m2ps, rel=0.05)
    if side_m > 50.0:  # else it comes to the edges
        assert variance[2] == pytest.approx(10.0 * fast_m2ps, rel=0.1)


def searched(kit, activity_bq, source, camera, steps):
    """The search of 100 x 100 m and its surroundings, after so many exposures of 0.5 s by a camera at ``camera(number)`` of a
    source at ``source(number)``.
    """
    mission = kit.mission_of()
    config, response = mission.fusion.bayes, response_of(mission.nuclide)
    grid = Grid(box(0.0, 0.0, 100.0, 100.0), 30.0, config, Ground.from_config(mission))
    state, rng = SearchState.prior(grid, 0.0), np.random.default_rng(1)
    for number in range(steps):
        place = camera(number)
        distance = np.array(math.dist(place, source(number)))
        expected = response.signal(response.flux(distance) * activity_bq / 1e9 * 0.5, distance) + response.background_ps * 0.5
        counts = rng.poisson(expected).astype(float)
        state = state.later(grid, 0.2 * number).after_counts(grid, response, place, 0.5, counts)
        yield grid, state


@pytest.mark.parametrize("activity_bq", [1e8, 3e9, 1e11, 2e12])
def test_what_is_declared_of_any_activity_is_where_it_says(kit, activity_bq):
    """Sources of industrial radiography and teletherapy have 1e11 Bq and more: nearby a weaker one would give as much."""
    config, source = BayesEstimatorConfig(), (70.0, 60.0, 0.0)

    def camera(number):
        time_s, aside = 0.2 * number, 25.0 * (number % 3)
        passing, near = (20.0 + aside, 5.0 + 3.0 * time_s, 3.0), (78.0 - aside / 5.0, 64.0, 3.0)
        return passing if time_s < 25.0 else near

    for grid, state in searched(kit, activity_bq, lambda _: source, camera, 600):
        x, y, rms_m = state.place(grid)
        if state.none < config.doubt and rms_m < config.declared_rms_m:
            assert math.hypot(x - source[0], y - source[1]) < 3.0 * rms_m
            return
    pytest.fail("not found")


def along_edges(number):
    """Three cameras along the edges of the area."""
    along, drone = 2.0 * (number // 3) % 100.0, number % 3
    return ((100.0 - along, 100.0, 3.0), (100.0, along, 3.0), (along, 0.0, 3.0))[drone]


@pytest.mark.parametrize(
    ("source", "activity_bq"), [((145.0, 60.0, 0.0), 1e10), ((-50.0, -40.0, 0.0), 1e11), ((50.0, 185.0, 0.0), 1e11)]
)
def test_a_source_beyond_the_fence_is_not_taken_for_one_at_the_edge(kit, source, activity_bq):
    """Nearly all of the probability goes to where the source is, outside."""
    *_, (grid, state) = searched(kit, activity_bq, lambda _: source, along_edges, 450)
    assert state.none < 1e-3
    cells = state.weight.sum(axis=(0, 1), dtype=float)
    assert cells[grid.inside].sum() < 0.1  # of a source that moves fast
    found, true = (math.atan2(east - 50.0, north - 50.0) for east, north in (state.beyond(grid), source[:2]))
    assert abs(math.remainder(found - true, math.tau)) < math.radians(10.0)
    assert state.outlook(grid).excluded_bq is not None  # within the fence


def test_a_source_up_to_the_fence_is_not_beyond_it(kit):
    def up_to_the_fence(number):
        x, y, z = along_edges(number)
        return x + 25.0 * (number % 3 == 1), y, z

    *_, (grid, state) = searched(kit, 1e10, lambda _: (120.0, 50.0, 0.0), up_to_the_fence, 450)
    x, y, rms_m = state.place(grid)
    assert state.none < 1e-3
    assert math.hypot(x - 120.0, y - 50.0) < 10.0
    assert rms_m < 10.0
    assert state.beyond(grid) is None
    assert (state.outlook(grid).excluded_bq or math.inf) > 1e10


def test_a_source_that_walks_in_from_beyond_the_fence_is_found(kit):
    """The source rests there until all other places are excluded, then it walks at 1 m/s."""

    def source(number):
        return 150.0 - min(max(0.2 * number - 60.0, 0.0), 75.0), 50.0, 0.0

    outside = []
    for grid, state in searched(kit, 3e10, source, along_edges, 750):
        outside.append(state.beyond(grid) is not None)
    assert outside[299]
    assert not outside[-1]
    x, y, rms_m = state.place(grid)
    assert math.hypot(x - 75.0, y - 50.0) < 2.0 * rms_m < 20.0


@pytest.mark.parametrize(("between", "is_excluded"), [(0.12, False), (0.02, True)])
def test_nothing_is_excluded_while_a_source_may_be_between_area_and_fence(kit, between, is_excluded):
    """The area is excluded, and the source probably beyond the fence; at first 1.1 % are between area and fence."""
    grid = Grid(box(0.0, 0.0, 50.0, 50.0), 30.0, BayesEstimatorConfig(), Ground.from_config(kit.mission_of()))
    cells = np.where(grid.beyond, (1.0 - between) / grid.beyond.sum(), between / (~grid.inside & ~grid.beyond).sum())
    state = SearchState.prior(grid, 0.0)
    weight = np.broadcast_to(cells * ~grid.inside / state.weight[..., 0].size, state.weight.shape)
    state = replace(state, weight=weight.astype(np.float32), none=1e-9)
    assert (state.outlook(grid).excluded_bq is not None) is is_excluded


def test_the_prior_covers_area_and_surroundings_once(kit):
    ground = Ground.from_config(kit.mission_of())
    corner = Polygon([(0.0, 0.0), (100.0, 0.0), (0.0, 100.0)])
    for area in (box(0.0, 0.0, 50.0, 50.0), corner, box(0.0, 0.0, 3.0, 200.0), box(5.0, 0.0, 400.0, 333.0)):
        grid = Grid(area, 30.0, BayesEstimatorConfig(), ground)
        assert grid.prior.sum() == pytest.approx(1.0)
        assert grid.prior[~grid.inside].sum() == pytest.approx(OUTSIDE_PRIOR)
        at = np.column_stack((grid.x, grid.y))
        reached = distance(points(at), area)
        assert reached.max() < 90.0 + grid.cell_m.max()
        samples = np.random.default_rng(1).uniform([-80.0, -80.0], [80.0 + area.bounds[2], 80.0 + area.bounds[3]], (2000, 2))
        near = samples[distance(points(samples), area) < 75.0]
        apart = np.abs(near[:, None] - at).max(axis=2) - 0.5 * grid.cell_m
        assert (apart.min(axis=1) < 0.26 * grid.cell_m.max()).all()
