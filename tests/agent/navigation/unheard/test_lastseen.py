"""Drones that are not heard, but were seen, and are hidden."""

from math import dist

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import SafetyConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.navigation.myself import Self
from radron.agent.navigation.neighbours import Neighbourhood
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.peers.placing import WORST_SIGMA_M
from radron.protocol.messages import Stage
from support.flights.two_drones import MISSION, SECOND, pose, sighting, status

FAR = replace(pose(), position_m=(-40.0, 0.0, 3.0))  # at (10, -40)
HIDDEN_S = 20.0
LAST = (24.0, 10.0)


def at(second):
    """b, 3 m above the ground: it has flown straight at 6 m/s for 5 s when it is hidden."""
    return 24.0, 10.0 - 6.0 * (HIDDEN_S - second), 3.0


def me(second, **more):
    return Self(
        round(second * SECOND), 0, 0.1, Transform(), ahead=lambda: np.tile((0.0, 0.0, 3.0), (21, 1)), height_m=3.0, **more
    )


def seen_after(heard=(), until_s=HIDDEN_S, mission=MISSION, **more):
    """The neighbours of a while it sights b for 5 s, last heard at 0, if at all."""
    peers, hood = Peers(["b"]), Neighbourhood(mission, FrameGraph.from_launch_layout(mission), "a")
    for message in heard:
        assert peers.receive(message, 0) is None
    for second in np.arange(HIDDEN_S - 5.0, until_s, 0.2).tolist():
        peers.see(sighting(second, at(second)))
        hood.around(peers, me(second, **more))
    return peers, hood


def nearest_m(found, second, place):
    """From a place to the nearest one where b is expected then."""
    now_ns = round(second * SECOND)
    return min(dist(one.plan.at(now_ns), place) for one in found)


@pytest.mark.parametrize("hidden_s", [3.5, 5.0, 7.0])
def test_one_that_is_hidden_is_expected_from_where_it_was_seen_and_not_where_its_last_pose_led(hidden_s):
    """Its last pose, of 20 s before, is 50 m from there."""
    peers, hood = seen_after((FAR, status(Stage.SURVEY)))
    second = HIDDEN_S + hidden_s
    found = [one for one in hood.around(peers, me(second)) if one.plan.away is None]
    assert nearest_m(found, second, LAST) < 1.5
    assert all(one.plan.blind and not one.takes_part for one in found)
    assert nearest_m(found, second, (10.0, -40.0)) > 30.0


def test_its_place_is_the_more_doubtful_the_longer_it_is_hidden():
    """The drone may have flown on, anywhere; but a drone that was lost must not drive the swarm away for good."""
    peers, hood = seen_after((FAR, status(Stage.SURVEY)))
    sigmas = []
    for hidden_s in (3.5, 5.0, 7.0):
        second = HIDDEN_S + hidden_s
        stops = min(hood.around(peers, me(second)), key=lambda one: dist(one.plan.at(round(second * SECOND)), LAST))
        sigmas.append(stops.plan.sigma_m)
    assert 1.0 < sigmas[0] < sigmas[1] < sigmas[2] <= WORST_SIGMA_M
    assert hood.around(peers, me(HIDDEN_S + 300.0)) == []


def test_what_was_seen_before_it_was_heard_again_does_not_count():
    peers, hood = seen_after((FAR, status(Stage.SURVEY)))
    heard_ns = round((HIDDEN_S + 4.0) * SECOND)
    assert peers.receive(pose(heard_ns), heard_ns) is None
    second = HIDDEN_S + 8.0
    found = hood.around(peers, me(second))
    assert nearest_m(found, second, LAST) > 10.0
    assert nearest_m(found, second, (10.0, 1.0)) < 1.5


@pytest.mark.parametrize("resumed", [False, True])
def test_one_that_was_never_heard_is_where_it_is_seen_to_fly(resumed):
    """A drone revoked before this agent's restart, or out of reach: no other data give its position."""
    until_s = HIDDEN_S
    peers, hood = seen_after(until_s=until_s, resumed=resumed)
    (one,) = hood.around(peers, me(until_s, resumed=resumed))
    assert dist(one.plan.at(round(until_s * SECOND)), LAST) < 2.0
    assert one.plan.blind
    hidden = hood.around(peers, me(HIDDEN_S + 4.0, resumed=resumed))
    assert nearest_m(hidden, HIDDEN_S + 4.0, LAST) < 1.5


def test_to_a_revoked_drone_too_one_that_was_never_heard_is_the_more_doubtful_the_longer_it_is_hidden():
    """The drone counted as silent for so long that it had to be home by then: its place seemed to be exact."""
    peers, hood = seen_after(revoked=True)
    second = HIDDEN_S + 4.0
    found = hood.around(peers, me(second, revoked=True))
    stops = min(found, key=lambda one: dist(one.plan.at(round(second * SECOND)), LAST))
    assert stops.plan.sigma_m > 1.0


@pytest.mark.parametrize("heard", [(), (FAR, status(Stage.SURVEY))])
def test_the_place_of_one_that_holds_without_its_agent_is_as_doubtful_as_it_was_seen(heard):
    """The drone counted as placed by its pose, at 0.3 m. Its uncertainty does not grow, as that would drive the swarm away."""
    peers, hood = seen_after(heard, mission=replace(MISSION, safety=SafetyConfig(agent_lost="hold")))
    for hidden_s in (4.0, 300.0):
        second = HIDDEN_S + hidden_s
        found = [one for one in hood.around(peers, me(second)) if one.plan.away is None]
        assert nearest_m(found, second, LAST) < 1.5
        assert [one.plan.sigma_m for one in found] == [pytest.approx(1.0, abs=0.1)]


def test_one_that_was_never_heard_and_stands_on_the_ground_is_in_nobody_s_way():
    peers, hood = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    for second in np.arange(0.0, 3.0, 0.2).tolist():
        peers.see(sighting(second, (8.0, 0.0, 0.2)))
    assert hood.around(peers, me(3.0)) == []
