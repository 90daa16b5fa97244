"""Vision poses for the autopilot: from the TCP feed of a SLAM on board to MAVLink's ODOMETRY.

The feed sends one pose per line, as JSON, at 10 to 50 Hz:

{"stamp_ns": 1767225600000000000, "position_m": [1.0, 2.0, 0.5], "quaternion": [1.0, 0.0, 0.0, 0.0],
 "covariance": [0.01, ... 36 numbers, rows of x, y, z, roll, pitch, yaw], "reset_counter": 0}

Position and attitude (w, x, y, z; local from body FLU) are in the SLAM's own frame: z up, any heading. ``covariance`` (m2,
rad2; as in ROS) may be omitted. ``reset_counter`` grows where that frame jumps.

PX4 gets them in MAV_FRAME_LOCAL_FRD, an upright frame of any heading. Its x is the SLAM's y. The agent derives the drone's local
frame from PX4's as if its axes were north, east and down, so the local frame has the SLAM's axes again.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from math import hypot, isfinite
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import replace

from radron.agent.feed import LineFeed
from radron.agent.geometry import Quaternion, Vector3
from radron.agent.owntime import Utc
from radron.agent.vehicle.frame import frd_from_flu, ned_from_enu
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

STALE_NS = 500_000_000
SILENCE_S = 1.0  # without poses for this long the autopilot soon loses its position
Counted = Annotated[int, Meta(ge=0, le=255)]
_LOCAL_FRD, _BODY_FRD, _VISION = 20, 12, 2  # MAV_FRAME, MAV_FRAME, MAV_ESTIMATOR_TYPE
_UPPER = 21  # numbers of the upper triangle of 6 x 6
# Indices of the variances in the feed's 6 x 6 and in the message's upper triangle. North is the feed's y.
_VARIANCES = ((7, 0), (0, 6), (14, 11), (28, 15), (21, 18), (35, 20))
_ROUNDING = 1e-2  # tolerance of a unit quaternion's length


class VisionPose(Struct, frozen=True, kw_only=True):
    """A pose from the visual or LiDAR SLAM on board: one line of its TCP feed."""

    stamp_ns: int
    position_m: Vector3
    quaternion: Quaternion
    covariance: Annotated[tuple[float, ...], Meta(min_length=36, max_length=36)] | None = None
    reset_counter: Counted = 0


_DECODER = msgspec.json.Decoder(VisionPose)


class Vision:
    """Forwarder of the poses of a SLAM on board, from its TCP feed to the autopilot, as MAVLink messages.

    ``counters``: poses, malformed lines, poses whose stamp is off by more than 0.5 s and which are dropped (``dropped_stale``),
    and connections of the feed.
    """

    def __init__(
        self,
        address: str,
        send: Callable[[str, dict[str, Any]], None],
        clock_ns: Callable[[], int],
        utc: Utc | None = None,
    ) -> None:
        """Set up the forwarding, without a connection yet; ``run`` connects. Raises ConfigError for an invalid address.

        Args:
            address: of the SLAM's TCP feed, the key ``vehicle.vision.address`` of the drone file.
            send: sends a MAVLink message to the autopilot, given its name and its fields.
            clock_ns: returns the present own time.
            utc: conversion of the feed's stamps, which are by the computer's clock, to own time. None: both are the same.
        """
        self._utc = utc or Utc()
        self._feed = LineFeed("the vision system", "vehicle.vision.address", address)
        self._send = send
        self._clock_ns = clock_ns
        self._pose_s = float("-inf")
        self._flaw: str | None = None
        self.counters: Counter[str] = self._feed.counters

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """The present problems of the SLAM's feed, one line each."""
        if time.monotonic() - self._pose_s < SILENCE_S:
            return ()
        text = self._feed.problem or self._flaw or f"no pose from the vision system for {SILENCE_S:g} s"
        return (CodedText(Code.VISION_FEED, text),)

    async def run(self) -> None:
        """Forward poses to the autopilot until ``close`` is called."""
        async for lines in self._feed.items():
            for line in lines:
                pose = self._pose(line)
                if pose is not None:
                    self._send("ODOMETRY", odometry(pose))

    def _pose(self, line: bytes) -> VisionPose | None:
        """Parse one line; malformed lines and stale poses are counted and dropped."""
        try:
            pose = _DECODER.decode(line)
        except msgspec.MsgspecError as error:
            self.counters["malformed"] += 1
            self._flaw = f"the vision system sends malformed poses: {error}"
            return None
        length = hypot(*pose.quaternion)
        if not isfinite(sum(pose.position_m)) or not abs(length - 1.0) < _ROUNDING:
            self.counters["malformed"] += 1
            self._flaw = f"the vision system sends a quaternion of length {length:g}"
            return None
        own_ns = self._utc.own_ns(pose.stamp_ns)
        late_ns = self._clock_ns() - own_ns
        if abs(late_ns) > STALE_NS:
            self.counters["dropped_stale"] += 1
            self._flaw = f"poses of the vision system are {late_ns * 1e-9:+.1f} s late and are dropped: check its clock"
            return None
        self.counters["poses"] += 1
        self._pose_s = time.monotonic()
        return replace(pose, stamp_ns=own_ns)

    async def close(self) -> None:
        """Close the feed of the SLAM, so that ``run`` ends."""
        await self._feed.close()


def odometry(pose: VisionPose) -> dict[str, Any]:
    """Return the fields of the MAVLink message ODOMETRY for a pose stamped in own time; None stands for NaN (not known).

    PX4 converts the stamp to its own clock by TIMESYNC.
    """
    x, y, z = ned_from_enu(pose.position_m)
    covariance: list[float | None] = [None] * _UPPER
    if pose.covariance is not None:
        for place, there in _VARIANCES:
            covariance[there] = pose.covariance[place]
    unknown = dict.fromkeys(("vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed"))
    return unknown | {
        "time_usec": pose.stamp_ns // 1000,
        "frame_id": _LOCAL_FRD,
        "child_frame_id": _BODY_FRD,
        "x": x,
        "y": y,
        "z": z,
        "q": list(frd_from_flu(pose.quaternion)),
        "pose_covariance": covariance,
        "velocity_covariance": [None] * _UPPER,
        "reset_counter": pose.reset_counter,
        "estimator_type": _VISION,
        "quality": 0,
    }
