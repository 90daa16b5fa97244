import math

import numpy as np
import pytest
from msgspec.structs import replace

from agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from agent.frames.graph import FrameGraph
from agent.frames.transform import Transform, same
from agent.motion.reference import PeerState
from agent.navigation.contact import Circle
from agent.navigation.myself import Self
from agent.navigation.neighbours import Neighbourhood
from agent.navigation.peers import Peers
from agent.navigation.placing import WORST_SIGMA_M, blind, contradicts, held
from protocol.entries import Sighting
from protocol.messages import Plan, Pose, Stage, Status

SECOND = 1_000_000_000
MISSION = MissionConfig(
    name="test",
    area=AreaConfig(polygon_m=((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))),
    drones=(DroneInMission(id="a"), DroneInMission(id="b", origin_m=(10.0, 0.0, 0.0), yaw_deg=90.0)),
)

STANDING = PeerState((0.0, 0.0, 3.0))
BOTH_ON = Circle((5.0, 0.0), (0.0, 0.0), 5.0, 3.0)  # a stands on it at (0, 0), b flies along it about (10, 0)
HALF_WAY_M = (
    0.5 * (10.0 * 10.0 + 1.0 * 3.0) / math.hypot(10.0, 1.0)
)  # of the way from (0, 0) to (10, 3), in the direction of (10, 1)
ON_THE_WAY = Circle((12.0, 0.0), (0.0, 0.0), 5.0, 3.0)  # a is not there yet


def pose(stamp_ns=0, sigma_m=0.1, epoch=0):
    return Pose(
        stamp_ns=stamp_ns,
        drone="b",
        epoch=epoch,
        position_m=(1.0, 0.0, 3.0),
        velocity_mps=(2.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0),
        position_sigma_m=sigma_m,
        yaw_sigma_rad=0.01,
    )


def plan(stamp_ns=0):
    places = ((1.0, 0.0, 3.0), (1.0, 4.0, 3.0))
    return Plan(stamp_ns=stamp_ns, drone="b", epoch=0, step_ns=SECOND, positions_m=places)


def status(stage):
    return Status(stamp_ns=0, drone="b", mission="0" * 16, boot="1" * 16, stage=stage)


def seen(*messages, now_ns=0, own_sigma_m=0.0):
    peers = Peers(["b"])
    for message in messages:
        assert peers.receive(message, now_ns) is None
    me = Self(now_ns, 0, own_sigma_m, Transform())
    return Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a").around(peers, me)


def test_a_plan_is_read_in_the_own_frame():
    (other,) = seen(pose(), plan(), status(Stage.TRACK), now_ns=SECOND // 2)
    assert other.takes_part
    assert other.plan.state(SECOND // 2).position == pytest.approx((8.0, 1.0, 3.0))  # b's (1, 2) turned by 90 degrees
    assert other.plan.state(SECOND // 2).velocity == pytest.approx((-4.0, 0.0, 0.0))


def test_without_a_fresh_plan_it_goes_straight_on():
    now_ns = 3 * SECOND // 2
    (other,) = seen(pose(SECOND), plan(), status(Stage.TRACK), now_ns=now_ns)
    assert other.plan.state(now_ns).position == pytest.approx((10.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("stage", "flies", "takes_part"),
    [(Stage.PREFLIGHT, False, None), (Stage.LANDED, False, None), (Stage.RETURN, True, False), (Stage.SURVEY, True, True)],
)
def test_who_counts(stage, flies, takes_part):
    found = seen(pose(), status(stage))
    assert [other.takes_part for other in found] == ([takes_part] if flies else [])


def after_silence(seconds, stage=Stage.TRACK):
    """b was heard at 0, at x = 1 m of its frame and going on at 2 m/s."""
    peers, now_ns = Peers(["b"]), round(seconds * SECOND)
    for message in (pose(), status(stage)):
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
    """Where it may be, until it must be down, follows from its last pose, whatever it says, or somebody else with its key."""
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


@pytest.mark.parametrize(("delay_s", "stops"), [(0.0, True), (0.3, False)])
def test_one_that_is_quiet_for_longer_than_usual_may_stop(delay_s, stops):
    """Its agent may be gone: one that flew behind it at the speed of the search could not stop any more when it noticed after a
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
    """Each is silent by the stamp of its last message. A vehicle without its agent would stop; one with it flies on, and who
    circled stands then: where it was taken for stopped on the circle behind it, the next one flew into it.
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
    assert len([one for one in found if one.plan.away is None]) == places + 1  # it may have left for home, too
    if places == 2:
        x, y, _ = found[-1].plan.state(now_ns).position
        assert (x, y) == pytest.approx((10.0 - 4.0 * min(late_s, 2.0), 1.0))
        assert found[-1].plan.blind
    assert not any(one.takes_part for one in found)


def test_a_drone_in_hold_stays_and_one_that_lands_is_down_some_time():
    for stage, minutes in ((Stage.HOLD, 60.0), (Stage.LANDING, 0.3)):
        (other,) = (one.plan for one in after_silence(60.0 * minutes, stage)[0])
        assert other.positions[0][:2] == pytest.approx((10.0, 1.0), abs=1e-6)
    assert after_silence(60.0, Stage.LANDING)[0] == []


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
    assert [one for one in over if one.plan.away is not None] == []  # it crosses above whoever searches there
    assert hood.absence.walls == {"b": wall}
    revoked = hood.around(peers, replace(me, revoked=True))
    assert [one for one in revoked if one.plan.away is not None] == []
    assert hood.absence.walls == {}  # it returns, and need not wait over home until nobody searches there


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
    """There is no line between the two, so who leaves the circle for the search could meet it.

    On their way to the circle, two that went on to circles of different radius crossed each other's ways, and came to 0.4 m.
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
    hood.around(peers, replace(me, now_ns=10 * SECOND))
    assert not hood.absence.may_circle


def test_one_that_is_heard_but_does_not_hear_this_drone_is_left_its_side_and_never_gives_way():
    """As if neither heard the other: b takes a to keep to the line between the two of them from when they last heard of each
    other. a flew on into b's half, and b did not know of it.
    """
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(0, 0, 0.1, Transform(), motion_at=lambda _: STANDING)
    for message in (pose(), status(Stage.SURVEY), plan()):
        assert peers.receive(message, 0) is None
    assert [(one.plan.blind, one.takes_part) for one in hood.around(peers, me)] == [(False, True)]
    assert hood.absence is None
    for stamp_ns in (SECOND, 2 * SECOND):  # it goes on, and is a circle's drone by then
        told = (replace(pose(stamp_ns), position_m=(3.0, 0.0, 3.0)), replace(plan(stamp_ns), unheard=("a",)))
        for message in (*told, replace(status(Stage.TRACK), stamp_ns=stamp_ns)):
            assert peers.receive(message, stamp_ns) is None
        side, heard = hood.around(peers, replace(me, now_ns=stamp_ns, circle=BOTH_ON))
        assert side.plan.away is not None
        assert (heard.plan.blind, heard.plan.away, heard.takes_part) == (True, None, False)
        absence = hood.absence
        assert (absence.missing, absence.unhearing, absence.unheard, absence.alone) == (("b",), ("b",), (), True)
        assert absence.walls["b"].offset == pytest.approx(-HALF_WAY_M)
    for message in (plan(5 * SECOND // 2), pose(5 * SECOND // 2)):
        assert peers.receive(message, 5 * SECOND // 2) is None
    (heard,) = hood.around(peers, replace(me, now_ns=5 * SECOND // 2))
    assert (heard.takes_part, hood.absence) == (True, None)


def heard_from(hood, peers, me, stamp_ns, x, unheard=(), stage=Stage.SURVEY):
    """b is heard at a place, and tells whom it does not hear; what a makes of it 0.3 s later."""
    told = replace(plan(stamp_ns), unheard=unheard) if unheard else plan(stamp_ns)
    for message in (replace(pose(stamp_ns), position_m=(x, 0.0, 3.0)), told, replace(status(stage), stamp_ns=stamp_ns)):
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
            heard_from(hood, peers, me, SECOND, 1.0, unheard=("a",))
        first = hood.absence.walls["b"]
        assert hood.absence.unhearing == (() if silent_first else ("b",))
        if silent_first:
            heard_from(hood, peers, me, 10 * SECOND, 30.0, unheard=("a",))
        else:
            hood.around(peers, replace(me, now_ns=5 * SECOND))
        assert hood.absence.walls == {"b": first}
        assert hood.absence.unhearing == (("b",) if silent_first else ())


def test_drones_on_the_circle_stand_for_one_that_does_not_hear_them_as_it_stands_for_them():
    """It takes them for vehicles that hover without their agents where they last heard each other; one that flew on around the
    circle passed it at 5 m, and was expected 7 m farther away.
    """
    me = Self(0, 0, 0.1, Transform(), motion_at=lambda _: STANDING, circle=BOTH_ON)
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    heard_from(hood, peers, me, 0, 0.0, stage=Stage.TRACK)
    for second in (1, 4, 20):
        heard_from(hood, peers, me, second * SECOND, 1.0, unheard=("a",), stage=Stage.TRACK)
        hovers = [] if second == 20 else [pytest.approx((10.0, 0.0), abs=1e-6), pytest.approx((10.0, 4.0))]
        assert (hood.absence.stops.tolist(), hood.absence.unhearing) == (hovers, ("b",))
        assert hood.absence.coming_home == ()  # it is heard, and is not


def test_one_that_was_told_not_to_hear_this_drone_hears_it_again_only_when_it_plans_so():
    me = Self(0, 0, 0.1, Transform(), motion_at=lambda _: STANDING)
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    heard_from(hood, peers, me, 0, 0.0)
    heard_from(hood, peers, me, SECOND, 1.0, unheard=("a",))
    first = hood.absence.walls["b"]
    for second in range(2, 9):  # it is flown by somebody else for a while, and publishes no plans
        assert peers.receive(replace(pose(second * SECOND), position_m=(9.0, 0.0, 3.0)), second * SECOND) is None
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
        heard_from(hood, peers, me, 2 * SECOND, 0.0, unheard=("a",))
        lines.append(hood.absence.walls["b"])
    assert lines[0] == lines[1]


@pytest.mark.parametrize(("me", "crossing", "low"), [("a", [(10.0, 0.0)], [(10.0, 0.0)]), ("b", [], [(0.0, 0.0)])])
def test_a_return_goes_around_the_homes_over_which_those_come_down_that_it_does_not_hear(me, crossing, low):
    """b returns above a, at the same time if its agent flies on: a crossed over its home and met it there at 1.4 m. And who came
    down, pushed aside by a third one, met a lower one over that one's home at 1.5 m.
    """
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), me), Peers(["a" if me == "b" else "b"])
    (other,) = peers.names
    for message in (replace(pose(), drone=other), replace(status(Stage.TRACK), drone=other)):
        assert peers.receive(message, 0) is None
    for height_m, returning_s, places in (
        (3.0, 20.0, low), (20.0, 20.0, crossing), (3.0, None, []), (20.0, None, []), (3.0, 50.0, []), (20.0, 50.0, []),
    ):  # fmt: skip
        myself = Self(300 * SECOND, 0, 0.1, Transform(), height_m=height_m, returning_s=returning_s)
        found = hood.around(peers, myself)
        assert [one.plan.positions[0][:2] for one in found] == places


@pytest.mark.parametrize(("me", "crossing"), [("a", [(10.0, 0.0)]), ("b", [])])
def test_a_revoked_drone_comes_down_around_the_homes_of_those_that_return_later(me, crossing):
    """Where it is late, they came home as it came down, and it reckoned with none of them."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), me), Peers(["a" if me == "b" else "b"])
    (other,) = peers.names
    for message in (replace(pose(), drone=other), replace(status(Stage.TRACK), drone=other)):
        assert peers.receive(message, 0) is None
    low = [(10.0, 0.0)] if me == "a" else [(0.0, 0.0)]
    for height_m, returning_s, places in ((3.0, 50.0, low), (20.0, 20.0, crossing), (20.0, 50.0, []), (3.0, None, [])):
        myself = Self(300 * SECOND, 0, 0.1, Transform(), height_m=height_m, returning_s=returning_s, revoked=True)
        assert [one.plan.positions[0][:2] for one in hood.around(peers, myself)] == places


@pytest.mark.parametrize(("revoked", "second", "sigma_m"), [(True, 11, 2.0), (True, 12, 0.0), (False, 12, 2.0)])
def test_a_revoked_drone_does_not_wait_over_its_home_because_the_home_of_another_is_doubtful(revoked, second, sigma_m):
    """b, without its agent, is home after 11.5 s at the latest. Pushed aside by the doubt until b had to be down as well, a drone
    waited for a minute, and came down through the layers of others that took it to have landed.
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
    """One that was revoked before came down over its home, 1.5 m from it."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(300 * SECOND, 0, 0.1, Transform(), height_m=3.0, returning_s=20.0)
    (other,) = hood.around(peers, replace(me, resumed=True))
    assert other.plan.positions[0][:2] == (10.0, 0.0)
    assert hood.around(peers, me) == hood.around(peers, replace(me, resumed=True, returning_s=None)) == []


def test_an_agent_started_in_flight_keeps_clear_of_the_home_of_a_revoked_one_that_it_never_heard_until_that_is_down():
    """That one waited over its home, and the other came down beside it: 1.1 m."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(300 * SECOND, 0, 0.1, Transform(), height_m=3.0, resumed=True, excluded=("b",))
    places = []
    for second in (300, 340, 500):
        found = hood.around(peers, replace(me, now_ns=second * SECOND))
        homes = [home.place for home in hood.absence.homes] if hood.absence is not None else None
        places.append(([one.plan.positions[0][:2] for one in found], homes))
    assert places == [([(10.0, 0.0)], None), ([(10.0, 0.0)], [(10.0, 0.0)]), ([], [])]


@pytest.mark.parametrize(
    ("resumed", "measured", "missing"), [(True, (), ("b",)), (False, ("a", "b"), ("b",)), (False, ("a",), None)]
)
def test_one_that_was_never_heard_is_missed_if_it_may_fly(resumed, measured, missing):
    """One that was revoked before an agent was started again flew on the same circle: 2 m. To hear the others takes a moment."""
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
    """It sends its status, but has no pose to send."""
    hood, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    me = Self(300 * SECOND, 0, 0.1, Transform(), height_m=3.0, resumed=True, measured=("b",), returning_s=returning_s)
    assert peers.receive(replace(status(Stage.PREFLIGHT), stamp_ns=300 * SECOND), 300 * SECOND) is None
    for second in (300, 302, 304):
        assert hood.around(peers, replace(me, now_ns=second * SECOND)) == []
        assert hood.absence is None


@pytest.mark.parametrize(("seconds", "stops"), [(5.0, [[10.0, 1.0], [10.0, 5.0]]), (14.0, [])])
def test_where_a_vehicle_hovers_without_its_agent_is_told_until_it_has_left(seconds, stops):
    """It climbs from 3 to 13 m, slower than at 1.5 m/s never."""
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


def test_silence_and_unknown_frames():
    assert seen(pose(), now_ns=0) != []
    assert seen(status(Stage.TRACK)) == []
    assert seen(pose(epoch=3), status(Stage.TRACK)) == []


@pytest.mark.parametrize(("theirs", "own", "together"), [(0.3, 0.4, 0.5), (80.0, 0.1, WORST_SIGMA_M)])
def test_errors_of_both_positions_count_but_not_without_limit(theirs, own, together):
    (other,) = seen(pose(sigma_m=theirs), status(Stage.TRACK), own_sigma_m=own)
    assert other.plan.sigma_m == pytest.approx(together)


# Estimated frames

ESTIMATED = replace(
    MISSION,
    drones=(
        DroneInMission(id="a", localization="rtk"),
        DroneInMission(id="b", origin_m=(10.0, 0.0, 0.0), localization="slam", origin_sigma_m=1.0, yaw_sigma_deg=180.0),
    ),
)
UNSURE = np.diag([0.5, 0.5, 0.1, 0.01])
HERE = Transform(covariance=UNSURE)
NOW_NS = 3 * SECOND


def flying_b(epoch=0, shift=(0.0, 0.0)):
    """b's poses at 10 Hz for three seconds along its x axis at 2 m/s, up to x = 6 m; ``shift``: what it has wrong of itself."""
    for tick in range(31):
        x, y = 0.2 * tick + shift[0], shift[1]
        yield replace(pose(NOW_NS + (tick - 30) * SECOND // 10, epoch=epoch), position_m=(x, y, 3.0))
    yield replace(status(Stage.TRACK), stamp_ns=NOW_NS)


def sights_of_b(mission_from_b, epoch=0, **values):
    """What a sees of b, five times a second, from the origin of the mission frame, which is its own."""
    for tick in range(0, 31, 2):
        x, y, z = mission_from_b.apply_point((0.2 * tick, 0.0, 3.0))
        distance = float(np.linalg.norm((x, y, z)))
        yield Sighting(
            stamp_ns=NOW_NS + (tick - 30) * SECOND // 10, drone="a", mission="0" * 16, boot="1" * 16, sequence=tick, epoch=epoch,
            target="b", position_m=(0.0, 0.0, 0.0), direction=(x / distance, y / distance, z / distance),
            direction_sigma_rad=0.03, range_m=distance, range_sigma_m=0.3, **values,
        )  # fmt: skip


def around_a(messages, sights=(), known=None, own=HERE, neighbourhood=None):
    """Who flies around a. ``known``: b's frame by epoch; ``own``: a's, None while it is not known."""
    peers, graph = Peers(["b"]), FrameGraph()
    for epoch, transform in (known or {}).items():
        graph.place("b", epoch, transform)
    for message in messages:
        assert peers.receive(message, message.stamp_ns) is None
    for sight in sights:
        peers.see(sight)
    sigma_m = own.sigmas_at((0.0, 0.0, 0.0))[0] if own is not None else 0.1
    me = Self(NOW_NS, 0, sigma_m, own)
    return (neighbourhood or Neighbourhood(ESTIMATED, graph, "a")).around(peers, me)


TRUE = Transform(math.pi / 2, (10.0, 0.0, 0.0))  # b's x axis points north: it is at (10, 6)
WRONG = Transform(math.pi / 2, (10.5, 0.7, 0.0), UNSURE)


def test_the_errors_of_both_frames_count():
    (other,) = around_a(flying_b(), known={0: WRONG})
    assert other.takes_part
    assert other.plan.measured.position == pytest.approx((10.5, 6.7, 3.0))
    assert other.plan.sigma_m == pytest.approx(math.hypot(WRONG.sigmas_at((6.0, 0.0, 3.0))[0], 1.0), abs=1e-3)


def test_sights_correct_where_the_frames_put_it_and_make_it_surer():
    (other,) = around_a(flying_b(), sights_of_b(TRUE), {0: WRONG})
    assert other.plan.measured.position == pytest.approx((10.0, 6.0, 3.0), abs=0.1)
    assert other.plan.measured.velocity == pytest.approx((0.0, 2.0, 0.0), abs=1e-9)
    assert other.plan.sigma_m < 0.4


def test_of_a_drone_that_is_wrong_of_itself_the_sights_count_alone():
    """20 m, and its frame is held to be known well."""
    sure = Transform(math.pi / 2, (10.0, 0.0, 0.0), np.diag([0.01, 0.01, 0.01, 1e-4]))
    (other,) = around_a(flying_b(shift=(20.0, 0.0)), sights_of_b(TRUE), {0: sure})
    assert other.plan.measured.position == pytest.approx((10.0, 6.0, 3.0), abs=0.1)


@pytest.mark.parametrize("turned_deg", [60.0, 180.0])
def test_where_a_wrong_heading_leaves_nothing_to_correct_the_sights_count_alone(turned_deg):
    """The sights agree on no offset from a way in another direction: it was taken for 25 m farther away than it was."""
    sure = Transform(math.pi / 2 + math.radians(turned_deg), (10.0, 20.0, 0.0), np.diag([0.01, 0.01, 0.01, 1e-4]))
    (other,) = around_a(flying_b(), sights_of_b(TRUE), {0: sure})
    assert other.plan.measured.position == pytest.approx((10.0, 6.0, 3.0), abs=0.3)
    assert other.plan.measured.velocity == pytest.approx((0.0, 2.0, 0.0), abs=0.3)
    assert other.takes_part


@pytest.mark.parametrize(("steered", "planned"), [(True, True), (False, True), (False, False)])
def test_by_sights_alone_too_one_that_is_not_steered_by_its_plan_gives_no_way(steered, planned):
    sure = Transform(-math.pi / 2, (10.0, 20.0, 0.0), np.diag([0.01, 0.01, 0.01, 1e-4]))
    plans = [replace(plan(NOW_NS), positions_m=((6.0, 0.0, 3.0), (8.0, 0.0, 3.0)))] if planned else []
    messages = [*(replace(one, steered=steered) if isinstance(one, Pose) else one for one in flying_b()), *plans]
    (other,) = around_a(messages, sights_of_b(TRUE), {0: sure})
    assert other.plan.measured.position == pytest.approx((10.0, 6.0, 3.0), abs=0.3)
    assert other.plan.blind is (planned and not steered)


@pytest.mark.parametrize(("age_s", "wrong"), [(0.0, False), (1.0, False), (1.0, True)])
def test_sights_of_now_are_compared_with_where_a_pose_of_a_moment_ago_leads(age_s, wrong):
    """b goes on at 2 m/s: 2 m in a second, more than the errors of its frame and of the sights together."""
    now_ns, told = 10 * SECOND, replace(pose(10 * SECOND - round(age_s * SECOND)), velocity_mps=(2.0, 0.0, 0.0))
    now = held("b", now_ns, PeerState((1.0 + 2.0 * age_s, 4.0 if wrong else 0.0, 3.0)), 0.3)
    assert contradicts(now, blind("b", told, Transform(), now_ns), 0.3) is wrong


@pytest.mark.parametrize("own", [HERE, None])
def test_a_drone_whose_frame_is_not_known_is_where_it_is_seen(own):
    known = {} if own is not None else {0: TRUE}
    (other,) = around_a(flying_b(), sights_of_b(TRUE), known, own)
    assert not other.takes_part
    assert other.plan.state(NOW_NS).position == pytest.approx((10.0, 6.0, 3.0), abs=0.2)
    assert other.plan.state(NOW_NS).velocity == pytest.approx((0.0, 2.0, 0.0), abs=0.2)
    assert other.plan.sigma_m < 1.0


def test_nor_seen_it_is_near_its_launch_place_while_it_has_not_gone_far():
    near = [replace(pose(NOW_NS), position_m=(1.0, 2.0, 3.0)), replace(status(Stage.SURVEY), stamp_ns=NOW_NS)]
    (other,) = around_a(near)
    assert not other.takes_part
    assert other.plan.measured.position[:2] == pytest.approx((10.0, 0.0))
    assert other.plan.sigma_m == pytest.approx(math.hypot(1.0, 1.0, math.hypot(1.0, 2.0)))
    assert around_a(flying_b(shift=(10.0, 0.0))) == []  # 16 m away from there, in whatever direction


@pytest.mark.parametrize("seconds", [4.0, 60.0])
def test_a_drone_that_is_heard_no_more_is_where_it_is_seen(seconds):
    """It went on for longer than its autopilot should, and hangs at (10, 15)."""
    now_ns, peers, graph = NOW_NS + round(seconds * SECOND), Peers(["b"]), FrameGraph()
    graph.place("b", 0, TRUE)
    for message in flying_b():
        assert peers.receive(message, message.stamp_ns) is None
    for sight in [*sights_of_b(TRUE), *(replace(sight, stamp_ns=sight.stamp_ns + now_ns - NOW_NS) for sight in hanging())]:
        peers.see(sight)
    (other,) = Neighbourhood(ESTIMATED, graph, "a").around(peers, Self(now_ns, 0, 0.1, HERE))
    assert other.plan.state(now_ns + SECOND).position == pytest.approx((10.0, 15.0, 3.0), abs=0.2)
    assert not other.takes_part


@pytest.mark.parametrize(("seconds", "height_m", "counts"), [(20.0, 0.2, True), (300.0, 0.2, False), (300.0, 3.0, True)])
def test_one_that_is_seen_on_the_ground_after_it_must_be_down_is_in_nobodys_way(seconds, height_m, counts):
    """Its agent is dead: it would keep others from homes beside it for good."""
    now_ns, peers, graph = NOW_NS + round(seconds * SECOND), Peers(["b"]), FrameGraph()
    graph.place("b", 0, TRUE)
    for message in flying_b():
        assert peers.receive(message, message.stamp_ns) is None
    for sight in hanging((10.0, 15.0, height_m)):
        peers.see(replace(sight, stamp_ns=sight.stamp_ns + now_ns - NOW_NS))
    found = Neighbourhood(ESTIMATED, graph, "a").around(peers, Self(now_ns, 0, 0.1, HERE))
    assert [one.id for one in found] == (["b"] if counts else [])


def hanging(place=(10.0, 15.0, 3.0)):
    """What a sees of b that hangs there."""
    distance = float(np.linalg.norm(place))
    direction = tuple(axis / distance for axis in place)
    return [replace(sight, direction=direction, range_m=distance) for sight in sights_of_b(TRUE)]


def test_a_drone_whose_frame_has_jumped_is_where_it_was_flying():
    graph = FrameGraph()
    graph.place("b", 0, TRUE)
    one = Neighbourhood(ESTIMATED, graph, "a")
    around_a(flying_b(), neighbourhood=one)
    jumped = [replace(pose(NOW_NS + SECOND // 10, epoch=1), position_m=(-40.0, 9.0, 3.0))]
    jumped.append(replace(status(Stage.TRACK), stamp_ns=NOW_NS))
    (other,) = around_a(jumped, neighbourhood=one)
    assert other.takes_part
    assert other.plan.measured.position == pytest.approx((10.0, 6.2, 3.0))
    assert other.plan.measured.velocity == pytest.approx((0.0, 2.0, 0.0))


def test_a_drone_whose_frame_is_not_believed_any_more_stays_where_it_was_held_to_be_with_all_doubt():
    graph = FrameGraph()
    graph.place("b", 0, TRUE)
    one = Neighbourhood(ESTIMATED, graph, "a")
    around_a(flying_b(), neighbourhood=one)
    graph.replace_from("b", 0, 0, [(0, None)])
    (other,) = around_a(flying_b(), neighbourhood=one)
    assert other.plan.measured.position == pytest.approx((10.0, 6.0, 3.0))
    assert other.plan.sigma_m == WORST_SIGMA_M
    (seen,) = around_a(flying_b(), sights_of_b(Transform(math.pi / 2, (30.0, 0.0, 0.0))), neighbourhood=one)
    assert seen.plan.measured.position == pytest.approx((30.0, 6.0, 3.0), abs=0.5)  # its frame was 20 m wrong


@pytest.mark.parametrize(("epoch", "found"), [(0, True), (1, False)])
def test_after_a_restart_a_drone_is_placed_by_the_frame_of_before_until_the_log_tells_it(epoch, found):
    """All that held the log were restarted: nobody sees b, which is 6 m from its launch and has gone on in the same epoch."""
    before, graph = FrameGraph(), FrameGraph()
    before.place("b", 0, WRONG)
    former = Neighbourhood(ESTIMATED, before, "a")
    around_a(flying_b(shift=(12.0, 0.0)), neighbourhood=former)
    one = Neighbourhood(ESTIMATED, graph, "a")
    assert around_a(flying_b(epoch, shift=(12.0, 0.0)), neighbourhood=one) == []
    one.remember(former.kept_frames)
    assert one.kept_frames.keys() == {"b"}  # for a restart before it is heard
    for _ in range(2):
        others = around_a(flying_b(epoch, shift=(12.0, 0.0)), neighbourhood=one)
        assert [other.takes_part for other in others] == ([True] if found else [])
    if found:
        assert others[0].plan.measured.position == pytest.approx((10.5, 18.7, 3.0))
        assert others[0].plan.sigma_m == pytest.approx(math.hypot(WRONG.sigmas_at((18.0, 0.0, 3.0))[0], 1.0), abs=1e-3)
        graph.place("b", 0, TRUE)
        (other,) = around_a(flying_b(shift=(12.0, 0.0)), neighbourhood=one)
        assert other.plan.measured.position == pytest.approx((10.0, 18.0, 3.0))
        graph.replace_from("b", 0, 0, [(0, None)])
        (other,) = around_a(flying_b(shift=(12.0, 0.0)), neighbourhood=one)
        assert other.plan.sigma_m == WORST_SIGMA_M  # what the log has told and tells no more is in doubt


def test_of_a_frame_that_is_not_believed_any_more_the_doubt_is_kept_and_what_the_mission_tells_is_not():
    graph = FrameGraph()
    graph.place("b", 0, WRONG)
    one = Neighbourhood(ESTIMATED, graph, "a")
    around_a(flying_b(), neighbourhood=one)
    assert same(one.kept_frames["b"].mission_from_local, WRONG)
    graph.replace_from("b", 0, 0, [(0, None)])
    assert one.kept_frames["b"].mission_from_local.sigmas_at((0.0, 0.0, 0.0))[0] == pytest.approx(WORST_SIGMA_M)
    exact, peers = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a"), Peers(["b"])
    peers.receive(pose(), 0)
    assert exact.around(peers, Self(0, 0, 0.1, Transform()))
    assert exact.kept_frames == {}


def flown(apart_m, seconds, hood, peers, since_s=0.0):
    """b flies along its plans, apart from them to its side; what is believed of it in the end."""
    found = []
    for tick in range(round(10 * seconds)):
        now_ns = round((since_s + 0.1 * tick) * SECOND)
        y = 0.1 * tick
        ahead = ((0.0, y, 3.0), (0.0, y + 4.0, 3.0))
        peers.receive(replace(plan(now_ns), positions_m=ahead, step_ns=4 * SECOND), now_ns)
        peers.receive(replace(pose(now_ns), position_m=(apart_m, y, 3.0)), now_ns)
        found = hood.around(peers, Self(now_ns, 0, 0.1, Transform()))
    return found[0].plan.deviation_m


def test_how_a_peer_deviates_from_its_plans_is_seen():
    peers, hood = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    assert flown(1.2, 40.0, hood, peers) == pytest.approx(1.2, abs=0.05)
    assert flown(0.1, 40.0, hood, peers, since_s=40.0) == pytest.approx(0.1, abs=0.15)


def test_a_jump_of_its_frame_is_no_deviation():
    peers, hood = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    before = flown(0.1, 40.0, hood, peers)
    for tick in range(20):
        now_ns = round((40.0 + 0.1 * tick) * SECOND)
        peers.receive(replace(pose(now_ns, epoch=1), position_m=(50.0, 0.0, 3.0)), now_ns)
        found = hood.around(peers, Self(now_ns, 0, 0.1, Transform()))
    assert all(other.plan.deviation_m == pytest.approx(before) for other in found)


def test_a_drone_that_does_not_follow_its_plan_is_where_its_pose_says_and_gives_no_way():
    """Its plan leads it past at 4 m/s, but somebody has stopped it: after 0.6 s it is 2.4 m behind its plan. For as long as that
    is recent the pose may be what is false.
    """
    peers, now_ns = Peers(["b"]), 6 * SECOND // 10
    stopped = replace(pose(now_ns), velocity_mps=(0.0, 0.0, 0.0))
    hood = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    for at_ns, message in ((0, pose()), (0, plan()), (0, status(Stage.TRACK)), (now_ns, stopped)):
        assert peers.receive(message, now_ns) is None
        other, *as_planned = hood.around(peers, Self(at_ns, 0, 0.0, Transform()))
    assert other.plan.positions[-1] == pytest.approx((10.0, 1.0, 3.0))
    assert other.plan.blind
    (planned,) = as_planned
    assert planned.plan.state(now_ns).position == pytest.approx((7.6, 1.0, 3.0))
    assert planned.plan.blind
    assert not planned.takes_part
    later = Self(12 * SECOND // 10, 0, 0.0, Transform())
    assert peers.receive(replace(stopped, stamp_ns=later.now_ns), later.now_ns) is None
    assert len(hood.around(peers, later)) == 1
    assert other.plan.goes_before("a")


def test_the_doubt_about_a_planned_place_is_that_of_both_drones_and_bounded():
    """As for any other place: a lost drone must not drive the swarm off its circle."""
    peers, now_ns = Peers(["b"]), 6 * SECOND // 10
    hood = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    for message in (pose(), plan(), status(Stage.TRACK), replace(pose(now_ns), velocity_mps=(0.0, 0.0, 0.0))):
        assert peers.receive(message, now_ns) is None
    for own_sigma_m, expected_m in ((2.0, 2.0), (50.0, WORST_SIGMA_M)):
        _, planned = hood.around(peers, Self(now_ns, 0, own_sigma_m, Transform()))
        assert planned.plan.sigma_m == pytest.approx(expected_m, abs=0.1)


def test_a_drone_that_follows_its_plan_again_is_where_that_leads():
    peers, now_ns = Peers(["b"]), 6 * SECOND // 10
    stopped = replace(pose(now_ns), velocity_mps=(0.0, 0.0, 0.0))
    follows = replace(pose(now_ns), position_m=(1.0, 2.8, 3.0), stamp_ns=now_ns + SECOND // 10)
    hood = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    for message in (pose(), plan(), status(Stage.TRACK), stopped, follows):
        assert peers.receive(message, now_ns) is None
        found = hood.around(peers, Self(now_ns, 0, 0.0, Transform()))
    assert [one.plan.blind for one in found] == [False]


def test_a_drone_that_publishes_plans_no_more_gives_no_way():
    assert seen(pose(3 * SECOND // 2), plan(SECOND), status(Stage.TRACK), now_ns=3 * SECOND // 2)[0].plan.blind is False
    assert seen(pose(3 * SECOND // 2), plan(), status(Stage.HOLD), now_ns=3 * SECOND // 2)[0].plan.blind is True


@pytest.mark.parametrize(("sigma_m", "places"), [(0.1, 1), (16.0, 2)])
def test_a_drone_in_doubt_after_a_jump_is_given_way_in_both_places(sigma_m, places):
    """Its pose jumps by 20 m along its x axis, which is the mission's y axis."""
    peers, around = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    peers.receive(pose(), 0)
    around.around(peers, Self(0, 0, 0.0, Transform()))
    now_ns = SECOND // 10
    peers.receive(replace(pose(now_ns, sigma_m, epoch=1), position_m=(21.0, 0.0, 3.0)), now_ns)
    found = around.around(peers, Self(now_ns, 0, 0.0, Transform()))
    assert len(found) == places
    assert found[0].plan.state(now_ns).position == pytest.approx((10.0, 1.2, 3.0))
    if places == 2:
        assert found[1].plan.state(now_ns).position == pytest.approx((10.0, 21.0, 3.0))
        assert found[1].plan.blind
        assert not found[1].takes_part


@pytest.mark.parametrize(("sigma_m", "own_sigma_m", "places"), [(4.0, 7.0, 2), (2.0, 4.0, 1), (0.1, 7.0, 1), (16.0, 7.0, 3)])
def test_two_drones_in_doubt_keep_clear_of_each_other_as_they_lie_if_both_localisations_are_right(sigma_m, own_sigma_m, places):
    """b's pose jumps by 8 m along the mission's y axis, that of this drone by -10 m along x: it takes itself to be 10 m further
    along x than its localisation says. Separation allows for up to 5 m (1 sigma) between them anyway.
    """
    peers, around = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    peers.receive(pose(), 0)
    around.around(peers, Self(0, 0, 0.0, Transform()))
    now_ns = SECOND // 10
    peers.receive(replace(pose(now_ns, sigma_m, epoch=1), position_m=(9.0, 0.0, 3.0)), now_ns)
    own = Transform(translation=(10.0, 0.0, 0.0))
    found = around.around(peers, Self(now_ns, 1, own_sigma_m, own.inverse(), otherwise=Transform()))
    assert len(found) == places
    if places > 1:
        both = found[-1]
        assert both.plan.state(now_ns).position == pytest.approx((10.0, 9.0, 3.0))
        assert both.plan.blind
        assert not both.takes_part


def test_a_drone_whose_poses_say_that_it_is_not_steered_is_placed_by_them_at_once():
    """However new its last plan is: a pilot who takes over needs no second to leave it."""
    taken = replace(pose(SECOND // 10), velocity_mps=(0.0, 0.0, 0.0), steered=False)
    (other,) = seen(taken, plan(), status(Stage.TRACK), now_ns=SECOND // 10)
    assert other.plan.positions[-1] == pytest.approx((10.0, 1.0, 3.0))
    assert other.plan.blind
    (steered,) = seen(replace(taken, steered=True), plan(), status(Stage.TRACK), now_ns=SECOND // 10)
    assert len(steered.plan.positions) == len(plan().positions_m)
    assert not steered.plan.blind


def test_whoever_was_lost_while_the_own_clock_was_set_back_is_not_heard_like_any_other():
    """It was 20 s fast, and b is silent since: its last news would be of the future for as long, and its plan nowhere."""
    peers, hood = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    peers.keep_time(30 * SECOND)
    for message in (pose(30 * SECOND), plan(30 * SECOND), replace(status(Stage.TRACK), stamp_ns=30 * SECOND)):
        assert peers.receive(message, 30 * SECOND) is None
    peers.keep_time(10 * SECOND)
    other = hood.around(peers, Self(10 * SECOND + SECOND // 2, 0, 0.0, Transform()))[0]
    assert other.plan.state(10 * SECOND + SECOND // 2).position == pytest.approx((8.0, 1.0, 3.0))
    for now_ns in (11 * SECOND + SECOND // 10, 40 * SECOND):
        hood.around(peers, Self(now_ns, 0, 0.0, Transform()))
        assert hood.absence is not None
        assert hood.absence.missing == ("b",)


def test_the_line_to_keep_behind_stays_when_the_own_clock_is_set_back():
    peers, hood = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    for message in (pose(30 * SECOND), replace(status(Stage.SURVEY), stamp_ns=30 * SECOND)):
        assert peers.receive(message, 30 * SECOND) is None

    def walls(now_ns):
        hood.around(peers, Self(now_ns, 0, 0.0, Transform(), motion_at=lambda ns: STANDING if ns > 20 * SECOND else None))
        return hood.absence.walls

    before = walls(32 * SECOND)
    assert "b" in before
    peers.keep_time(32 * SECOND)
    peers.keep_time(12 * SECOND)
    assert walls(13 * SECOND) == before
