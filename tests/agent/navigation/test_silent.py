"""On which circle a drone flies while some of the others are not heard, or do not hear it."""

import pytest

from agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from agent.navigation.peers import Peers
from agent.navigation.silent import LEFT_S, Silent
from protocol.messages import Stage, Status

NAMES = ("a", "b", "c", "d")
MISSION = MissionConfig(
    name="test",
    area=AreaConfig(polygon_m=((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))),
    drones=tuple(DroneInMission(id=name) for name in NAMES),
)


NOW_NS = 10**12


def ring(me, missing, hears, obeying=(), since_s=LEFT_S):
    """The circle of a drone that hears all but the missing ones.

    ``hears``: whom each of these says that it hears; ``obeying``: revoked drones that are known to go home since so long.
    """
    peers = Peers([name for name in NAMES if name != me])
    for name, heard in hears.items():
        delays_ns = dict.fromkeys(heard, 1_000_000)
        told = Status(stamp_ns=0, drone=name, mission="0" * 16, boot="1" * 16, stage=Stage.TRACK, delays_ns=delays_ns)
        assert peers.receive(told, 0) is None
    silent = Silent(MISSION, me)
    for name in obeying:
        silent.obeys(name, NOW_NS - round(since_s * 1e9))
        silent.obeys(name, NOW_NS)  # told again and again
    return silent.absence(missing, tuple(hears), peers, NOW_NS).ring


def test_two_sides_fly_on_the_circles_of_their_first():
    assert [ring("a", ("c", "d"), {"b": "a"}), ring("b", ("c", "d"), {"a": "b"})] == [0, 0]
    assert [ring("c", ("a", "b"), {"d": "c"}), ring("d", ("a", "b"), {"c": "d"})] == [2, 2]


def test_two_that_hear_the_others_but_are_heard_by_nobody_do_not_meet_on_the_others_circle():
    """Both with the others on the first circle, c and d came to 2 m: neither heard the other one there."""
    assert ring("c", ("d",), {"a": "b", "b": "a"}) == 2
    assert ring("d", ("c",), {"a": "b", "b": "a"}) == 3


@pytest.mark.parametrize("me", ["c", "d"])
def test_two_that_one_in_between_hears_stay_on_one_circle(me):
    other = "d" if me == "c" else "c"
    assert ring(me, (other,), {"a": "bcd", "b": "acd"}) == 0


def test_the_circle_that_a_revoked_drone_has_left_is_shared_by_the_others():
    """On circles of their own, 6 m wider and 3 m higher, they lost a moving source by 3 m, for a drone that had long landed."""
    hears = {"c": "b", "d": "b"}
    assert ring("b", ("a",), hears) == 1  # it is not known to obey: it may circle
    assert ring("b", ("a",), hears, obeying="a", since_s=LEFT_S - 1.0) == 1  # and may still be climbing
    assert ring("b", ("a",), hears, obeying="a") == 0


def test_who_may_still_circle_is_kept_apart_from_beside_one_that_has_left():
    assert ring("b", ("a", "d"), {"c": "b"}, obeying="a") == 1
    assert ring("b", ("a", "d"), {"c": "b"}, obeying="ad") == 0
