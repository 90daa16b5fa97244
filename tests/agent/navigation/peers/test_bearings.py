"""The directions in which a drone sees others."""

from math import cos, pi, sin

import pytest

from radron.agent.navigation.peers.bearings import freest_bearing, seen_bearings
from radron.agent.navigation.peers.newest import Peers
from radron.protocol.entries import Sighting

SECOND = 1_000_000_000


def sighting(target, bearing, stamp_ns=0, epoch=0):
    direction, told = (cos(bearing), sin(bearing), 0.0), {"mission": "0" * 16, "boot": "1" * 16, "sequence": 1}
    at = {"stamp_ns": stamp_ns, "drone": "a", "epoch": epoch, "position_m": (0.0, 0.0, 3.0)}
    return Sighting(**told, **at, target=target, direction=direction, direction_sigma_rad=0.03)


@pytest.mark.parametrize(
    ("seen", "freest"), [((), pi), ((0.3,), 0.3 + pi), ((0.0, 3.0), -0.5 * (2.0 * pi - 3.0)), ((-3.0, -1.0, 2.9), 0.95)]
)
def test_one_moves_to_where_the_gap_between_others_is_widest(seen, freest):
    found = freest_bearing(seen)
    assert (cos(found), sin(found)) == pytest.approx((cos(freest), sin(freest)))


def test_of_each_that_was_seen_of_late_the_usual_direction_counts_and_not_a_false_one():
    peers = Peers(["b", "c", "d"])
    for stamp_ns, bearing in ((0, -2.0), (4, 1.0), (5, -1.5), (6, 1.1), (7, 1.05)):
        peers.see(sighting("b", bearing, stamp_ns * SECOND // 2))
    peers.see(sighting("c", -3.1, 3 * SECOND))
    peers.see(sighting("d", 0.0, 3 * SECOND, epoch=1))
    assert seen_bearings(peers, 0, 7 * SECOND // 2) == pytest.approx([-3.1, 1.05])
