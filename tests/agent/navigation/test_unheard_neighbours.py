import math
from functools import partial

import msgspec
import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission, SafetyConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.myself import Self
from radron.agent.navigation.neighbours import Neighbourhood
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.unheard.contact import Circle, Wall
from radron.agent.navigation.unheard.lastnews import LastNews
from radron.protocol.entries import Sighting
from radron.protocol.messages import Stage
from support.flights.two_drones import MISSION, SECOND, plan, pose, status

STANDING = PeerState((0.0, 0.0, 3.0))
ON_GROUND = replace(pose(), velocity_mps=(0.0, 0.0, 0.0), in_air=False)
BOTH_ON = Circle((5.0, 0.0), (0.0, 0.0), 5.0, 3.0)  # a stands on it at (0, 0), b flies along it about (10, 0)
HALF_WAY_M = (
    0.5 * (10.0 * 10.0 + 1.0 * 3.0) / math.hypot(10.0, 1.0)
)  # of the way from (0, 0) to (10, 3), in the direction of (10, 1)
ON_THE_WAY = Circle((12.0, 0.0), (0.0, 0.0), 5.0, 3.0)  # a is not there yet


def after_silence(seconds, stage=Stage.TRACK, steered=True):
    """b was heard at 0, at x = 1 m of its frame and going on at 2 m/s."""
    peers, now_ns = Peers(["b"]), round(seconds * SECOND)
    told = replace(pose(), steered=steered) if stage is not Stage.LANDED else ON_GROUND
    for message in (told, status(stage)):
        assert peers.receive(message, 0) is None
    found = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a").around(peers, Self(now_ns, 0, 0.1, Transform()))
    return found, now_ns


def test_a_drone_that_is_heard_no_more_may_stop_or_be_on_its_way_home():
    """b flew at (10, 1) m, along y at 2 m/s; home is at (10, 0)."""
    stops, comes_home = (one.plan for one in after_silence(5.0)[0])
    x, y, _ = stops.positions[0]
    assert (x, y) == pytest.approx((10.0, 2.0), abs=1e-6)  # nearest to a, between the nearest and the farthest stop
    assert comes_home.positions[0][:2] == pytest.approx((10.0, 0.0), abs=1e-6)
    assert stops.blind
    assert not any(one.takes_part for one in after_silence(1.5)[0])


@pytest.mark.parametrize("seconds", [1.5, 5.0, 16.0, 30.0])
def test_what_a_revoked_drone_tells_frees_the_circle_and_nothing_else(seconds):
    """Its possible positions, until it must be down, follow from its last pose, whatever it or an impostor with its key says."""
    found = []
    for tells in (False, True):
        hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
        for message in (pose(), status(Stage.TRACK)):
            assert peers.receive(message, 0) is None
        if tells:
            hood.obeys("b", 0)
        around = hood.around(peers, Self(round(seconds * SECOND), 0, 0.1, Transform(), excluded={"b"}))
        found.append([(one.plan.positions, one.plan.sigma_m, one.plan.blind, one.takes_part) for one in around])
    assert found[0] == found[1] != []


@pytest.mark.parametrize(
    ("localization", "agent_lost"), [("slam", "return"), ("rtk", "hold"), ("rtk", "land"), ("rtk", "return")]
)
@pytest.mark.parametrize("excluded", [False, True])
def test_one_that_is_revoked_is_flown_home_by_its_agent_whatever_its_autopilot_would_do(localization, agent_lost, excluded):
    """The revoked drone was expected to stay where it was, and a peer was 2 m from it when it landed at its home."""
    a, b = MISSION.drones
    mission = replace(MISSION, drones=(a, replace(b, localization=localization)), safety=SafetyConfig(agent_lost=agent_lost))
    graph, peers = FrameGraph.from_launch_layout(MISSION), Peers(["b"])
    hood = Neighbourhood(mission, graph, "a")
    away = replace(pose(), position_m=(1.0, 30.0, 3.0))
    for message in (away, status(Stage.TRACK)):
        assert peers.receive(message, 0) is None
    found = hood.around(peers, Self(25 * SECOND, 0, 0.1, Transform(), excluded={"b"} if excluded else ()))
    home = [one for one in found if one.plan.positions[0][:2] == pytest.approx((10.0, 0.0), abs=1.0)]
    assert len(home) == (excluded or (localization, agent_lost) == ("rtk", "return"))


@pytest.mark.parametrize(("delay_s", "stops"), [(0.0, True), (0.3, False)])
def test_one_that_is_quiet_for_longer_than_usual_may_stop(delay_s, stops):
    """Its agent may be lost: a drone behind it, at the speed of the search, could not stop any more when it noticed after a
    second.
    """
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(SECOND // 2, 0, 0.1, Transform(), ahead=lambda: np.zeros((1, 3)))
    for message in (pose(), status(Stage.TRACK), plan()):
        assert peers.receive(message, round(delay_s * SECOND)) is None
    found = hood.around(peers, me)
    assert [(one.takes_part, one.plan.blind) for one in found] == [(True, False), (False, True)][: 1 + stops]
    if stops:
        assert found[1].plan.positions[0][:2] == pytest.approx((10.0, 1.5), abs=0.01)  # half a second of its velocity further on
    later = replace(me, now_ns=3 * SECOND // 10)
    assert len(hood.around(peers, later)) == 1


def test_it_is_kept_clear_of_until_it_must_be_down_and_on_the_ground_no_more():
    assert len(after_silence(30.0)[0]) == 1  # no longer where it stopped
    assert after_silence(120.0)[0] == []
    assert after_silence(5.0, Stage.LANDED)[0] == []


@pytest.mark.parametrize(
    ("late_s", "stage", "places"),
    [
        (1.2, Stage.TRACK, 2),
        (1.9, Stage.SURVEY, 2),
        (2.1, Stage.SURVEY, 1),
        (4.9, Stage.TRACK, 2),
        (5.1, Stage.TRACK, 1),
    ],
)
def test_one_whose_messages_take_long_is_also_where_its_plan_leads(late_s, stage, places):
    """Each peer is silent by the stamp of its last message. A vehicle that lost its agent would stop; with its agent it flies on,
    and stands if it circled: a peer expected it stopped further back on the circle, and flew into it.
    """
    peers, now_ns = Peers(["b"]), round(late_s * SECOND)
    for message in (
        pose(),
        status(stage),
        replace(plan(), positions_m=((1.0, 0.0, 3.0), (1.0, 4.0, 3.0), (1.0, 8.0, 3.0))),
    ):
        assert peers.receive(message, min(now_ns, 2 * SECOND)) is None
    me = Self(now_ns, 0, 0.0, Transform(), ahead=lambda: np.zeros((1, 3)))
    found = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a").around(peers, me)
    assert len([one for one in found if one.plan.away is None]) == places + 1  # or on its way home
    if places == 2:
        x, y, _ = found[-1].plan.state(now_ns).position
        assert (x, y) == pytest.approx((10.0 - 4.0 * min(late_s, 2.0), 1.0))
        assert found[-1].plan.blind
    assert not any(one.takes_part for one in found)


def test_a_drone_in_hold_stays_and_one_that_lands_is_down_some_time():
    for stage, minutes in ((Stage.HOLD, 60.0), (Stage.LANDING, 0.3)):
        (other,) = (one.plan for one in after_silence(60.0 * minutes, stage, steered=False)[0])
        assert other.positions[0][:2] == pytest.approx((10.0, 1.0), abs=1e-6)
    assert after_silence(60.0, Stage.LANDING, steered=False)[0] == []


@pytest.mark.parametrize("hears", [False, True])
def test_the_first_pose_after_a_silence_reports_whether_its_drone_has_received_this_one(hears):
    """The plan from before the silence counted as that, and the last contact was forgotten on one side only, with its line."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (pose(), plan(), status(Stage.SURVEY)):
        assert peers.receive(message, 0) is None
    hood.around(peers, Self(2 * SECOND, 0, 0.1, Transform()))
    now_ns = 100 * SECOND
    peers.receive(replace(pose(now_ns), silences_ns={"a": 0 if hears else now_ns}), now_ns)
    (other, *_) = hood.around(peers, Self(now_ns, 0, 0.1, Transform()))
    assert (hood.absence is None) == other.takes_part == hears
    assert hears or (hood.absence.missing, hood.absence.unhearing) == (("b",), ("b",))


def test_one_that_plans_nothing_any_more_is_in_contact_again_by_its_poses():
    """The pilot held it, and the last plan, from before the link recovered, counted for good: this drone returned."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for now_ns in range(0, 3 * SECOND, SECOND // 5):
        for message in (replace(pose(now_ns), stage=Stage.SURVEY, silences_ns={"a": 2 * SECOND}), plan(now_ns)):
            peers.receive(message, now_ns)
        hood.around(peers, Self(now_ns, 0, 0.1, Transform()))
    assert hood.absence.unhearing == ("b",)
    for now_ns in range(3 * SECOND, 8 * SECOND, SECOND // 5):
        peers.receive(replace(pose(now_ns), stage=Stage.HOLD, silences_ns={"a": 0}), now_ns)
        hood.around(peers, Self(now_ns, 0, 0.1, Transform()))
    assert hood.absence is None


@pytest.mark.parametrize("agent_lost", ["return", "hold", "land"])
def test_one_that_its_autopilot_or_a_human_pilot_brings_home_is_expected_there_whatever_it_would_do_without_its_agent(agent_lost):
    peers, mission = Peers(["b"]), replace(MISSION, safety=SafetyConfig(agent_lost=agent_lost))
    for message in (replace(pose(), steered=False), status(Stage.RETURN)):
        assert peers.receive(message, 0) is None
    hood = Neighbourhood(mission, FrameGraph.from_launch_layout(mission), "a")
    found = hood.around(peers, Self(14 * SECOND, 0, 0.1, Transform()))
    assert any(one.plan.positions[0][:2] == pytest.approx((10.0, 0.0), abs=0.3) for one in found)
    assert hood.absence is None or hood.absence.coming_home == ("b",)


def started_anew(shown_s=None):
    """b tracked until 2 s. From 5 s on its agent, which has lost its state, says that it is on the ground; it has poses from
    ``shown_s`` on.
    """
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    peers.receive(replace(status(Stage.TRACK), stamp_ns=2 * SECOND), 2 * SECOND)
    peers.receive(pose(2 * SECOND), 2 * SECOND)
    for tick in range(50, 101):
        now_ns = tick * SECOND // 10
        if shown_s is not None and tick >= 10 * shown_s:
            peers.receive(replace(pose(now_ns), velocity_mps=(0.0, 0.0, 0.0), in_air=False), now_ns)
        if tick % 10 == 0:
            peers.receive(replace(status(Stage.PREFLIGHT), stamp_ns=now_ns, boot="2" * 16), now_ns)
    return hood.around(peers, Self(now_ns, 0, 0.1, Transform()))


def test_one_whose_agent_is_started_anew_in_flight_and_does_not_know_of_that_yet_may_be_where_it_would_be_without_it():
    assert [one.plan.positions for one in started_anew()] == [one.plan.positions for one in after_silence(8.0)[0]]
    assert started_anew(9.5) != []
    assert started_anew(7.5) == []  # telemetry for 2 s, reported on the ground


def test_one_whose_agent_is_started_anew_twice_is_not_on_the_ground_by_the_poses_of_the_first_time():
    peers = Peers(["b"])
    peers.receive(replace(status(Stage.TRACK), stamp_ns=2 * SECOND), 2 * SECOND)
    for tick in range(80, 96):
        now_ns = tick * SECOND // 10
        if tick in (80, 90):
            peers.receive(replace(status(Stage.PREFLIGHT), stamp_ns=now_ns, boot="2" * 16), now_ns)
        if tick > 90:
            peers.receive(pose(now_ns), now_ns)
    peers.receive(replace(status(Stage.PREFLIGHT), stamp_ns=11 * SECOND, boot="3" * 16), 11 * SECOND)
    assert not peers["b"].is_on_ground(11 * SECOND)


@pytest.mark.parametrize("stage", [Stage.TAKEOFF, Stage.HOLD, Stage.LANDING])
def test_one_that_rises_or_brakes_by_setpoints_may_come_home_if_its_agent_is_gone(stage):
    """The autopilot does the same as in the search."""
    comes_home = [one.plan.positions[0][:2] for one in after_silence(14.0, stage)[0]]
    assert any(place == pytest.approx((10.0, 0.0), abs=0.3) for place in comes_home)
    by_autopilot = [one.plan.positions[0][:2] for one in after_silence(14.0, stage, steered=False)[0]]
    assert not any(place == pytest.approx((10.0, 0.0), abs=0.3) for place in by_autopilot)


@pytest.mark.parametrize(("agent_lost", "places"), [("return", 2), ("hold", 1)])
def test_one_that_its_agent_had_ceased_to_steer_may_be_held_where_it_was(agent_lost, places):
    """Besides that it may have gone home; each place once."""
    peers, mission = Peers(["b"]), replace(MISSION, safety=SafetyConfig(agent_lost=agent_lost))
    hood = Neighbourhood(mission, FrameGraph.from_launch_layout(mission), "a")
    for message in (replace(pose(), steered=False), status(Stage.TRACK)):
        assert peers.receive(message, 0) is None
    me = Self(5 * SECOND, 0, 0.1, Transform(), circle=BOTH_ON)
    assert len(hood.around(peers, me)) == places
    for now_s in (60, 600):  # possibly there for good
        held = hood.around(peers, replace(me, now_ns=now_s * SECOND))
        assert any(one.plan.positions[0][:2] == pytest.approx((10.0, 1.0), abs=1.5) for one in held)


@pytest.mark.parametrize(("agent_lost", "around"), [("hold", True), ("return", False)])
def test_a_way_home_leads_around_where_one_may_hover_without_its_agent(agent_lost, around):
    """Straight on, a drone stopped before that, and landed there after a minute."""
    peers, mission = Peers(["b"]), replace(MISSION, safety=SafetyConfig(agent_lost=agent_lost))
    hood = Neighbourhood(mission, FrameGraph.from_launch_layout(mission), "a")
    for message in (pose(), status(Stage.SURVEY)):
        assert peers.receive(message, 0) is None
    hood.around(peers, Self(60 * SECOND, 0, 0.1, Transform(), returning_s=5.0))
    (x, y), *more = [home.place for home in hood.absence.homes if home.place != MISSION.drones[1].origin_m[:2]] or [(0.0, 0.0)]
    assert ((x, y) == pytest.approx((10.0, 2.0), abs=1.1)) is around
    assert all(place[0] == pytest.approx(10.0) for place in more)


def test_one_whose_statuses_go_on_without_poses_may_be_held_by_its_agent():
    """Its telemetry was lost, and it hovered where no peer expected it any more: from 2 m/s it stops 2.0 m and 1.9 m on."""
    places = []
    for told_s in (0.0, 4.0):
        hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
        for message in (pose(), status(Stage.SURVEY), replace(status(Stage.SURVEY), stamp_ns=round(told_s * SECOND))):
            peers.receive(message, message.stamp_ns)
        ahead = np.tile((10.0, 4.87, 3.0), (21, 1))
        me = Self(round(min(told_s + 1.0, 5.0) * SECOND), 0, 0.1, Transform(), ahead=lambda way=ahead: way, step_s=0.2)
        hood.around(peers, me)
        late = hood.around(peers, replace(me, now_ns=300 * SECOND))
        places.append([one.plan.positions[0][:2] for one in late])
    assert places[0] == []  # down by now
    assert places[1] == [pytest.approx((10.0, 4.87), abs=0.1)]


def test_one_that_returned_when_it_was_heard_last_is_crossed_above_while_it_may_fly():
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (pose(), status(Stage.RETURN)):
        assert peers.receive(message, 0) is None
    me = Self(3 * SECOND, 0, 0.1, Transform(), returning_s=5.0)
    hood.around(peers, me)
    assert (hood.absence.missing, hood.absence.alone) == ((), False)
    for other in (replace(me, returning_s=None), replace(me, now_ns=SECOND // 2), replace(me, now_ns=300 * SECOND)):
        hood.around(peers, other)  # no return; a heard peer; down by now
        assert hood.absence is None


def test_who_searched_keeps_to_its_own_side():
    """Half-way between (0, 0), where a was and stayed, and where b gets until a notices: to (10, 3) from (10, 1)."""
    me = Self(3 * SECOND, 0, 0.1, Transform(), motion_at=lambda _: STANDING)
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (pose(), status(Stage.SURVEY)):
        assert peers.receive(message, 0) is None
    beyond = hood.around(peers, me)[0].plan.positions[0]
    assert math.hypot(beyond[0], beyond[1]) == pytest.approx(HALF_WAY_M + 2.0)
    wall = hood.absence.walls["b"]
    assert wall.offset == pytest.approx(-HALF_WAY_M)
    assert (hood.absence.missing, hood.absence.ring, hood.absence.alone) == (("b",), 0, True)
    assert [wall.parts_from(place) for place in ((0.0, 0.0), (10.0, 1.0))] == [False, True]
    over = hood.around(peers, replace(me, height_m=20.0))
    assert [one for one in over if one.plan.away is not None] == []  # crosses above all searching drones
    hood.around(peers, replace(me, now_ns=61 * SECOND))
    assert (hood.absence.walls, hood.absence.anywhere) == ({}, ("b",))  # alone, this drone may be the isolated one
    hood.around(peers, me)
    assert hood.absence.walls == {"b": wall}
    revoked = hood.around(peers, replace(me, revoked=True))
    assert [one for one in revoked if one.plan.away is not None] == []
    assert hood.absence.walls == {}  # the return need not wait over home until the search there ends


def restarted(stage, circle, mission=MISSION):
    """The neighbourhoods with a memory of b, last heard at 0 in that stage: a's, and a's after a restart, both at 4 s."""
    me = Self(3 * SECOND, 0, 0.1, Transform(), motion_at=lambda _: STANDING, circle=circle)
    hood, peers = Neighbourhood(mission, FrameGraph.from_launch_layout(mission), "a"), Peers(["b"])
    for message in (pose(), status(stage)):
        assert peers.receive(message, 0) is None
    hood.around(peers, me)
    kept = hood.last_news(peers, me.now_ns)
    assert msgspec.json.decode(msgspec.json.encode(kept), type=dict[str, LastNews]) == kept
    again, anew = Neighbourhood(mission, FrameGraph.from_launch_layout(mission), "a"), Peers(["b"])
    again.remember(kept)
    back = replace(me, motion_at=lambda _: None, resumed=True)
    again.around(anew, back)
    assert again.absence is None  # a message may still come
    assert again.last_news(anew, me.now_ns) == kept
    hood.around(peers, replace(me, now_ns=4 * SECOND))
    around = again.around(anew, replace(back, now_ns=4 * SECOND))
    return hood, again, around


def test_an_agent_that_is_restarted_keeps_to_its_side_of_those_that_it_had_not_heard():
    """Two that searched took each other to be at home, and met at 6 m/s: 1.2 m."""
    hood, again, around = restarted(Stage.SURVEY, None)
    assert again.absence.walls == hood.absence.walls != {}
    assert (again.absence.missing, again.absence.anywhere) == (("b",), ())
    assert sum(one.plan.away is not None for one in around) == 1


def test_the_home_of_a_peer_is_as_published_also_after_a_restart():
    """Not where the mission's layout has it: (10, 0)."""
    homes = []
    for home_m in ((7.0, 14.0, 0.0), UNSET):
        hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
        hood.remember({"b": LastNews.of(replace(pose(), stage=Stage.TRACK, home_m=home_m), None)})
        for now_s in (0.5, 30.0):
            hood.around(peers, Self(round(now_s * SECOND), 0, 0.1, Transform(), motion_at=lambda _: STANDING, resumed=True))
        homes.append([home.place for home in hood.absence.homes])
    assert homes == [[(7.0, 14.0)], [MISSION.drones[1].origin_m[:2]]]


def test_one_that_did_not_take_part_at_the_last_contact_has_no_line_as_the_others_have_none():
    """The drone held, and searches again: it may meet the others anywhere, and is alone in its altitude layer."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (pose(), status(Stage.SURVEY)):
        assert peers.receive(message, 0) is None
    hood.around(peers, Self(3 * SECOND, 0, 0.1, Transform(), motion_at=lambda _: None))
    assert (hood.absence.walls, hood.absence.anywhere) == ({}, ("b",))


def test_one_that_may_have_taken_off_before_a_restart_may_be_anywhere():
    """The agent's memory is from before the takeoff."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(SECOND, 0, 0.1, Transform(), resumed=True)
    hood.around(peers, me)
    assert hood.listens
    hood.around(peers, replace(me, now_ns=3 * SECOND))
    assert hood.absence.anywhere == ("b",)
    assert not hood.listens


def test_who_is_started_late_waits_whether_it_hears_one_that_has_measured():
    """The late drone flew off, low, and passed a hovering drone that had never heard it (1430373: 2.3 m)."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(SECOND, 0, 0.1, Transform(), measured=("b",))
    hood.around(peers, me)
    assert hood.listens
    hood.around(peers, replace(me, now_ns=3 * SECOND))
    assert (hood.absence.missing, hood.listens) == (("b",), False)


def test_a_drone_on_its_way_home_gets_to_know_that_it_is_not_heard():
    """Only its sending had failed: it flew home low, and counted its link as two-way."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (pose(), status(Stage.RETURN)):
        assert peers.receive(message, 0) is None
    me, found = Self(SECOND // 2, 0, 0.1, Transform()), []
    for now_s in (0.5, 2.0, 500.0):
        hood.around(peers, replace(me, now_ns=round(now_s * SECOND)))
        found.append((hood.absence, hood.silences_ns(peers, round(now_s * SECOND))))
    assert found == [(None, {"b": round(now_s * SECOND)}) for now_s in (0.5, 2.0, 500.0)]


def test_one_that_is_told_on_its_way_home_that_it_is_not_heard_crosses_in_its_layer():
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (replace(pose(), stage=Stage.TRACK, silences_ns={"a": 2 * SECOND}), plan()):
        assert peers.receive(message, 0) is None
    hood.around(peers, Self(SECOND // 2, 0, 0.1, Transform(), returning_s=5.0))
    assert hood.absence.missing == hood.absence.unhearing == ("b",)  # then its guidance knows of drones that do not hear it


def test_one_that_tells_that_it_is_on_the_ground_is_not_waited_for():
    """Its autopilot is off, and it sends no poses: a restarted drone hovered for good."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(SECOND, 0, 0.1, Transform(), resumed=True)
    hood.around(peers, me)
    assert hood.listens
    for now_s in (1, 2, 3):
        assert peers.receive(replace(status(Stage.PREFLIGHT), stamp_ns=now_s * SECOND), now_s * SECOND) is None
        hood.around(peers, replace(me, now_ns=now_s * SECOND))
        assert not hood.listens


def test_one_that_was_revoked_before_a_restart_may_be_anywhere_until_it_must_be_down():
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(SECOND, 0, 0.1, Transform(), ahead=lambda: np.zeros((1, 3)), resumed=True, excluded={"b"})
    found = []
    for now_s in (1, 3, 300):
        hood.around(peers, replace(me, now_ns=now_s * SECOND))
        found.append(hood.absence and hood.absence.anywhere)
    assert found == [None, ("b",), ()]


def test_who_hears_others_takes_one_that_searched_to_be_down_once_the_line_to_it_has_ended():
    mission = replace(MISSION, drones=(*MISSION.drones, DroneInMission(id="c", origin_m=(0.0, 9.0, 0.0))))
    hood, peers = Neighbourhood(mission, FrameGraph.from_launch_layout(mission), "a"), Peers(["b", "c"])
    me = Self(3 * SECOND, 0, 0.1, Transform(), motion_at=lambda _: STANDING)
    for message in (pose(), status(Stage.SURVEY)):
        assert peers.receive(message, 0) is None
    for now_s in (3, 61):
        now_ns = now_s * SECOND
        for message in (pose(now_ns), status(Stage.SURVEY)):
            assert peers.receive(replace(message, drone="c", stamp_ns=now_ns), now_ns) is None
        hood.around(peers, replace(me, now_ns=now_ns))
        assert (set(hood.absence.walls), hood.absence.anywhere) == ({"b"} if now_s == 3 else set(), ())


@pytest.mark.parametrize(("drone", "partner", "anywhere"), [("a", "b", ()), ("c", "d", ("a", "b"))])
def test_of_two_sides_that_search_that_of_the_first_drone_stays_low_once_the_lines_have_ended(drone, partner, anywhere):
    mission = replace(MISSION, drones=(*MISSION.drones, *(DroneInMission(id=name, origin_m=(0.0, 9.0, 0.0)) for name in "cd")))
    others = [name for name in "abcd" if name != drone]
    hood, peers = Neighbourhood(mission, FrameGraph.from_launch_layout(mission), drone), Peers(others)
    me = Self(3 * SECOND, 0, 0.1, Transform(), motion_at=lambda _: STANDING)
    for now_s, heard in ((0, others), (3, [partner]), (61, [partner])):
        now_ns = now_s * SECOND
        for name in heard:
            for message in (pose(now_ns), status(Stage.SURVEY)):
                assert peers.receive(replace(message, drone=name, stamp_ns=now_ns), now_ns) is None
        hood.around(peers, replace(me, now_ns=now_ns))
        assert now_s == 0 or hood.absence.anywhere == (anywhere if now_s == 61 else ())


@pytest.mark.parametrize("agent_lost", ["return", "land", "hold"])
def test_an_agent_that_is_restarted_knows_of_those_that_circled_and_may_be_anywhere(agent_lost):
    """Whatever their vehicles do if their agents are gone."""
    hood, again, around = restarted(Stage.TRACK, BOTH_ON, replace(MISSION, safety=SafetyConfig(agent_lost=agent_lost)))
    assert (again.absence.walls, again.absence.anywhere) == ({}, ("b",))
    assert hood.absence.anywhere == ("b",)
    assert [one.takes_part for one in around] == [False] * len(around) != []


def test_what_has_been_heard_since_a_restart_is_newer_than_what_was_remembered():
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    hood.remember({"b": LastNews.of(replace(pose(), stage=Stage.SURVEY), None)})
    me = Self(SECOND, 0, 0.1, Transform(), resumed=True)
    hood.around(peers, me)
    assert peers.receive(pose(SECOND), SECOND) is None
    hood.around(peers, me)
    assert not hood.listens
    hood.around(peers, replace(me, now_ns=3 * SECOND))
    assert peers["b"].pose.stamp_ns == SECOND


def test_one_that_tells_after_a_restart_that_it_is_on_the_ground_is_remembered_no_more():
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    hood.remember({"b": LastNews.of(replace(pose(), stage=Stage.SURVEY), None)})
    assert peers.receive(status(Stage.LANDED), SECOND) is None
    assert hood.around(peers, Self(SECOND, 0, 0.1, Transform(), resumed=True)) == []
    assert hood.last_news(peers, SECOND) == {}


def test_one_that_has_landed_is_not_remembered_and_a_line_that_no_file_can_hold_neither():
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (ON_GROUND, status(Stage.LANDED)):
        assert peers.receive(message, 0) is None
    assert hood.last_news(peers, 3 * SECOND) == {}
    for offset in (math.nan, math.inf):
        assert LastNews.of(replace(pose(), stage=Stage.SURVEY), Wall((1.0, 0.0), offset)).wall is None
    assert LastNews.of(replace(pose(-1), stage=Stage.SURVEY), None) is None  # the own clock was set back to before 1970


@pytest.mark.parametrize("told_s", [0.0, 60.0])
def test_news_of_before_a_restart_are_old_even_if_the_clock_was_set_back_meanwhile(told_s):
    """Accepted as messages of a heard drone, the old ones had it fly backwards, and all its later messages counted as older."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    hood.remember({"b": LastNews.of(replace(pose(round(told_s * SECOND)), stage=Stage.TRACK), None)})
    for now_s in (30, 32):
        hood.around(peers, Self(now_s * SECOND, 0, 0.1, Transform(), resumed=True))
    assert hood.absence.missing == ("b",)
    assert peers.receive(pose(32 * SECOND), 32 * SECOND) is None


@pytest.mark.parametrize(
    ("stage", "circle", "seconds", "may"),
    [
        (Stage.SURVEY, None, 3, False),
        (Stage.TRACK, None, 3, False),
        (Stage.TRACK, BOTH_ON, 3, True),
        (Stage.TRACK, BOTH_ON, 300, False),
        (Stage.TRACK, ON_THE_WAY, 3, False),
    ],
)
def test_one_that_was_on_the_circle_as_this_drone_was_may_circle_until_its_vehicle_must_be_down(stage, circle, seconds, may):
    """Without a separation line, the drone that leaves the circle for the search could meet the other.

    On their way to the circle, two drones bound for circles of different radius crossed each other's ways, and came to 0.4 m.
    """
    me = Self(SECOND, 0, 0.1, Transform(), motion_at=lambda _: STANDING, circle=circle)
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (pose(), status(stage)):
        assert peers.receive(message, 0) is None
    for now_s in (3, seconds):
        hood.around(peers, replace(me, now_ns=now_s * SECOND))
    assert hood.absence.may_circle is may


@pytest.mark.parametrize("velocity_mps", [(0.0, 4.0, 0.0), (3.0, 0.0, 0.0)])
def test_who_only_crosses_the_circle_keeps_to_its_own_side(velocity_mps):
    """a, against the turn and inwards. Two that did went on to circles of different radius, across each other's ways: 1.4 m."""
    crossing = replace(STANDING, velocity=velocity_mps)
    me = Self(3 * SECOND, 0, 0.1, Transform(), motion_at=lambda _: crossing, circle=BOTH_ON)
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (pose(), status(Stage.TRACK)):
        assert peers.receive(message, 0) is None
    hood.around(peers, me)
    assert set(hood.absence.walls) == {"b"}
    assert not hood.absence.may_circle


def test_the_line_of_two_that_track_ends_when_each_can_be_on_its_own_circle():
    """The line stayed for a minute, in which the remaining drones stood where it had stopped them, 142 degrees apart.

    Two drones: the next circle is 6 m wider, which takes 3 s and 3 s to settle, a second after they have lost each other.
    """
    me = Self(0, 0, 0.1, Transform(), motion_at=lambda _: STANDING, circle=ON_THE_WAY)
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (pose(), status(Stage.TRACK)):
        assert peers.receive(message, 0) is None

    def parted(now_s, circle=ON_THE_WAY):
        found = hood.around(peers, replace(me, now_ns=round(now_s * SECOND), circle=circle))
        assert ("b" in hood.absence.walls) is any(one.plan.away is not None for one in found)
        return "b" in hood.absence.walls

    assert [parted(now_s) for now_s in (2.0, 6.9, 7.1, 20.0)] == [True, True, False, False]
    assert [parted(now_s, None) for now_s in (20.0, 59.0, 61.0)] == [True, True, False]  # in the search a drone meets it anywhere


def test_one_that_is_heard_but_does_not_hear_this_drone_is_left_its_side_and_never_gives_way():
    """As if neither heard the other: b takes a to keep to the line between the two of them from when they last heard of each
    other. a flew on into b's half, and b did not know of it.
    """
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(0, 0, 0.1, Transform(), motion_at=lambda _: STANDING)
    for message in (replace(pose(), stage=Stage.SURVEY), plan()):
        assert peers.receive(message, 0) is None
    assert [(one.plan.blind, one.takes_part) for one in hood.around(peers, me)] == [(False, True)]
    assert hood.absence is None
    for stamp_ns in (SECOND, 2 * SECOND):  # flies on, and belongs to a circle by then
        silences_ns = {"a": stamp_ns + 1}
        told = replace(pose(stamp_ns), position_m=(3.0, 0.0, 3.0), stage=Stage.TRACK, silences_ns=silences_ns), plan(stamp_ns)
        for message in told:
            assert peers.receive(message, stamp_ns) is None
        side, heard = hood.around(peers, replace(me, now_ns=stamp_ns, circle=BOTH_ON))
        assert side.plan.away is not None
        assert (heard.plan.blind, heard.plan.away, heard.takes_part) == (True, None, False)
        absence = hood.absence
        assert (absence.missing, absence.unhearing, absence.unheard, absence.alone) == (("b",), ("b",), (), True)
        assert absence.walls["b"].offset == pytest.approx(-HALF_WAY_M)
    again = plan(5 * SECOND // 2)
    again = replace(again, positions_m=tuple((x + 3.0, y, z) for x, y, z in again.positions_m))
    for message in (again, replace(pose(5 * SECOND // 2), position_m=(4.0, 0.0, 3.0), stage=Stage.TRACK)):
        assert peers.receive(message, 5 * SECOND // 2) is None
    (heard,) = hood.around(peers, replace(me, now_ns=5 * SECOND // 2))
    assert (heard.takes_part, hood.absence) == (True, None)


def heard_from(hood, peers, me, stamp_ns, x, silence_ns=0, stage=Stage.SURVEY):
    """Peer b is heard at a place, and reports how long a has been silent; a's neighbours 0.3 s later."""
    told = replace(pose(stamp_ns), position_m=(x, 0.0, 3.0), stage=stage, silences_ns={"a": silence_ns})
    for message in (told, plan(stamp_ns)):
        assert peers.receive(message, stamp_ns) is None
    return hood.around(peers, replace(me, now_ns=stamp_ns + 3 * SECOND // 10))


def test_the_line_stays_where_the_first_of_the_two_directions_was_lost():
    """The other one cannot know when the second direction is lost, whichever that is."""
    me = Self(0, 0, 0.1, Transform(), motion_at=lambda _: STANDING)
    for silent_first in (False, True):
        hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
        heard_from(hood, peers, me, 0, 0.0)
        if silent_first:
            hood.around(peers, replace(me, now_ns=5 * SECOND))
        else:
            heard_from(hood, peers, me, SECOND + 1, 1.0, SECOND + 1)
        first = hood.absence.walls["b"]
        assert hood.absence.unhearing == (() if silent_first else ("b",))
        if silent_first:
            heard_from(hood, peers, me, 10 * SECOND, 30.0, 7 * SECOND)
        else:
            hood.around(peers, replace(me, now_ns=5 * SECOND))
        assert hood.absence.walls == {"b": first}
        assert hood.absence.unhearing == (("b",) if silent_first else ())


def test_drones_on_the_circle_stand_for_one_that_does_not_hear_them_as_it_stands_for_them():
    """The deaf drone expects them to hover, agents lost, where they last heard each other; a drone that flew on around the
    circle passed it at 5 m, and was expected 7 m farther away.
    """
    me = Self(0, 0, 0.1, Transform(), motion_at=lambda _: STANDING, circle=BOTH_ON)
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    heard_from(hood, peers, me, 0, 0.0, stage=Stage.TRACK)
    for second in (2, 4, 20):
        heard_from(hood, peers, me, second * SECOND, 1.0, second * SECOND, stage=Stage.TRACK)
        hovers = [] if second == 20 else [pytest.approx((10.0, 0.0), abs=1e-6), pytest.approx((10.0, 4.0))]
        assert (hood.absence.stops.tolist(), hood.absence.unhearing) == (hovers, ("b",))
        assert hood.absence.coming_home == ()  # heard, not returning


def test_a_one_way_peer_hears_this_drone_again_only_by_its_own_report():
    me = Self(0, 0, 0.1, Transform(), motion_at=lambda _: STANDING)
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    heard_from(hood, peers, me, 0, 0.0)
    heard_from(hood, peers, me, SECOND + 1, 1.0, SECOND + 1)
    first = hood.absence.walls["b"]
    for second in range(2, 9):  # manual override for a while, no plans published
        silences_ns = {"a": second * SECOND}
        told = replace(pose(second * SECOND), position_m=(9.0, 0.0, 3.0), stage=Stage.HOLD, silences_ns=silences_ns)
        assert peers.receive(told, second * SECOND) is None
        hood.around(peers, replace(me, now_ns=second * SECOND + SECOND // 2))
        assert (hood.absence.walls, hood.absence.unhearing) == ({"b": first}, ("b",))
    heard_from(hood, peers, me, 9 * SECOND, 9.0)
    assert hood.absence is None


def test_a_revoked_drone_gives_way_to_all_that_it_still_hears():
    me = Self(0, 0, 0.1, Transform(), motion_at=lambda _: STANDING, revoked=True)
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    (heard,) = heard_from(hood, peers, me, 0, 0.0)
    assert (heard.plan.blind, heard.takes_part) == (True, False)
    assert (hood.absence.unhearing, hood.absence.unheard, hood.absence.walls) == (("b",), (), {})


def test_the_line_does_not_move_with_an_epoch_of_the_other_one():
    me = Self(0, 0, 0.1, Transform(), motion_at=lambda _: STANDING)
    lines = []
    for before in (0, 1):
        hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
        heard_from(hood, peers, me, 0, 0.0)
        assert peers.receive(replace(pose(SECOND), position_m=(100.0 * before, 0.0, 3.0), epoch=before), SECOND) is None
        heard_from(hood, peers, me, 2 * SECOND, 0.0, 2 * SECOND)
        lines.append(hood.absence.walls["b"])
    assert lines[0] == lines[1]


@pytest.mark.parametrize(("me", "crossing", "low"), [("a", [(10.0, 0.0)], [(10.0, 0.0)]), ("b", [], [(0.0, 0.0)])])
def test_a_return_goes_around_the_homes_over_which_those_come_down_that_it_does_not_hear(me, crossing, low):
    """b returns above a, at the same time if its agent flies on: a crossed over its home and met it there at 1.4 m. And a
    landing drone, pushed aside by a third, met a lower drone over the lower one's home at 1.5 m.
    """
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), me), Peers(["a" if me == "b" else "b"])
    (other,) = peers.names
    for message in (replace(pose(), drone=other), replace(status(Stage.TRACK), drone=other)):
        assert peers.receive(message, 0) is None
    over_m = MISSION.return_height_m(me)
    for height_m, returning_s, places in (
        (3.0, 20.0, low), (over_m, 20.0, crossing), (3.0, None, []), (over_m, None, []), (3.0, 50.0, []), (over_m, 50.0, []),
    ):  # fmt: skip
        ahead = partial(np.tile, (0.0, 0.0, height_m), (1, 1))
        myself = Self(300 * SECOND, 0, 0.1, Transform(), ahead=ahead, height_m=height_m, returning_s=returning_s)
        found = hood.around(peers, myself)
        assert [one.plan.positions[0][:2] for one in found] == places


@pytest.mark.parametrize(("me", "crossing"), [("a", [(10.0, 0.0)]), ("b", [])])
def test_a_revoked_drone_comes_down_around_the_homes_of_those_that_return_later(me, crossing):
    """With the revoked drone late, the others came home as it landed, and its plans accounted for none of them."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), me), Peers(["a" if me == "b" else "b"])
    (other,) = peers.names
    for message in (replace(pose(), drone=other), replace(status(Stage.TRACK), drone=other)):
        assert peers.receive(message, 0) is None
    low = [(10.0, 0.0)] if me == "a" else [(0.0, 0.0)]
    over_m = MISSION.return_height_m(me)
    for height_m, returning_s, places in ((3.0, 50.0, low), (over_m, 20.0, crossing), (over_m, 50.0, []), (3.0, None, [])):
        ahead = partial(np.tile, (0.0, 0.0, height_m), (1, 1))
        myself = Self(300 * SECOND, 0, 0.1, Transform(), ahead=ahead, height_m=height_m, returning_s=returning_s, revoked=True)
        assert [one.plan.positions[0][:2] for one in hood.around(peers, myself)] == places


@pytest.mark.parametrize(("revoked", "second", "sigma_m"), [(True, 12, 2.0), (True, 13, 0.0), (False, 13, 2.0)])
def test_a_revoked_drone_does_not_wait_over_its_home_because_the_home_of_another_is_doubtful(revoked, second, sigma_m):
    """b, without its agent, is home after 12.2 s at the latest. Pushed aside by the doubt until b had to be down as well, a drone
    waited for a minute, and descended through the altitude layers of others that expected it landed.
    """
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (pose(), status(Stage.TRACK)):
        assert peers.receive(message, 0) is None
    me = Self(second * SECOND, 0, 2.0, Transform(), height_m=20.0, returning_s=float(second), revoked=revoked)
    doubts_m = [one.plan.sigma_m for one in hood.around(peers, me) if one.plan.away is None]
    (home,) = hood.absence.homes
    assert home.place == pytest.approx((10.0, 0.0))
    assert (doubts_m[-1], home.sigma_m) == pytest.approx((sigma_m, sigma_m), abs=0.05)


def test_an_agent_started_in_flight_comes_home_around_the_homes_of_those_that_it_never_heard():
    """A drone revoked before landed at its home, 1.5 m from the agent's."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(300 * SECOND, 0, 0.1, Transform(), height_m=3.0, returning_s=20.0)
    (other,) = hood.around(peers, replace(me, resumed=True))
    assert other.plan.positions[0][:2] == (10.0, 0.0)
    assert hood.around(peers, me) == hood.around(peers, replace(me, resumed=True, returning_s=None)) == []


@pytest.mark.parametrize("resumed", [True, False])
def test_an_agent_keeps_clear_of_the_home_of_a_revoked_one_that_it_never_heard_until_that_is_down(resumed):
    """The revoked drone waited over its home: the other landed 1.1 m beside it; a late drone took off and flew past at 0.6 m."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(300 * SECOND, 0, 0.1, Transform(), height_m=3.0, resumed=resumed, excluded=("b",))
    places = []
    for second in (300, 340, 500):
        found = hood.around(peers, replace(me, now_ns=second * SECOND))
        homes = [home.place for home in hood.absence.homes] if hood.absence is not None else None
        places.append(([one.plan.positions[0][:2] for one in found], homes))
    in_flight: list[object] = [[(10.0, 0.0)], []] if resumed else [None, None]  # on the circle no drone misses it otherwise
    assert places == [([(10.0, 0.0)], None), ([(10.0, 0.0)], in_flight[0]), ([], in_flight[1])]


@pytest.mark.parametrize(
    ("resumed", "measured", "missing"), [(True, (), ("b",)), (False, ("a", "b"), ("b",)), (False, ("a",), None)]
)
def test_one_that_was_never_heard_is_missed_if_it_may_fly(resumed, measured, missing):
    """A drone revoked before an agent's restart flew on the same circle: 2 m. To hear the others takes a moment."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(300 * SECOND, 0, 0.1, Transform(), resumed=resumed, measured=measured)
    hood.around(peers, me)
    assert hood.absence is None
    hood.around(peers, replace(me, now_ns=301 * SECOND))
    assert (hood.absence and hood.absence.missing) == missing
    for message in (pose(301 * SECOND), replace(status(Stage.LANDED), stamp_ns=301 * SECOND)):
        assert peers.receive(message, 301 * SECOND) is None
    hood.around(peers, replace(me, now_ns=301 * SECOND))
    assert hood.absence is None


@pytest.mark.parametrize(("resumed", "measured", "missing"), [(True, (), ("b",)), (False, ("b",), ("b",)), (False, ("a",), None)])
def test_one_of_which_no_status_was_heard_is_missed_like_one_that_was_never_heard(resumed, measured, missing):
    """An agent that was started in flight, and was revoked, heard poses for a third of a second, and none from then on: a peer
    without a status so far did not exist for it.
    """
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    assert peers.receive(pose(), 0) is None
    me = Self(5 * SECOND, 0, 0.1, Transform(), resumed=resumed, measured=measured, motion_at=lambda _: STANDING)
    found = hood.around(peers, me)
    assert (hood.absence and hood.absence.missing) == missing
    assert len(found) == (3 if missing else 0)  # beyond the line half-way, where it stops, and on its way home
    assert list(hood.absence.walls if hood.absence is not None else ()) == list(missing or ())


def test_one_that_is_seen_to_fly_faster_than_when_it_was_heard_is_where_it_is_seen():
    """Its last pose reported 2 m/s. At 6 m/s its sightings did not confirm each other by that: it stood where it had been
    slower.
    """
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (pose(), status(Stage.SURVEY)):
        assert peers.receive(message, 0) is None

    def way_m(second):
        """The drone stands until 12 s, and flies at 6 m/s from then on."""
        return 6.0 * max(0.0, second - 12.0)

    for second in np.arange(10.0, 13.6, 0.2).tolist():
        range_m = math.hypot(10.0, 5.0 + way_m(second))
        direction = (10.0 / range_m, (5.0 + way_m(second)) / range_m, 0.0)
        place, sigmas = (0.0, 0.0, 3.0), {"direction_sigma_rad": 0.035, "range_sigma_m": 0.3}
        peers.see(
            Sighting(
                stamp_ns=round(second * SECOND), drone="a", mission="0" * 16, boot="1" * 16, sequence=1, epoch=0, target="b",
                position_m=place, direction=direction, range_m=range_m, **sigmas,
            )
        )  # fmt: skip
    (one,) = hood.around(peers, Self(round(13.5 * SECOND), 0, 0.1, Transform(), ahead=lambda: np.zeros((1, 3)), height_m=3.0))
    for after_s, most_m in ((0.0, 1.0), (1.0, 4.0)):
        x, y = one.plan.at(round(13.5 * SECOND), after_s)
        assert math.hypot(x - 10.0, y - 5.0 - way_m(13.5 + after_s)) < most_m
    assert one.plan.blind


def test_each_one_whose_measurements_come_first_is_given_a_moment_to_be_heard():
    mission = replace(MISSION, drones=(*MISSION.drones, DroneInMission(id="c", origin_m=(20.0, 0.0, 0.0))))
    hood, peers = Neighbourhood(mission, FrameGraph.from_launch_layout(mission), "a"), Peers(["b", "c"])
    told = []
    for second, measured in ((300, ("b",)), (301, ("b",)), (310, ("b", "c")), (311, ("b", "c"))):
        hood.around(peers, Self(second * SECOND, 0, 0.1, Transform(), measured=measured))
        told.append(hood.absence.missing if hood.absence is not None else ())
    assert told == [(), ("b",), ("b",), ("b", "c")]


@pytest.mark.parametrize("returning_s", [None, 20.0])
def test_one_on_the_ground_whose_autopilot_is_unplugged_is_not_missed(returning_s):
    """The drone sends its status, but has no pose to send."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(300 * SECOND, 0, 0.1, Transform(), height_m=3.0, resumed=True, measured=("b",), returning_s=returning_s)
    assert peers.receive(replace(status(Stage.PREFLIGHT), stamp_ns=300 * SECOND), 300 * SECOND) is None
    for second in (300, 302, 304):
        assert hood.around(peers, replace(me, now_ns=second * SECOND)) == []
        assert hood.absence is None


@pytest.mark.parametrize(("seconds", "stops"), [(5.0, [[10.0, 1.0], [10.0, 5.0]]), (14.0, [])])
def test_where_a_vehicle_hovers_without_its_agent_is_told_until_it_has_left(seconds, stops):
    """The climb goes from 3 to 13 m, never slower than 1.5 m/s."""
    hood, peers, now_ns = (
        Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"),
        Peers(["b"]),
        round(seconds * SECOND),
    )
    for message in (pose(), status(Stage.TRACK)):
        assert peers.receive(message, 0) is None
    hood.around(peers, Self(now_ns, 0, 0.1, Transform(), circle=BOTH_ON))
    assert hood.absence.stops == pytest.approx(np.array(stops).reshape(-1, 2), abs=1e-6)
    assert hood.absence.coming_home == ("b",)
    hood.around(peers, Self(120 * SECOND, 0, 0.1, Transform(), circle=BOTH_ON))
    assert hood.absence.coming_home == ()


@pytest.mark.parametrize("told_mps", [0.2, 2.6, 6.5])
@pytest.mark.parametrize("count", [4, 5, 6, 7])
def test_one_that_is_seen_only_a_few_times_may_have_become_as_fast_as_any(told_mps, count):
    """Too few to give its velocity: by the speed of its last pose, of 0.2 m/s, it was 1.95 m off at a sigma of 0.46 m."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    for message in (replace(pose(), velocity_mps=(told_mps, 0.0, 0.0)), status(Stage.SURVEY)):
        assert peers.receive(message, 0) is None
    now_s, speed_mps = 20.0, 6.5
    for step in range(count):
        second = now_s - 0.2 * (count - step)
        place = np.array((10.0, 5.0 + speed_mps * (second - now_s), 0.0))
        range_m = float(np.linalg.norm(place))
        peers.see(
            Sighting(
                stamp_ns=round(second * SECOND), drone="a", mission="0" * 16, boot="1" * 16, sequence=step, epoch=0, target="b",
                position_m=(0.0, 0.0, 3.0), direction=tuple((place / range_m).tolist()), direction_sigma_rad=0.035,
                range_m=range_m, range_sigma_m=0.3,
            )
        )  # fmt: skip
    (one,) = hood.around(peers, Self(round(now_s * SECOND), 0, 0.1, Transform(), ahead=lambda: np.zeros((1, 3)), height_m=3.0))
    x, y = one.plan.at(round(now_s * SECOND), 0.0)
    assert math.hypot(x - 10.0, y - 5.0) < 2.0 * one.plan.sigma_m


@pytest.mark.parametrize("lost_s", [0.0, 0.2, 0.6, 0.9, 1.5])
@pytest.mark.parametrize("first", ["a", "b"])
def test_both_drones_derive_one_line_whichever_direction_is_lost_first(lost_s, first):
    """Each took its own last pose for the contact: with poses of one direction lost for another second, the lines of both sides
    lay up to 5 m apart, and each drone had its line beyond the other one's.

    a flies past b at 5 m/s, 10 m away: the line turns with the time of the contact.
    """
    speed_mps = {"a": 5.0, "b": 0.0}

    def moves(name):
        beside_m = 0.0 if name == "a" else -10.0
        return lambda stamp_ns: PeerState((stamp_ns / SECOND * speed_mps[name], beside_m, 3.0), (speed_mps[name], 0.0, 0.0))

    mission = replace(MISSION, drones=tuple(DroneInMission(id=name) for name in "ab"))
    graph = FrameGraph.from_launch_layout(mission)
    hoods = {name: Neighbourhood(mission, graph, name) for name in "ab"}
    peers = {"a": Peers(["b"]), "b": Peers(["a"])}
    end_s = {name: 3.0 if name == first else 3.0 + lost_s for name in "ab"}  # the last pose of each that arrives
    for tick in range(60):
        now_ns = tick * SECOND // 10
        told = {}
        for name, other in ("ab", "ba"):
            silences_ns, state = hoods[name].silences_ns(peers[name], now_ns), moves(name)(now_ns)
            where = {"position_m": state.position, "velocity_mps": state.velocity}
            told[other] = replace(pose(now_ns), drone=name, stage=Stage.SURVEY, silences_ns=silences_ns, **where)
        for other, message in told.items():
            if tick / 10 <= end_s[message.drone]:
                assert peers[other].receive(message, now_ns) is None
        for name in "ab":
            hoods[name].around(peers[name], Self(now_ns, 0, 0.1, Transform(), motion_at=moves(name)))
    one, other = hoods["a"].absence.walls["b"], hoods["b"].absence.walls["a"]
    turned_rad = math.dist(one.normal, [-part for part in other.normal])
    pose_m = 0.1 * 5.0  # flown in a pose period
    assert turned_rad < 1.01 * pose_m / 10.0
    assert abs(one.offset + other.offset) < 1.01 * pose_m
