"""The camera's place over the ground on which the source lies, by the rangefinder.

An autopilot's own height drifts by a metre and more. Beside a source at 8 m the direction is then wrong by 7 degrees, for a
vehicle landed a metre from it by 45 degrees. With a hundred such cones a second the whole swarm followed them away.
"""

from __future__ import annotations

from collections.abc import Callable

from radron.agent.config.mission import DroneInMission
from radron.agent.frames.graph import LAUNCH_EPOCH
from radron.agent.geometry import Vector3
from radron.agent.terrain.ground import Ground
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.entries import CarriedFrame


class OverGround:
    """Corrects the heights of one drone's measurement positions by its rangefinder, as the source lies on the ground.

    Only for a frame that is known exactly, or continued from such a frame, over level ground. Otherwise the height is part of the
    estimate, or of the ground's shape.
    """

    def __init__(self, member: DroneInMission, ground: Ground, carried: Callable[[int], CarriedFrame | None]) -> None:
        """Set up the correction. ``member``: this drone; ``carried``: see ``OwnPose``."""
        known = member.is_exact and ground.level
        self._ground_z_m = ground.height_m(0.0, 0.0) - member.origin_m[2] if known else None  # in the frame of the launch
        self._carried = carried

    def placed(self, position: Vector3, state: VehicleState) -> Vector3:
        """Return a position (local frame, m) with the height by the rangefinder; ``state``: the telemetry before it."""
        if self._ground_z_m is None:
            return position
        frame_z_m = 0.0
        if state.epoch != LAUNCH_EPOCH:
            carried = self._carried(state.epoch)
            if carried is None:
                return position
            frame_z_m = carried.translation_m[2]
        x, y, z = position
        return x, y, self._ground_z_m - frame_z_m + state.height_m + z - state.position_m[2]
