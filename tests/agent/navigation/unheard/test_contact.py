"""The drones on the circle at the last contact of two drones, and the separation line between the two."""

import math

import pytest

from radron.agent.motion.reference import PeerState
from radron.agent.navigation.unheard.contact import Circle, wall_between

AT_REST = Circle((20.0, 10.0), (0.0, 0.0), 10.0, 3.0)
WITH_ITS_SOURCE = Circle((20.0, 10.0), (0.0, -2.0), 10.0, 3.0)


@pytest.mark.parametrize(
    ("circle", "x", "velocity", "is_on"),
    [
        (AT_REST, 30.0, (0.0, 3.0), True),  # flies along
        (AT_REST, 30.0, (0.0, 0.0), True),  # stands
        (AT_REST, 32.0, (-1.0, 3.5), True),  # nearly there
        (AT_REST, 34.0, (0.0, 3.0), False),
        (AT_REST, 26.0, (0.0, 3.0), False),
        (AT_REST, 30.0, (-2.0, 2.0), False),  # flies across
        (AT_REST, 30.0, (2.0, 2.0), False),
        (AT_REST, 30.0, (0.0, -2.0), False),  # against the turn
        (AT_REST, 30.0, (0.0, 5.0), False),  # to its place farther along
        (AT_REST, 20.0, (0.0, 0.0), False),
        (WITH_ITS_SOURCE, 30.0, (0.0, -2.0), True),
        (WITH_ITS_SOURCE, 30.0, (0.0, 1.0), True),
        (WITH_ITS_SOURCE, 30.0, (0.0, 3.0), False),
    ],
)
def test_who_is_near_the_circle_and_goes_with_it_has_arrived(circle, x, velocity, is_on):
    assert circle.has(PeerState((x, 10.0, 3.0), (*velocity, 0.0))) is is_on


@pytest.mark.parametrize(
    ("mine_mps", "theirs_mps", "x"),
    [
        ((0.0, 0.0), (0.0, 0.0), 5.0),
        ((-6.0, 0.0), (-4.0, 1.0), 0.0),  # both fly on, one behind the other
        ((-4.0, 0.0), (0.0, 0.0), 3.0),
        ((-9.0, 0.0), (9.0, 0.0), 5.0),  # at each other, and past each other
    ],
)
def test_the_line_is_half_way_between_where_both_get_until_they_notice(mine_mps, theirs_mps, x):
    """And the same for both. With a line half-way between their places, the drone flying behind stopped beyond it."""
    one, other = PeerState((10.0, 2.0, 3.0), (*mine_mps, 0.0)), PeerState((0.0, 2.0, 5.0), (*theirs_mps, 0.0))
    wall, theirs = wall_between(one, other), wall_between(other, one)
    assert (*wall.normal, wall.offset) == pytest.approx((1.0, 0.0, x))
    assert (*theirs.normal, theirs.offset) == pytest.approx((-1.0, 0.0, -x))
    assert math.isfinite(wall_between(one, one).offset)
