"""Poses of a SLAM on board, from its feed to ODOMETRY messages."""

from __future__ import annotations

import asyncio
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from radron.agent.vehicle.frame import enu_from_flu, enu_from_ned
from radron.agent.vehicle.vision import Vision, VisionPose, odometry
from support.sensors.detector_feed import until
from support.sensors.line_server import line_server

NOW_NS = 1_767_225_600_000_000_000
POSE = VisionPose(stamp_ns=NOW_NS - 20_000_000, position_m=(1.0, 2.0, 3.0), quaternion=(1.0, 0.0, 0.0, 0.0), reset_counter=4)


def test_position_and_variances_are_north_east_down_of_the_slams_own_axes() -> None:
    covariance = tuple(float(row + 1) if row == column else 0.0 for row in range(6) for column in range(6))
    fields = odometry(msgspec.structs.replace(POSE, covariance=covariance))
    assert (fields["x"], fields["y"], fields["z"]) == (2.0, 1.0, -3.0)
    assert [fields["pose_covariance"][place] for place in (0, 6, 11, 15, 18, 20)] == [2.0, 1.0, 3.0, 5.0, 4.0, 6.0]
    assert [fields["pose_covariance"][place] for place in (1, 2, 7, 16)] == [None] * 4
    assert (fields["reset_counter"], fields["time_usec"]) == (4, (NOW_NS - 20_000_000) // 1000)
    assert set(odometry(POSE)["pose_covariance"]) == {None}


@given(*[st.floats(-1e3, 1e3)] * 3, *[st.floats(-1.5, 1.5)] * 3)
def test_what_the_agent_makes_of_an_autopilot_that_believes_the_vision_is_the_slams_pose(
    x: float, y: float, z: float, yaw: float, pitch: float, roll: float
) -> None:
    qx, qy, qz, qw = Rotation.from_euler("ZYX", (yaw, pitch, roll)).as_quat()
    fields = odometry(msgspec.structs.replace(POSE, position_m=(x, y, z), quaternion=(qw, qx, qy, qz)))
    assert enu_from_ned((fields["x"], fields["y"], fields["z"])) == pytest.approx((x, y, z))
    back = enu_from_flu(tuple(fields["q"]))
    assert abs(sum(a * b for a, b in zip(back, (qw, qx, qy, qz), strict=True))) == pytest.approx(1.0)


def test_poses_are_passed_on_and_what_is_none_is_counted() -> None:
    async def course() -> None:
        sent: list[tuple[str, dict[str, Any]]] = []
        async with line_server() as server:
            vision = Vision(server.address, lambda name, fields: sent.append((name, fields)), lambda: NOW_NS)
            assert "no link to the vision" in vision.problems[0]
            running = asyncio.create_task(vision.run())
            await until(lambda: server.clients == 1, "connected")
            encoded = msgspec.json.encode(POSE) + b"\n"
            server.send(encoded)
            await until(lambda: len(sent) == 1, "the pose")
            assert sent == [("ODOMETRY", odometry(POSE))]
            assert vision.problems == ()
            for bad in (
                {"quaternion": [1.0, 1.0, 0.0, 0.0]},
                {"quaternion": [0.0, 0.0, 0.0, 0.0]},
                {"covariance": [1.0]},
                {"position_m": [1.0, 2.0]},
                {"reset_counter": 256},
            ):
                server.send(msgspec.json.encode(msgspec.to_builtins(POSE) | bad) + b"\n")
            await until(lambda: vision.counters["malformed"] == 5, "counted")
            server.send(msgspec.json.encode(msgspec.structs.replace(POSE, stamp_ns=NOW_NS - 600_000_000)) + b"\n")
            await until(lambda: vision.counters["dropped_stale"] == 1, "counted")
            assert len(sent) == 1
            server.send(encoded)
            await until(lambda: len(sent) == 2, "the next one")
            await vision.close()
            async with asyncio.timeout(1.0):
                await running

    asyncio.run(course())
