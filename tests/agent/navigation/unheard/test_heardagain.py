"""Drones that are heard again, after a jump of their localisation while the link was lost."""

from math import dist

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.navigation.myself import Self
from radron.agent.navigation.neighbours import Neighbourhood
from radron.agent.navigation.peers.newest import Peers
from radron.protocol.messages import Stage
from support.flights.two_drones import MISSION, SECOND, pose, status

HEARD = replace(pose(), position_m=(-40.0, 0.0, 3.0), velocity_mps=(0.0, 0.0, 0.0))  # at (10, -40)
HOME = (10.0, 0.0)


def heard_again(silent_s, epoch=1, stage=Stage.SURVEY, heard_s=0.5, **more):
    """Peer b is silent for that long, at a place unknown to its new localisation, and heard again for half a second."""
    peers, hood = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    me = Self(0, 0, 0.1, Transform(), ahead=lambda: np.tile((0.0, 0.0, 3.0), (21, 1)), height_m=3.0, **more)
    for message in (replace(HEARD, steered=stage is not Stage.HOLD), status(stage)):
        assert peers.receive(message, 0) is None
    hood.around(peers, me)
    for tenth in range(1, round(10 * silent_s)):
        hood.around(peers, replace(me, now_ns=tenth * SECOND // 10))
    for tenth in range(round(10 * heard_s)):
        now_ns = round(silent_s * SECOND) + tenth * SECOND // 10
        assert peers.receive(replace(HEARD, stamp_ns=now_ns, epoch=epoch, steered=False), now_ns) is None
        assert peers.receive(replace(status(Stage.HOLD), stamp_ns=now_ns), now_ns) is None
        found = hood.around(peers, replace(me, now_ns=now_ns))
    return [one.plan.at(now_ns) for one in found], hood, peers, replace(me, now_ns=now_ns)


@pytest.mark.parametrize("silent_s", [15.0, 60.0])  # a way of 40 m, after a climb of 11 m
def test_one_may_have_flown_home_while_it_was_not_heard_and_its_localisation_jumped(silent_s):
    """By continuity alone it was expected where it was heard last, 40 m from there."""
    found, *_ = heard_again(silent_s)
    assert min(dist(one, (10.0, -40.0)) for one in found) < 1.0
    assert min(dist(one, HOME) for one in found) < 6.0


def test_it_may_still_be_on_its_way_home_if_it_is_silent_once_more():
    """The drone holds then, and a hold leads nowhere: after a second without a message it was expected by continuity only."""
    _, hood, peers, me = heard_again(60.0)
    for tenth in range(1, 21):
        now_ns = me.now_ns + tenth * SECOND // 10
        found = hood.around(peers, replace(me, now_ns=now_ns))
        assert min(dist(one.plan.at(now_ns), HOME) for one in found) < 6.0
    assert peers.receive(replace(HEARD, stamp_ns=now_ns, epoch=1, steered=False), now_ns) is None
    found = hood.around(peers, replace(me, now_ns=now_ns))
    assert min(dist(one.plan.at(now_ns), HOME) for one in found) < 6.0


def test_it_waits_where_it_was_on_its_way_home_to_a_revoked_drone_as_well():
    """The revoked drone expected it to fly on home for as long as it was heard again."""
    found, *_ = heard_again(5.0, heard_s=20.0, revoked=True)
    assert max(y for _, y in found) < -15.0


@pytest.mark.parametrize(("silent_s", "epoch", "stage"), [(9.0, 0, Stage.SURVEY), (3.0, 1, Stage.SURVEY), (9.0, 1, Stage.HOLD)])
def test_it_is_where_it_was_if_it_has_not_jumped_or_had_no_time_or_held(silent_s, epoch, stage):
    found, *_ = heard_again(silent_s, epoch, stage)
    assert max(dist(one, (10.0, -40.0)) for one in found) < 13.0


def test_it_is_where_its_frame_tells_once_that_is_known():
    _, hood, peers, me = heard_again(60.0)
    hood.frames._graph.place("b", 1, Transform(np.pi / 2, (10.0, 45.0, 0.0)))
    (one,) = hood.around(peers, me)
    assert one.plan.at(me.now_ns) == pytest.approx((10.0, 5.0), abs=0.1)
