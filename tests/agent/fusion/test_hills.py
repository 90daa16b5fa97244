"""Estimators over uneven ground: the source lies on it, above or below the mission frame's zero."""

import math

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.config.mission import GroundConfig
from radron.agent.frames.transform import Transform
from radron.agent.fusion.initial import InitialSearch
from radron.agent.fusion.observation import observe
from radron.agent.fusion.registry import estimator_named
from radron.agent.terrain.ground import Ground
from radron.protocol.entries import Counts
from support.flights.fusions import fusion_of

SQUARE = Polygon([(0, 0), (100, 0), (100, 100), (0, 100)])
SLOPE = GroundConfig(height_m=-5.0, slope=(0.25, 0.1))
GROUND = Ground(SLOPE)
SOURCE = (64.0, 58.0, GROUND.height_m(64.0, 58.0))  # 16.8 m up


def above(x, y, height_m=3.0):
    return np.array([x, y, GROUND.height_m(x, y) + height_m])


def believed(kit, mission, entries, seconds):
    fusion = fusion_of(mission)
    kit.feed(fusion, entries)
    kit.settle(fusion, kit.T0_NS + round(seconds * 1e9), 10**6)
    return fusion.hypothesis


def entries_of(kit, mission, rng, seconds):
    """Exposures and cones of three drones that circle the source 3 m above the ground."""
    entries = []
    for number in range(int(seconds / 0.5)):
        for index, drone in enumerate(("a", "b", "c")):
            angle = number * 0.125 + 2.0 * math.pi * index / 3
            radius = max(10.0, 30.0 - number * 0.5)
            place = above(SOURCE[0] + radius * math.cos(angle), SOURCE[1] + radius * math.sin(angle))
            distance = float(np.linalg.norm(place - SOURCE))
            flux = 2e9 * 0.851 / (4e6 * math.pi * distance**2) * math.exp(-0.0093 * distance)
            single, full, pairs = rng.poisson((np.array([13.1, 2.9, 2.0]) * flux + (1.45, 0.03, 0.01)) * 0.5).tolist()
            counts = Counts(hits=single + full + 2 * pairs, photopeak=full, coincidences=pairs)
            exposure = kit.exposure_entry(mission, number * 0.5, place, drone=drone, sequence=10 * number, duration_s=0.5)
            entries.append(msgspec.structs.replace(exposure, counts=counts))
            for k in range(int(rng.poisson(0.55 * flux * 0.5))):
                axis, theta = kit.cone_towards(rng, place, SOURCE, 0.1)
                cone = kit.cone_entry(mission, number * 0.5 + 0.2, place, axis, theta, drone=drone, sequence=10 * number + 1 + k)
                entries.append(cone)
    return entries


def test_bayes_finds_the_source_on_the_slope_and_says_how_high(kit):
    mission = replace(kit.mission_of(estimator="bayes"), ground=SLOPE)
    found = believed(kit, mission, entries_of(kit, mission, np.random.default_rng(1), 60.0), 60.0)
    assert math.dist(found.position[:2], SOURCE[:2]) < 0.5
    assert found.position[2] == pytest.approx(GROUND.height_m(*found.position[:2]))
    assert found.position[2] == pytest.approx(SOURCE[2], abs=0.2)
    along = np.array([-0.25, -0.1, 1.0])  # the ground's normal: there is nothing to be known along it
    assert along @ found.covariance @ along == pytest.approx(0.0, abs=1e-12)
    error = found.position[:2] - SOURCE[:2]
    assert error @ np.linalg.solve(found.covariance[:2, :2], error) < 13.8  # once in a thousand is it beyond
    sight = found.sight_of("b")
    assert sight.position[2] == pytest.approx(SOURCE[2], abs=0.2)


def test_who_takes_the_ground_for_even_is_led_astray(kit):
    """The benefit of the ground model: the same flight without it."""
    mission = kit.mission_of(estimator="bayes")
    found = believed(kit, mission, entries_of(kit, mission, np.random.default_rng(1), 60.0), 60.0)
    assert found is None or math.dist(found.position[:2], SOURCE[:2]) > 1.5


def cones_of(kit, mission, rng, count, arm_rad):
    for number in range(count):
        angle, radius = 0.6 * number, rng.uniform(8.0, 16.0)
        place = above(SOURCE[0] + radius * math.cos(angle), SOURCE[1] + radius * math.sin(angle))
        axis, theta = kit.cone_towards(rng, place, SOURCE, arm_rad)
        yield kit.cone_entry(mission, 0.5 * number, place, axis, theta, sequence=number)


@pytest.mark.parametrize("seed", range(5))
def test_exact_cones_meet_at_the_source_on_the_slope(kit, seed):
    mission = kit.mission_of()
    cones = [observe(cone, Transform()).probable for cone in cones_of(kit, mission, np.random.default_rng(seed), 10, 0.0)]
    assert InitialSearch(SQUARE, GROUND).solve(cones) == pytest.approx(SOURCE[:2], abs=1e-3)


@pytest.mark.parametrize("estimator", ["paper", "paper-geometric"])
def test_the_papers_filter_keeps_to_the_slope(kit, estimator):
    mission = replace(kit.mission_of(estimator=estimator, order="probable"), ground=SLOPE)
    found = believed(kit, mission, list(cones_of(kit, mission, np.random.default_rng(3), 120, 0.02)), 60.0)
    assert math.dist(found.position[:2], SOURCE[:2]) < 1.5
    assert found.position[2] == pytest.approx(GROUND.height_m(*found.position[:2]))


def test_a_given_hypothesis_lies_on_the_ground(kit):
    mission = replace(kit.mission_of(estimator="given", schedule=((0.0, 64.0, 58.0),)), ground=SLOPE)
    fusion = fusion_of(mission, estimator_named("given", mission))
    fusion.start(kit.T0_NS)
    kit.settle(fusion, kit.T0_NS + 2_000_000_000)
    assert fusion.hypothesis.position.tolist() == pytest.approx(SOURCE)
