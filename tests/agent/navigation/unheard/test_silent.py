"""On which circle a drone flies while some of the others are not heard, or do not hear it."""

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.unheard.contact import link_state
from radron.agent.navigation.unheard.relayed import LEAVING_NS, is_kept
from radron.agent.navigation.unheard.silent import LEFT_S, Silent
from radron.protocol.messages import Pose, Stage

NAMES = ("a", "b", "c", "d")
MISSION = MissionConfig(
    name="test",
    area=AreaConfig(polygon_m=((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))),
    drones=tuple(DroneInMission(id=name) for name in NAMES),
)


NOW_NS = 10**12
DOWN = Pose(
    stamp_ns=NOW_NS,
    drone="a",
    epoch=0,
    position_m=(0.0, 0.0, 0.0),
    velocity_mps=(0.0, 0.0, 0.0),
    quaternion=(1.0, 0.0, 0.0, 0.0),
    position_sigma_m=0.1,
    yaw_sigma_rad=0.01,
)


def ring(me, missing, hears, obeying=(), since_s=LEFT_S, home=()):
    """The circle of a drone that hears all but the missing ones.

    ``hears``: the peers that each of these reports to hear; ``obeying``: revoked drones known to return, for that long;
    ``home``: the heard peers that have returned.
    """
    peers = Peers([name for name in NAMES if name != me])
    for name in missing:  # lost just now
        assert peers.receive(replace(DOWN, drone=name), NOW_NS) is None
    for name, heard in hears.items():
        stage = Stage.LANDED if name in home else Stage.TRACK
        told = replace(DOWN, drone=name, stage=stage, silences_ns=dict.fromkeys(heard, 0))
        assert peers.receive(told, NOW_NS) is None
    silent = Silent(MISSION, me)
    for name in obeying:
        silent.beliefs[name].obeys_ns = NOW_NS - round(since_s * 1e9)
    partners = [name for name in hears if name not in home]
    links = {name: link_state(peers[name], me, NOW_NS, revoked=False) for name in peers.names}
    return silent.absence(missing, partners, peers, links, NOW_NS).ring


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
    assert ring("b", ("a",), hears) == 1  # not known to obey: may circle
    assert ring("b", ("a",), hears, obeying="a", since_s=LEFT_S - 1.0) == 1  # and may still be climbing
    assert ring("b", ("a",), hears, obeying="a") == 0


def test_who_may_still_circle_is_kept_apart_from_beside_one_that_has_left():
    """The first that are left share the circle. The others stay on theirs, whether they know that it has been left or not."""
    assert ring("b", ("a", "d"), {"c": "b"}, obeying="a") == 0
    assert ring("b", ("a", "d"), {"c": "b"}, obeying="ad") == 0
    assert [ring("d", ("a", "b", "c"), {}, obeying="a"), ring("d", ("a", "b", "c"), {})] == [3, 3]
    assert ring("c", ("b", "d"), {}, obeying="") == 2  # a is on the ground and not heard: others may hear it
    assert ring("c", ("a", "b", "d"), {}, obeying="ab") == 0  # alone on its own, 17 m from the source, it was lost by 2 m


def test_a_side_stays_on_its_circle_when_its_first_one_returns():
    """The last of three circled 19 m from the source, or had no room and went home: the second one was dead, the first had
    landed.
    """
    assert ring("c", ("b", "d"), {"a": "c"}) == 0
    assert ring("c", ("b", "d"), {"a": "c"}, home="a") == 0
    assert ring("c", ("b", "d"), {"a": ""}, home="a") == 2  # no link in that direction


def test_the_circle_of_one_that_has_returned_is_nobody_s_while_it_is_heard_by_two_sides():
    assert [ring("c", ("d",), {"a": "cd"}, home="a"), ring("d", ("c",), {"a": "cd"}, home="a")] == [2, 3]
    assert [ring("c", ("d",), {"a": "c"}, home="a"), ring("d", ("c",), {"a": "c"}, home="a")] == [0, 3]


@pytest.mark.parametrize("own", [True, False])
def test_a_place_on_the_circle_stays_free_for_five_seconds_after_the_last_contact_whichever_side_had_it(own):
    """A partner's contact was forgotten after a second, the own one after five."""

    def kept(since_ns):
        peers = Peers(["b", "c"])
        silence_ns = 2 * LEAVING_NS if own else since_ns
        assert peers.receive(replace(DOWN, drone="b", silences_ns={"c": silence_ns}), NOW_NS) is None
        return is_kept("c", NOW_NS - (since_ns if own else 2 * LEAVING_NS), ["b"], peers, NOW_NS)

    assert kept(LEAVING_NS - 1)
    assert not kept(LEAVING_NS)
