"""The circles of which drones without a link to each other keep clear."""

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission
from radron.agent.motion.orbit import ring_radius_m
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.unheard.absence import Absence
from radron.agent.navigation.unheard.crossing import CLEAR_M
from radron.agent.navigation.unheard.sharing import SharedCircle
from support.flights.one_pilot import MISSION, SECOND

FOUR = replace(MISSION, drones=tuple(DroneInMission(id=name) for name in ("d1", "d2", "d3", "d4")))
RADII_M = [ring_radius_m(FOUR, ring, fits_hypothesis=False) for ring in range(4)]


def kept_from(missing, ring, far_m, left=(), climbs=False):
    """The bounds within which a drone on that circle, or that far from the centre, stays."""
    absence = Absence(missing, (), ring, (), {}, alone=False, stops=np.zeros((0, 2)), coming_home=(), left=left)
    ahead = np.array([[far_m, 0.0, 3.0]])
    return SharedCircle(FOUR, "d2").others(absence, 0, (0.0, 0.0, 0.0), ahead, 0.2, fits_hypothesis=False, climbs=climbs)


def lines(missing, ring, far_m, left=(), climbs=False):
    """Distances from the centre of the lines that it keeps between."""
    found = kept_from(missing, ring, far_m, left, climbs)
    return [(one.positions[0][0], float(one.away[0, 0])) for one in found]


def test_it_keeps_between_the_circles_of_those_that_it_does_not_hear():
    assert lines(("d4",), 1, RADII_M[1]) == [(pytest.approx(RADII_M[3]), -1.0)]
    assert lines(("d2", "d4"), 0, RADII_M[0]) == [(pytest.approx(RADII_M[1]), -1.0)]


def test_nobody_keeps_from_a_circle_that_a_revoked_drone_has_left():
    """The others fly on it themselves: two drones climbing for home were pushed together inside it, to 2.7 m."""
    assert lines(("d1",), 0, RADII_M[0] - 1.0, climbs=True) == [(pytest.approx(RADII_M[0]), -1.0)]
    assert lines(("d1",), 0, RADII_M[0] - 1.0, left=("d1",), climbs=True) == []
    assert lines(("d1", "d4"), 1, RADII_M[1], left=("d1",)) == [(pytest.approx(RADII_M[3]), -1.0)]


def test_the_first_that_may_circle_is_also_expected_on_the_circle_that_the_ones_before_it_have_left():
    alone = lines(("d1", "d2", "d3"), 3, RADII_M[0] + 0.1, left=("d1", "d2"), climbs=True)
    assert alone == [(pytest.approx(RADII_M[0]), 1.0), (pytest.approx(RADII_M[2]), -1.0)]


@pytest.mark.parametrize("missing", [("d1",), ("d1", "d3"), ("d1", "d4")])
def test_one_that_belongs_inside_may_climb_outside_before_it_crosses(missing):
    """At the last contact the drone was further away; it keeps clear of the circle while it climbs."""
    assert lines(missing, 1, RADII_M[1]) == [(pytest.approx(RADII_M[0]), 1.0), (pytest.approx(RADII_M[1] + CLEAR_M), -1.0)]


@pytest.mark.parametrize(("away_m", "keeps"), [(6.0, True), (3.5, True), (2.5, False), (-1.0, False)])
def test_one_that_hovers_as_its_circle_has_no_room_keeps_from_the_one_inside_that_it_is_clear_of(away_m, keeps):
    """Others followed the source towards four hovering drones, which did not account for them. A drone on that circle, or
    inside of it, would flee outward.
    """
    absence = Absence(("d1",), (), 1, (), {}, alone=False, stops=np.zeros((0, 2)), coming_home=())
    ahead = np.array([[RADII_M[0] + away_m, 0.0, 3.0]])
    found = SharedCircle(FOUR, "d2").inner(absence, 0, (0.0, 0.0, 0.0), ahead, 0.2, fits=False)
    assert [one.positions[0][0] for one in found] == ([pytest.approx(RADII_M[0])] if keeps else [])


def test_who_is_further_away_itself_is_on_the_way_in():
    assert lines(("d1",), 1, RADII_M[1] + CLEAR_M + 0.5) == [(pytest.approx(RADII_M[0]), 1.0)]


def test_its_lines_are_tangents_of_circles_around_the_centre():
    for line in kept_from(("d1", "d4"), 1, RADII_M[1]):
        centre = np.array(line.positions[0][:2]) + line.radius_m * line.away[0]
        assert centre == pytest.approx((0.0, 0.0))


@pytest.mark.parametrize(
    ("stops", "far_m", "expected_m"),
    [
        (1, 10.0, [10.0 - CLEAR_M]),
        (0, 10.0, []),  # all hovering drones have left, and each partition is on its own circle
        (1, 14.0, [10.0 - CLEAR_M]),
        (1, 6.9, []),  # on its way to the circle, from inside
    ],
)
def test_nobody_evades_through_the_middle_of_the_circle_while_vehicles_may_hover_on_it(stops, far_m, expected_m):
    """Of six in a partition of three sides, two met there (1.2 m): to each of them the middle was the place farthest from all."""
    absence = Absence(("d1",), (), 0, (), {}, alone=False, stops=np.full((stops, 2), 10.0), coming_home=())
    ahead = np.array([[far_m, 0.0, 3.0]])
    found = SharedCircle(FOUR, "d2").middle(absence, 0, (0.0, 0.0, 0.0), ahead, 0.2, 10.0)
    assert [(one.positions[0][0], float(one.away[0, 0])) for one in found] == [(pytest.approx(r), 1.0) for r in expected_m]


@pytest.mark.parametrize("stands", [True, False])
def test_the_place_of_one_that_is_missing_is_as_far_along_its_plan_as_it_got(stands):
    """At 5.4 m/s towards its place on the circle it stopped 10 m farther on than where it was heard last, and was run into."""
    circle, radius_m, speed_mps = SharedCircle(FOUR, "d2"), 10.0, 5.4
    turned = speed_mps / radius_m * np.arange(5.0)
    way = np.column_stack((radius_m * np.cos(turned), radius_m * np.sin(turned), np.full(5, 3.0)))
    plan = PeerPlan("d3", 0, 1.0, list(map(tuple, way.tolist())))
    centre, absence = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), Absence(("d3",), (), 0, ("d3",), {}, False, np.zeros((0, 2)), ())
    circle.places(SECOND, {"d3": plan}, None, centre, radius_m)
    (found,) = circle.places(2 * SECOND, {}, absence, centre, radius_m, stands).values()
    x, y, _ = found.position
    expected = turned[1] + (speed_mps if stands else FOUR.encirclement.speed_mps) / radius_m
    assert np.arctan2(y, x) == pytest.approx(expected)
    assert np.hypot(*found.velocity[:2]) == pytest.approx(0.0 if stands else FOUR.encirclement.speed_mps)


@pytest.mark.parametrize(
    ("name", "x_m", "speed_mps", "blind", "crossed"),
    [
        ("d4", 15.0, 3.0, False, True),
        ("d4", 25.0, 3.0, False, False),
        ("d4", 15.0, 0.3, False, False),  # waiting over its home
        ("d4", 15.0, 3.0, True, False),  # held by its pilot, or in its autopilot's return: of unlimited length
        ("d3", 15.0, 3.0, False, False),
    ],
)
def test_who_circles_lets_those_pass_that_come_home_across_the_circle(name, x_m, speed_mps, blind, crossed):
    """Flying on into the midst of four of them, with two ahead and two behind, it was carried home with them. d3 circles, too."""
    way = [(x_m, 0.0, 3.0), (x_m - 4.0 * speed_mps, 0.0, 3.0)]
    other, partner = PeerPlan(name, 0, 4.0, way, blind=blind), PeerPlan("d3", 0, 4.0, way)
    assert SharedCircle(FOUR, "d2").is_crossed(0, (0.0, 0.0, 0.0), 10.0, [other], {"d3": partner}) == crossed
