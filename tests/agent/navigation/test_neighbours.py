import pytest
from msgspec.structs import replace

from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.navigation.myself import Self
from radron.agent.navigation.neighbours import Neighbourhood
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.peers.placing import WORST_SIGMA_M
from radron.protocol.messages import Stage
from support.flights.two_drones import MISSION, SECOND, plan, pose, seen, status


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
    found = seen(pose() if flies else replace(pose(), velocity_mps=(0.0, 0.0, 0.0), in_air=False), status(stage))
    assert [other.takes_part for other in found] == ([takes_part] if flies else [])


def test_silence_and_unknown_frames():
    assert seen(pose(), now_ns=0) != []
    assert seen(status(Stage.TRACK)) == []
    assert seen(pose(epoch=3), status(Stage.TRACK)) == []


@pytest.mark.parametrize(("theirs", "own", "together"), [(0.3, 0.4, 0.5), (80.0, 0.1, WORST_SIGMA_M)])
def test_errors_of_both_positions_count_but_not_without_limit(theirs, own, together):
    (other,) = seen(pose(sigma_m=theirs), status(Stage.TRACK), own_sigma_m=own)
    assert other.plan.sigma_m == pytest.approx(together)


def flown(apart_m, seconds, hood, peers, since_s=0.0):
    """b flies along its plans, apart from them to its side; the estimate of it in the end."""
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
    """Its plan leads it past at 4 m/s, but its pilot has stopped it: after 0.6 s it is 2.4 m behind its plan. For as long as that
    is recent, the pose may be wrong instead.
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


@pytest.mark.parametrize(
    ("stage", "steered", "apart_m", "is_doubted"),
    [
        (Stage.LANDING, True, 13.0, True),
        (Stage.ABORT, True, 13.0, True),
        (Stage.HOLD, True, 13.0, False),  # the pilot flies it anywhere
        (Stage.LANDING, False, 13.0, False),  # and had it land where he had flown it
        (Stage.LANDING, True, 0.1, False),
    ],
)
def test_who_lands_while_its_poses_contradict_its_last_plan_may_stand_where_that_led(stage, steered, apart_m, is_doubted):
    """Its poses were 13 m beside its plans: as soon as it landed, and so published none any more, another came to 2.2 m of it."""
    peers, hood = Peers(["b"]), Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    hovers = replace(plan(), positions_m=((1.0, 0.0, 3.0), (1.0, 0.0, 3.0)))
    beside = replace(pose(), position_m=(1.0 + apart_m, 0.0, 3.0), velocity_mps=(0.0, 0.0, 0.0), steered=steered)
    for message in (hovers, beside, status(Stage.RETURN)):
        assert peers.receive(message, 0) is None
    hood.around(peers, Self(0, 0, 0.0, Transform()))
    for tick in range(1, 60):
        now_ns = tick * SECOND // 10
        assert peers.receive(replace(beside, stamp_ns=now_ns, steered=False), now_ns) is None
        if tick % 10 == 0:
            assert peers.receive(replace(status(stage), stamp_ns=now_ns), now_ns) is None
        found = hood.around(peers, Self(now_ns, 0, 0.0, Transform()))
    told, *as_planned = (one.plan for one in found)
    assert told.at(now_ns) == pytest.approx((10.0, 1.0 + apart_m))
    assert [(place.at(now_ns), place.blind) for place in as_planned] == [(pytest.approx((10.0, 1.0)), True)] * is_doubted
    for later_ns in range(now_ns + SECOND // 10, now_ns + 3 * SECOND, SECOND // 10):
        assert peers.receive(replace(beside, stamp_ns=later_ns, in_air=False), later_ns) is None
    now_ns = later_ns
    assert peers.receive(replace(status(Stage.LANDED), stamp_ns=now_ns), now_ns) is None
    assert hood.around(peers, Self(now_ns, 0, 0.0, Transform())) == []


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
    follows = replace(pose(now_ns), position_m=(1.0, 0.4, 3.0), stamp_ns=now_ns + SECOND // 10)
    hood = Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a")
    for message in (pose(), plan(), status(Stage.TRACK), stopped, plan(now_ns), follows):
        assert peers.receive(message, now_ns) is None
        found = hood.around(peers, Self(now_ns, 0, 0.0, Transform()))
    assert [one.plan.blind for one in found] == [False]


def test_a_drone_that_publishes_plans_no_more_gives_no_way():
    assert seen(pose(3 * SECOND // 2), plan(SECOND), status(Stage.TRACK), now_ns=3 * SECOND // 2)[0].plan.blind is False
    assert seen(pose(3 * SECOND // 2), plan(), status(Stage.HOLD), now_ns=3 * SECOND // 2)[0].plan.blind is True


def test_a_drone_whose_poses_say_that_it_is_not_steered_is_placed_by_them_at_once():
    """However new its last plan is: a pilot who takes over needs no second to leave it."""
    taken = replace(pose(SECOND // 10), velocity_mps=(0.0, 0.0, 0.0), steered=False)
    (other,) = seen(taken, plan(), status(Stage.TRACK), now_ns=SECOND // 10)
    assert other.plan.positions[-1] == pytest.approx((10.0, 1.0, 3.0))
    assert other.plan.blind
    (steered,) = seen(replace(taken, steered=True), plan(), status(Stage.TRACK), now_ns=SECOND // 10)
    assert len(steered.plan.positions) == len(plan().positions_m)
    assert not steered.plan.blind
