import math
from types import SimpleNamespace

import numpy as np
import pytest
from shapely import Polygon

from radron.agent.frames.transform import Transform
from radron.agent.fusion.initial import InitialSearch
from radron.agent.fusion.observation import observe

SQUARE = Polygon([(0, 0), (100, 0), (100, 100), (0, 100)])


@pytest.fixture
def cones_of(kit):
    def make(rng, target, count, arm_rad):
        mission = kit.mission_of()
        made = []
        for sequence in range(count):
            apex = np.array([*rng.uniform(0.0, 100.0, 2), 3.0])
            axis, theta = kit.cone_towards(rng, apex, (*target, 0.0), arm_rad)
            made.append(observe(kit.cone_entry(mission, sequence, apex, axis, theta, sequence=sequence), Transform()).probable)
        return made

    return make


def cost(cones, x, y):
    total = 0.0
    for cone in cones:
        v = np.array([x, y, 0.0]) - cone.apex
        alpha = math.acos(np.clip(v @ np.array(cone.axis) / np.linalg.norm(v), -1.0, 1.0))
        total += (np.linalg.norm(v) * math.sin(alpha - cone.theta_rad)) ** 2
    return total


@pytest.mark.parametrize("seed", range(10))
def test_exact_cones_meet_at_the_source(cones_of, seed):
    rng = np.random.default_rng(seed)
    target = rng.uniform(5.0, 95.0, 2)
    assert InitialSearch(SQUARE).solve(cones_of(rng, target, 10, 0.0)) == pytest.approx(tuple(target), abs=1e-3)


@pytest.mark.parametrize("seed", range(10))
def test_no_point_of_a_fine_grid_is_better(cones_of, seed):
    rng = np.random.default_rng(100 + seed)
    cones = cones_of(rng, rng.uniform(5.0, 95.0, 2), 10, 0.15)
    x, y = InitialSearch(SQUARE).solve(cones)
    around = [cost(cones, x + dx, y + dy) for dx in np.linspace(-1, 1, 11) for dy in np.linspace(-1, 1, 11)]
    coarse = [cost(cones, gx, gy) for gx in np.arange(1.0, 100.0, 4.0) for gy in np.arange(1.0, 100.0, 4.0)]
    inside = 1.0 < x < 99.0 and 1.0 < y < 99.0
    if inside:
        assert cost(cones, x, y) <= min(around) + 1e-6
    assert cost(cones, x, y) <= min(coarse) + 1e-6
    assert 0.0 <= x <= 100.0
    assert 0.0 <= y <= 100.0


def test_the_same_cones_give_the_same_bits(cones_of):
    cones = cones_of(np.random.default_rng(3), (40.0, 60.0), 10, 0.1)
    assert InitialSearch(SQUARE).solve(cones) == InitialSearch(SQUARE).solve(list(cones))


DOWN, UP, EAST = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
DEGENERATE = {  # apex of the first cone, by how much the next ones are shifted, axis, theta
    "one and the same cone": ((50.0, 50.0, 3.0), 0.0, DOWN, 0.8),
    "horizontal planes": ((50.0, 50.0, 3.0), 2.0, UP, math.pi / 2),
    "all looking up": ((50.0, 50.0, 3.0), 2.0, UP, 0.3),
    "apex on the ground, on the grid": ((51.0, 51.0, 0.0), 0.0, EAST, 0.8),
    "theta zero": ((50.0, 50.0, 3.0), 0.0, DOWN, 0.0),
    "theta pi": ((50.0, 50.0, 3.0), 0.0, UP, 3.1416),
    "far away": ((9e4, -9e4, 10.0), 0.0, EAST, 0.8),
}


@pytest.mark.parametrize("case", DEGENERATE)
def test_degenerate_cones_end_in_a_point_of_the_area(kit, case):
    (x, y, z), shift, axis, theta = DEGENERATE[case]
    mission = kit.mission_of()
    entries = [kit.cone_entry(mission, i, (x + shift * i, y, z), axis, theta, sequence=i) for i in range(10)]
    cones = [observe(entry, Transform()).probable for entry in entries]
    found = InitialSearch(SQUARE).solve(cones)
    assert all(0.0 <= value <= 100.0 for value in found)
    assert InitialSearch(SQUARE).solve(cones) == found


@pytest.mark.parametrize(("x", "cost"), [((math.nan, math.nan), math.nan), ((1.0, 1.0), 1e9)])
def test_a_solver_that_fails_leaves_the_best_point_of_the_grid(cones_of, monkeypatch, x, cost):
    result = SimpleNamespace(x=np.array(x), cost=cost)
    monkeypatch.setattr("radron.agent.fusion.initial.least_squares", lambda *_, **__: result)
    cones = cones_of(np.random.default_rng(1), (41.0, 63.0), 10, 0.0)
    assert InitialSearch(SQUARE).solve(cones) == (41.0, 63.0)


def test_an_area_thinner_than_the_grid(cones_of):
    sliver = Polygon([(0, 0), (60, 0), (60, 0.5), (0, 0.5)])
    x, y = InitialSearch(sliver).solve(cones_of(np.random.default_rng(1), (30.0, 0.25), 10, 0.0))
    assert (x, y) == pytest.approx((30.0, 0.25), abs=0.05)


def test_only_the_polygon_is_searched(cones_of):
    """An L: the grid has nothing in the missing quarter, though the bounding box has."""
    area = Polygon([(0, 0), (100, 0), (100, 40), (40, 40), (40, 100), (0, 100)])
    search = InitialSearch(area)
    assert search.solve(cones_of(np.random.default_rng(2), (20.0, 80.0), 10, 0.0)) == pytest.approx((20.0, 80.0), abs=1e-3)
