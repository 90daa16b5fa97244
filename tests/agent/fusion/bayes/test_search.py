"""The search on a grid: motion of the source, and limits of its activity."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from shapely import box

from agent.config.estimators import BayesEstimatorConfig
from agent.fusion.bayes.response import response_of
from agent.fusion.bayes.search import Grid, SearchState
from agent.terrain.ground import Ground


@pytest.mark.parametrize("side_m", [50.0, 100.0, 300.0, 1000.0])
def test_a_source_diffuses_alike_in_small_and_large_areas(kit, side_m):
    """As far in cells of 16 m as in such of 2.5 m."""
    config = BayesEstimatorConfig()
    grid = Grid(box(0.0, 0.0, side_m, side_m), config, Ground.from_config(kit.mission_of()))
    state = SearchState.prior(grid, 0.0)
    weight = np.zeros_like(state.weight)
    middle = len(grid.x) // 2
    weight[:, 0, middle, middle] = 1.0
    state = replace(state, weight=weight)
    for step in range(1, 21):
        state = state.later(grid, 0.5 * step)
    at = state.weight[:, 0].astype(float)
    at /= at.sum(axis=(1, 2), keepdims=True)
    variance = (at * (grid.x - grid.x[middle, middle]) ** 2).sum(axis=(1, 2))
    assert variance[0] == 0.0
    slow_m2ps, fast_m2ps = config.search_diffusion_m2ps
    assert variance[1] == pytest.approx(10.0 * slow_m2ps, rel=0.05)
    if side_m > 50.0:  # else it comes to the edges
        assert variance[2] == pytest.approx(10.0 * fast_m2ps, rel=0.1)


@pytest.mark.parametrize("activity_bq", [1e8, 3e9, 1e11, 2e12])
def test_what_is_declared_of_any_activity_is_where_it_says(kit, activity_bq):
    """Sources of industrial radiography and teletherapy have 1e11 Bq and more: nearby a weaker one would give as much."""
    mission = kit.mission_of()
    config, response = mission.fusion.bayes, response_of(mission.nuclide)
    grid = Grid(box(0.0, 0.0, 100.0, 100.0), config, Ground.from_config(mission))
    source, rng = np.array([70.0, 60.0, 0.0]), np.random.default_rng(1)
    state = SearchState.prior(grid, 0.0)
    for number in range(600):
        time_s, aside = 0.2 * number, 25.0 * (number % 3)
        passing, near = np.array([20.0 + aside, 5.0 + 3.0 * time_s, 3.0]), source + np.array([8.0 - aside / 5.0, 4.0, 3.0])
        place = passing if time_s < 25.0 else near
        distance = np.array(math.dist(place, source))
        strength = activity_bq / 1e9
        expected = response.signal(response.flux(distance) * strength * 0.5, distance) + response.background_ps * 0.5
        state = state.later(grid, time_s).after_counts(
            grid, response, tuple(place.tolist()), 0.5, rng.poisson(expected).astype(float)
        )
        x, y, rms_m = state.place(grid)
        if state.none < config.doubt and rms_m < config.declared_rms_m:
            assert math.hypot(x - source[0], y - source[1]) < 3.0 * rms_m
            return
    pytest.fail("not found")
