"""The flight around a source of unknown height."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.navigation.peers.newest import Peers
from radron.protocol.messages import Pose, Stage, Status
from support.flights.one_navigator import MISSION, flown, hypothesis
from support.flights.one_pilot import SECOND, START_NS

RAISED = replace(MISSION, source_height_m=(0.0, 20.0))


def climbed_m(mission: MissionConfig = RAISED, stage=Stage.TRACK, peers=None, **values):
    """Height at the end of the first half of a turn, and of the second."""
    turn_s = mission.track.each_s * len(mission.drones)

    def believed(now_ns):
        return hypothesis(now_ns, watched_s=turn_s * (0.2 if now_ns < START_NS + 20 * SECOND else 0.7), **values)

    places = flown(believed, mission=mission, stage=stage, peers=peers)
    return pytest.approx((places[len(places) // 2 - 1, 2], places[-1, 2]), abs=0.1)


def test_a_source_of_unknown_height_is_circled_at_two_heights():
    low_m = MISSION.area.floor_m + 0.8
    assert climbed_m() == (low_m, 6.0)
    assert climbed_m(MISSION) == (low_m, low_m)
    assert climbed_m(stage=Stage.REACQUIRE) == (low_m, low_m)
    assert climbed_m(evidence=None) == (3.0, 3.0)


def test_at_one_height_only_while_a_drone_is_not_heard():
    """Drones without a link to each other differ in height on purpose."""
    peers = Peers(["d2"])
    pose = Pose(
        stamp_ns=START_NS,
        drone="d2",
        epoch=0,
        position_m=(10.0, 10.0, 3.0),
        velocity_mps=(0.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0),
        position_sigma_m=0.1,
        yaw_sigma_rad=0.01,
    )
    status = Status(stamp_ns=START_NS, drone="d2", mission=MISSION.mission_id, boot="1" * 16, stage=Stage.TRACK)
    assert {peers.receive(message, START_NS) for message in (pose, status)} == {None}
    assert climbed_m(peers=peers) == (MISSION.area.floor_m + 0.8, MISSION.area.floor_m + 0.8)
