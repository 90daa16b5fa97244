import math

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission
from radron.agent.frames.drift import Drift
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.kept import KeptFrame
from radron.agent.frames.transform import Transform, same
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.myself import Self
from radron.agent.navigation.neighbours import Neighbourhood
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.peers.placing import WORST_SIGMA_M, blind, contradicts, held
from radron.protocol.entries import Sighting
from radron.protocol.messages import Pose, Stage
from support.flights.two_drones import MISSION, SECOND, plan, pose, status

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
    """b's poses at 10 Hz for three seconds along its x axis at 2 m/s, up to x = 6 m; ``shift``: its own position error."""
    for tick in range(31):
        x, y = 0.2 * tick + shift[0], shift[1]
        yield replace(pose(NOW_NS + (tick - 30) * SECOND // 10, epoch=epoch), position_m=(x, y, 3.0))
    yield replace(status(Stage.TRACK), stamp_ns=NOW_NS)


def sights_of_b(mission_from_b, epoch=0, **values):
    """Sightings of b by a, five times a second, from the origin of the mission frame, which is a's own."""
    for tick in range(0, 31, 2):
        x, y, z = mission_from_b.apply_point((0.2 * tick, 0.0, 3.0))
        distance = float(np.linalg.norm((x, y, z)))
        yield Sighting(
            stamp_ns=NOW_NS + (tick - 30) * SECOND // 10, drone="a", mission="0" * 16, boot="1" * 16, sequence=tick, epoch=epoch,
            target="b", position_m=(0.0, 0.0, 0.0), direction=(x / distance, y / distance, z / distance),
            direction_sigma_rad=0.03, range_m=distance, range_sigma_m=0.3, **values,
        )  # fmt: skip


def around_a(messages, sights=(), known=None, own=HERE, neighbourhood=None):
    """The neighbours of a. ``known``: b's frame by epoch; ``own``: a's, None while it is not known."""
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
    """Drone b went on for longer than its autopilot should, and hovers at (10, 15)."""
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
    """Sightings by a of b hovering there."""
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
    """All holders of the log were restarted: b, out of everyone's sight, is 6 m from its launch, still in the same epoch."""
    before, graph = FrameGraph(), FrameGraph()
    before.place("b", 0, WRONG)
    former = Neighbourhood(ESTIMATED, before, "a")
    around_a(flying_b(shift=(12.0, 0.0)), neighbourhood=former)
    one = Neighbourhood(ESTIMATED, graph, "a")
    assert around_a(flying_b(epoch, shift=(12.0, 0.0)), neighbourhood=one) == []
    one.frames.remember(former.frames.kept)
    assert one.frames.kept.keys() == {"b"}  # for a restart before it is heard
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
        assert other.plan.sigma_m == WORST_SIGMA_M  # a frame that the log no longer gives is uncertain


@pytest.mark.parametrize("seconds", [12, 60])
def test_the_frame_of_before_a_restart_drifts_until_the_log_tells_it(seconds):
    one, kept = Neighbourhood(ESTIMATED, FrameGraph(), "a"), KeptFrame.of(0, NOW_NS - seconds * SECOND, WRONG)
    one.frames.remember({"b": kept})
    for _ in range(2):
        (other,) = around_a(flying_b(shift=(12.0, 0.0)), neighbourhood=one)
        aged = Drift(ESTIMATED).aged("b", WRONG, float(seconds), (18.0, 0.0, 3.0))
        sigma_m = math.hypot(aged.sigmas_at((18.0, 0.0, 3.0))[0], HERE.sigmas_at((0.0, 0.0, 0.0))[0])
        assert other.plan.sigma_m == pytest.approx(min(sigma_m, WORST_SIGMA_M), abs=1e-3)
    again = one.frames.kept["b"]
    assert again.stamp_ns == NOW_NS
    assert again.mission_from_local.covariance == pytest.approx(aged.covariance)


def test_to_read_the_frames_that_are_kept_changes_nothing():
    """Between two plans the log gives the frame, and withdraws it: the drone's known position stays as without a reading."""
    found = []
    for looks in (False, True):
        graph = FrameGraph()
        one = Neighbourhood(ESTIMATED, graph, "a")
        one.frames.remember({"b": KeptFrame.of(0, NOW_NS, WRONG)})
        around_a(flying_b(shift=(12.0, 0.0)), neighbourhood=one)
        graph.place("b", 0, HERE)
        if looks:
            assert one.frames.kept["b"].translation_m == HERE.translation
        graph.replace_from("b", 0, 0, [(0, None)])
        (other,) = around_a(flying_b(shift=(12.0, 0.0)), neighbourhood=one)
        found.append((other.plan.measured.position, other.plan.sigma_m))
    assert found[0] == found[1]


def test_of_a_frame_that_is_not_believed_any_more_the_doubt_is_kept_and_what_the_mission_tells_is_not():
    graph = FrameGraph()
    graph.place("b", 0, WRONG)
    one = Neighbourhood(ESTIMATED, graph, "a")
    around_a(flying_b(), neighbourhood=one)
    assert same(one.frames.kept["b"].mission_from_local, WRONG)
    graph.replace_from("b", 0, 0, [(0, None)])
    assert one.frames.kept["b"].mission_from_local.sigmas_at((0.0, 0.0, 0.0))[0] == pytest.approx(WORST_SIGMA_M)
    layout, peers = FrameGraph.from_launch_layout(MISSION), Peers(["b"])
    exact = Neighbourhood(MISSION, layout, "a")
    peers.receive(pose(), 0)
    assert exact.around(peers, Self(0, 0, 0.1, Transform()))
    assert exact.frames.kept == {}
    layout.place("b", 2, TRUE)  # its localisation has jumped, and back
    peers.receive(pose(SECOND, epoch=2), SECOND)
    exact.follow(peers)
    assert exact.frames.kept["b"].covariance is None
