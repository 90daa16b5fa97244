import pytest

from agent.config import AreaConfig, DroneInMission, MissionConfig
from agent.frames.graph import FrameGraph
from agent.frames.transform import Transform
from agent.neighbours import WORST_SIGMA_M, Neighbourhood, Self
from agent.peers import Peers
from protocol.messages import Plan, Pose, Stage, Status

SECOND = 1_000_000_000
MISSION = MissionConfig(
    name="test",
    area=AreaConfig(polygon_m=((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))),
    drones=(DroneInMission(id="a"), DroneInMission(id="b", origin_m=(10.0, 0.0, 0.0), yaw_deg=90.0)),
)


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
    return Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION)).around(peers, me)


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


def test_silence_and_unknown_frames():
    assert seen(pose(), now_ns=0) != []
    assert seen(status(Stage.TRACK)) == []
    assert seen(pose(epoch=3), status(Stage.TRACK)) == []


@pytest.mark.parametrize(("theirs", "own", "together"), [(0.3, 0.4, 0.5), (80.0, 0.1, WORST_SIGMA_M)])
def test_errors_of_both_positions_count_but_not_without_limit(theirs, own, together):
    (other,) = seen(pose(sigma_m=theirs), status(Stage.TRACK), own_sigma_m=own)
    assert other.plan.sigma_m == pytest.approx(together)
