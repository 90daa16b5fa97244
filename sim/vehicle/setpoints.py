"""Conversion of the autopilots' targets from the vehicles' local frames to setpoints in the world frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from radron.sim.geometry import Array, Vector3
from radron.sim.vehicle.guidance import Target
from radron.sim.vehicle.multirotor import Setpoints
from radron.sim.world.frame import LocalFrames


def in_world(targets: Sequence[Target], places: Sequence[Vector3], frames: LocalFrames, yaw_error_rad: Array) -> Setpoints:
    """Convert the targets of N autopilots to setpoints in the world frame (ENU).

    places: positions of the targets, m, in the local frames. yaw_error_rad: (N,) errors of the headings that the autopilots
    control.
    """
    turned = frames.to_world([(place, one.velocity, one.acceleration) for one, place in zip(targets, places, strict=True)])
    yaws = np.array([(one.yaw, one.yaw_rate) for one in targets])
    return Setpoints(
        turned[:, 0] + frames.origin, turned[:, 1], turned[:, 2], yaws[:, 0] + frames.yaw_rad - yaw_error_rad, yaws[:, 1]
    )
