"""The circles that drones keep clear of which do not hear each other."""

import numpy as np
import pytest
from msgspec.structs import replace
from one_pilot import MISSION

from agent.config.mission import DroneInMission
from agent.motion.orbit import ring_radius_m
from agent.navigation.crossing import CLEAR_M
from agent.navigation.sharing import SharedCircle
from agent.navigation.silent import Absence

FOUR = replace(MISSION, drones=tuple(DroneInMission(id=name) for name in ("d1", "d2", "d3", "d4")))
RADII_M = [ring_radius_m(FOUR, ring, fits_hypothesis=False) for ring in range(4)]


def lines(missing, ring, far_m):
    """Distances from the centre of the lines that a drone on that circle, or so far from the centre, keeps between."""
    absence = Absence(missing, (), ring, (), {}, alone=False, stops=np.zeros((0, 2)), coming_home=())
    ahead = np.array([[far_m, 0.0, 3.0]])
    found = SharedCircle(FOUR, "d2").others(absence, 0, (0.0, 0.0, 0.0), ahead, 0.2, fits_hypothesis=False)
    return [(one.positions[0][0], float(one.away[0, 0])) for one in found]


def test_it_keeps_between_the_circles_of_those_that_it_does_not_hear():
    assert lines(("d4",), 1, RADII_M[1]) == [(pytest.approx(RADII_M[3]), -1.0)]
    assert lines(("d2", "d4"), 0, RADII_M[0]) == [(pytest.approx(RADII_M[1]), -1.0)]


@pytest.mark.parametrize("missing", [("d1",), ("d1", "d3"), ("d1", "d4")])
def test_one_that_belongs_inside_may_climb_outside_before_it_crosses(missing):
    """It was further away when it was heard last, and keeps clear of the circle while it climbs."""
    assert lines(missing, 1, RADII_M[1]) == [(pytest.approx(RADII_M[0]), 1.0), (pytest.approx(RADII_M[1] + CLEAR_M), -1.0)]


def test_who_is_further_away_itself_is_on_the_way_in():
    assert lines(("d1",), 1, RADII_M[1] + CLEAR_M + 0.5) == [(pytest.approx(RADII_M[0]), 1.0)]
