"""Who is on the circle when two drones last hear each other."""

import pytest

from agent.motion.reference import PeerState
from agent.navigation.contact import Circle

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
