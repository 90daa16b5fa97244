"""From one circle to another over the circles in between, on which drones may fly."""

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission, EncirclementConfig, SafetyConfig
from radron.agent.config.survey import SurveyConfig
from radron.agent.motion.orbit import ring_lift_m
from radron.agent.navigation.unheard.crossing import Crossing, WayHome, climb_s, crossing_height_m, is_over_m
from support.flights.one_pilot import MISSION

OVER_M = 16.0  # return height of d3
THREE = replace(
    MISSION,
    drones=tuple(DroneInMission(id=name) for name in ("d1", "d2", "d3")),
    safety=SafetyConfig(return_height_m=10.0, return_layer_m=3.0),
)


@pytest.mark.parametrize(
    ("far_m", "radius_m", "held_m"), [(9.0, 21.0, 9.0), (12.0, 21.0, 10.0), (21.0, 9.0, 21.0), (17.0, 9.0, 20.0)]
)
def test_it_climbs_where_it_is_clear_goes_across_and_comes_down(far_m, radius_m, held_m):
    """Across a circle of 15 m."""
    crossing = Crossing(THREE, "d3")
    assert crossing.course(far_m, 3.0, radius_m, [15.0]) == (held_m, OVER_M)
    assert crossing.climbs
    assert crossing.is_outside == (far_m > 15.0)
    assert crossing.course(held_m, 14.5, radius_m, [15.0]) == (held_m, OVER_M)
    assert crossing.course(held_m, 15.5, radius_m, [15.0]) == (radius_m, OVER_M)
    assert crossing.is_over
    for way_m in (15.0, 0.5 * (15.0 + radius_m), radius_m - 1.5):
        assert crossing.course(way_m, 16.0, radius_m, [15.0]) == (radius_m, OVER_M)
    assert crossing.course(radius_m - 0.5, 16.0, radius_m, [15.0]) == (radius_m, None)
    assert not crossing.climbs
    assert not crossing.is_outside
    assert not crossing.is_over
    assert crossing.course(radius_m, 5.0, radius_m, [15.0]) == (radius_m, None)


@pytest.mark.parametrize("taken_m", [[], [9.0], [27.0], [9.0, 27.0]])
def test_a_way_with_nobody_in_between_needs_no_climb(taken_m):
    assert Crossing(THREE, "d3").course(12.0, 3.0, 21.0, taken_m) == (21.0, None)


def test_it_crosses_well_above_the_circles_even_where_returns_are_lower():
    """Of these every second is higher by the separation. All keep their layers: lifted alone, some had crossed at one height."""
    low = replace(THREE, encirclement=EncirclementConfig(height_m=15.0))
    least_m = 15.0 + max(ring_lift_m(low, ring) for ring in range(3)) + THREE.limits.separation_m + 1.0
    for drone, layers in (("d1", 0), ("d3", 2)):
        over_m = least_m + layers * THREE.safety.return_layer_m
        assert Crossing(low, drone).course(9.0, 15.0, 21.0, [15.0]) == (9.0, over_m)


@pytest.mark.parametrize(("height_m", "ceiling_m", "highest_m"), [(12.0, 30.0, 27.0), (5.0, 15.0, 13.5), (10.0, 60.0, 24.0)])
def test_lifted_layers_stay_below_the_ceiling_and_apart(height_m, ceiling_m, highest_m):
    """Above it, a drone never got to its height: it climbed to the end."""
    area = replace(THREE.area, ceiling_m=ceiling_m)
    lifted = replace(THREE, encirclement=EncirclementConfig(height_m=height_m), area=area)
    heights_m = [crossing_height_m(lifted, drone.id) for drone in lifted.drones]
    assert max(heights_m) <= highest_m + 1e-9
    assert min(np.diff(heights_m)) > 0.4
    assert is_over_m(lifted, lifted.drones[-1].id) < ceiling_m - 0.5


def test_it_goes_home_above_those_that_it_does_not_hear_and_comes_down_there():
    way = WayHome(THREE, "d3")
    assert way.course((31.5, 1.0), (30.0, 1.0), 3.0, (0.0, 0.0), unheard=True) == ((30.0, 1.0), OVER_M)  # at its stopping point
    assert way.course((30.5, 1.5), (30.0, 1.5), 14.5, (0.0, 0.0), unheard=True) == ((30.0, 1.0), OVER_M)  # climbs there
    assert way.climbs
    for height_m in (15.5, 14.0, 16.0):
        assert way.course((15.0, 0.5), (15.0, 0.5), height_m, (0.0, 0.0), unheard=True) == ((0.0, 0.0), OVER_M)
    assert way.course((1.5, 0.0), (1.5, 0.0), 16.0, (0.0, 0.0), unheard=True) == ((0.0, 0.0), None)
    assert way.course((2.5, 0.0), (2.5, 0.0), 9.0, (0.0, 0.0), unheard=True) == (
        (0.0, 0.0),
        None,
    )  # blown away
    assert not way.climbs
    way.begin()
    assert way.course((30.0, 1.0), (30.0, 1.0), 3.0, (0.0, 0.0), unheard=True) == ((30.0, 1.0), OVER_M)


def test_it_stays_where_it_climbs_until_all_that_climb_have_passed_its_layer():
    """The drones climb together, at 2 m/s. Before, the lowest one set off at once, at the height of those that still climbed."""
    way = WayHome(THREE, "d3")
    for height_m in (3.0, 15.5, 16.0):
        assert way.course((30.0, 1.0), (30.0, 1.0), height_m, (0.0, 0.0), unheard=True, are_climbing=True) == (
            (30.0, 1.0),
            OVER_M,
        )
        assert way.climbs
    assert way.course((30.0, 1.0), (30.0, 1.0), 16.0, (0.0, 0.0), unheard=True) == ((0.0, 0.0), OVER_M)
    assert not way.climbs
    above_m = crossing_height_m(THREE, "d1") + THREE.limits.separation_m
    lowest_m = 2.3  # of a circle: the least height of the area, and a reserve
    assert lowest_m + THREE.limits.climb_mps * (climb_s(THREE, "d1") - 2.0) > above_m
    assert climb_s(THREE, "d2") == climb_s(THREE, "d3")  # nobody passes the highest layer


@pytest.mark.parametrize(
    ("changes", "lowest_m"),
    [
        ({}, 2.3),
        ({"survey": SurveyConfig(height_m=2.0)}, 2.0),
        ({"survey": SurveyConfig(strategy="map", height_m=8.0, low_height_m=2.0)}, 2.0),
        ({"encirclement": EncirclementConfig(height_m=8.0), "survey": SurveyConfig(height_m=5.0)}, 4.0),  # half as wide: 4 m
    ],
)
def test_the_longest_climb_begins_where_the_lowest_flight_is(changes, lowest_m):
    """Circles around a well-known source are lower than the search."""
    mission = replace(THREE, **changes)
    highest_m = crossing_height_m(mission, "d3")
    assert climb_s(mission, "d3") == pytest.approx(2.0 + (highest_m - lowest_m) / 2.0)


def test_one_that_leaves_home_fast_when_it_is_told_to_return_climbs_where_it_comes_to_rest():
    """The drone flew on low for 15 m, past the circling drones (1430512: 2.7 m)."""
    way = WayHome(THREE, "d3")
    assert way.course((1.5, 0.0), (7.0, 0.0), 3.0, (0.0, 0.0), unheard=True) == ((7.0, 0.0), OVER_M)
    assert way.climbs


def test_one_that_is_carried_away_from_home_low_climbs_again():
    way = WayHome(THREE, "d3")
    for place_m, height_m in ((9.0, 15.5), (1.0, 15.5), (1.0, 3.0), (5.5, 3.0)):
        way.course((place_m, 0.0), (place_m, 0.0), height_m, (0.0, 0.0), unheard=True)
    assert not way.climbs
    assert way.course((6.5, 0.0), (7.0, 0.0), 3.0, (0.0, 0.0), unheard=True) == ((7.0, 0.0), OVER_M)
    assert way.climbs


def test_it_waits_above_home_as_long_as_one_that_it_does_not_hear_may_search_there():
    way = WayHome(THREE, "d3")
    assert way.course((1.5, 0.0), (1.5, 0.0), 16.0, (0.0, 0.0), unheard=True, taken=True) == ((0.0, 0.0), OVER_M)
    assert way.comes_down  # and is not to land yet
    assert way.course((1.0, 0.0), (1.0, 0.0), 16.0, (0.0, 0.0), unheard=True) == ((0.0, 0.0), None)
    assert way.comes_down
    assert way.course((0.5, 0.0), (0.5, 0.0), 3.0, (0.0, 0.0), unheard=True, taken=True) == (
        (0.0, 0.0),
        None,
    )  # down
    assert not way.comes_down


def test_the_way_home_is_low_where_all_are_heard():
    way = WayHome(THREE, "d3")
    assert way.course((30.0, 1.0), (30.0, 1.0), 3.0, (0.0, 0.0), unheard=False) == ((0.0, 0.0), None)
    assert way.course((20.0, 1.0), (20.0, 1.0), 3.0, (0.0, 0.0), unheard=True) == ((20.0, 1.0), OVER_M)
    assert way.course((20.0, 1.0), (20.0, 1.0), 9.0, (0.0, 0.0), unheard=False) == ((0.0, 0.0), None)  # heard again
    assert way.course((9.0, 1.0), (8.0, 1.0), 3.0, (0.0, 0.0), unheard=True) == ((8.0, 1.0), OVER_M)  # and not back there
