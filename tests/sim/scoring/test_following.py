"""Plan following, scored from the drones' publications."""

import pytest

from radron.protocol.messages import Plan, Pose, Stage
from radron.sim.scoring.following import Following

SECOND = 1_000_000_000


def plan(stamp_ns=0, epoch=0, positions=((0.0, 0.0, 3.0), (4.0, 0.0, 3.0), (8.0, 0.0, 3.0))):
    return Plan(stamp_ns=stamp_ns, drone="d1", epoch=epoch, step_ns=SECOND, positions_m=positions)


def pose(stamp_ns, x, y, epoch=0):
    return Pose(
        stamp_ns=stamp_ns,
        drone="d1",
        epoch=epoch,
        position_m=(x, y, 3.0),
        velocity_mps=(0.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0),
        position_sigma_m=0.1,
        yaw_sigma_rad=0.01,
    )


def test_search_and_circle_count_for_themselves():
    following = Following()
    following.plan(plan())
    for stamp_ns, (x, y), stage in (
        (SECOND // 2, (2.3, 0.4), Stage.SURVEY),
        (SECOND // 4, (1.0, 1.0), Stage.TRACK),
        (SECOND // 4, (1.0, 0.0), Stage.REACQUIRE),
        (SECOND // 4, (1.0, 9.0), Stage.RETURN),  # neither
    ):
        following.pose(pose(stamp_ns, x, y), stage)
    assert following.rms_m("search") == pytest.approx(0.5)
    assert following.rms_m("circle") == pytest.approx(0.5**0.5)
    assert following.most_m == pytest.approx(1.0)


def test_what_cannot_be_held_against_each_other_does_not_count():
    following = Following()
    following.pose(pose(0, 9.0, 9.0), Stage.TRACK)  # no plan yet
    following.plan(plan())
    following.pose(pose(0, 9.0, 9.0, epoch=1), Stage.TRACK)  # of another frame
    following.pose(pose(3 * SECOND, 9.0, 9.0), Stage.TRACK)  # the plan is old
    following.plan(plan(positions=((0.0, 0.0, 3.0),)))
    following.pose(pose(0, 9.0, 9.0), Stage.TRACK)  # no motion in it
    assert (following.rms_m("circle"), following.rms_m("search"), following.most_m) == (None, None, None)
