"""Radius and height of the circle from the accuracy of the hypothesis."""

from __future__ import annotations

from itertools import pairwise

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import EncirclementConfig, MissionConfig, SafetyConfig
from radron.agent.motion.orbit import Orbit, ring_lift_m, second_height_m
from support.flights.one_pilot import MISSION

SECOND = 1_000_000_000
CONFIG = EncirclementConfig(radius_m=12.0, nearest_m=5.0, height_m=3.0)
STRONG_BQ = 3e9


def settled(rms_m: float, activity_bq: float | None = STRONG_BQ, lost: bool = False, floor_m: float = 1.0) -> Orbit:
    orbit = Orbit(CONFIG, floor_m)
    for tick in range(300):
        orbit.update(tick * SECOND // 5, rms_m, activity_bq, lost)
    return orbit


def test_before_anything_is_known_it_is_the_configured_circle() -> None:
    orbit = Orbit(CONFIG, 1.0)
    assert (orbit.radius_m, orbit.height_m) == (12.0, 3.0)


@pytest.mark.parametrize(("rms_m", "radius_m"), [(0.0, 5.0), (2.0, 7.0), (7.5, 12.0), (30.0, 12.0)])
def test_the_better_the_source_is_known_the_nearer(rms_m: float, radius_m: float) -> None:
    assert settled(rms_m).radius_m == pytest.approx(radius_m, abs=1e-3)


def test_a_weak_source_is_approached_although_little_is_known() -> None:
    weak, strong = settled(10.0, 1.79e8).radius_m, settled(10.0, STRONG_BQ).radius_m
    assert 5.0 <= weak < 6.0
    assert strong == pytest.approx(12.0, abs=1e-3)
    assert settled(10.0, 1e6).radius_m == pytest.approx(5.0, abs=1e-3)  # never nearer than configured
    assert settled(10.0, None).radius_m == pytest.approx(12.0, abs=1e-3)


def test_a_lost_source_is_encircled_as_widely_as_it_may_be_away() -> None:
    assert settled(20.0, lost=True).radius_m == pytest.approx(20.0, abs=1e-3)
    assert settled(500.0, lost=True).radius_m == pytest.approx(40.0, abs=1e-3)
    assert settled(20.0, lost=True).height_m == pytest.approx(3.0, abs=1e-3)


def test_the_height_is_in_proportion_but_stays_over_the_floor() -> None:
    assert settled(4.0, floor_m=0.5).height_m == pytest.approx(3.0 * 9.0 / 12.0, abs=1e-3)
    assert settled(0.0, floor_m=1.5).height_m == pytest.approx(2.3, abs=1e-3)
    assert settled(0.0, floor_m=2.9).height_m == pytest.approx(3.0, abs=1e-3)  # the mission's own height is nearer to the floor


def test_changes_are_gradual_also_after_a_pause() -> None:
    orbit = Orbit(CONFIG, 1.0)
    orbit.update(0, 0.0, STRONG_BQ)
    radii, heights = [orbit.radius_m], [orbit.height_m]
    for tick in range(1, 60):
        orbit.update(tick * SECOND // 5, 0.0, STRONG_BQ)
        radii.append(orbit.radius_m)
        heights.append(orbit.height_m)
    assert max(a - b for a, b in pairwise(radii)) <= 2.0 * 0.2 + 1e-9
    assert max(a - b for a, b in pairwise(heights)) <= 0.5 * 0.2 + 1e-9
    assert min(radii) >= 5.0
    before = orbit.radius_m
    orbit.update(600 * SECOND, 30.0, STRONG_BQ)
    assert orbit.radius_m - before <= 2.0 + 1e-9


def test_a_nearest_distance_beyond_the_configured_radius_changes_nothing() -> None:
    orbit = Orbit(EncirclementConfig(radius_m=4.0, nearest_m=5.0), 1.5)
    for tick in range(100):
        orbit.update(tick * SECOND, 10.0, STRONG_BQ)
    assert orbit.radius_m == 4.0


def test_circles_next_to_each_other_are_the_separation_apart_in_height_too() -> None:
    mission = replace(MISSION, encirclement=CONFIG)
    assert [ring_lift_m(mission, ring) for ring in range(4)] == [0.0, 3.0, 0.0, 3.0]
    orbit = Orbit(CONFIG, 1.0)
    for tick in range(200):
        orbit.update(tick * SECOND // 5, 0.0, STRONG_BQ, ring_m=18.0, lift_m=3.0)
    assert orbit.height_m == pytest.approx(CONFIG.height_m + 3.0, abs=1e-3)


def test_a_second_height_is_approached_gradually_and_left_again() -> None:
    orbit, heights = Orbit(CONFIG, 1.0), []
    for tick in range(400):
        orbit.update(tick * SECOND // 5, 0.0, STRONG_BQ, least_m=6.0 if tick < 200 else 0.0)
        heights.append(orbit.height_m)
    assert max(abs(a - b) for a, b in pairwise(heights)) <= 0.5 * 0.2 + 1e-9
    assert heights[199] == pytest.approx(6.0, abs=1e-3)
    assert heights[-1] == pytest.approx(1.8, abs=1e-3)
    assert settled(20.0).height_m == pytest.approx(3.0, abs=1e-3)  # a wide circle is high enough without it


@pytest.mark.parametrize(
    ("values", "second_m"),
    [
        ({}, 6.0),
        ({"source_height_m": (0.0, 0.0)}, None),
        ({"area": replace(MISSION.area, ceiling_m=5.0)}, 1.5),  # the autopilots return at 4.5 m
        ({"area": replace(MISSION.area, ceiling_m=5.0), "limits": replace(MISSION.limits, separation_m=0.1)}, 3.1),
        ({"safety": SafetyConfig(return_height_m=7.0)}, 4.0),
    ],
    ids=["highest circle", "height known", "ceiling", "little separation", "layers"],
)
def test_the_second_height_is_below_all_that_others_fly_above_circles(values: dict[str, object], second_m: float | None) -> None:
    mission: MissionConfig = replace(MISSION, **{"encirclement": CONFIG, "source_height_m": (0.0, 20.0), **values})
    assert second_height_m(mission) == (None if second_m is None else pytest.approx(second_m))
