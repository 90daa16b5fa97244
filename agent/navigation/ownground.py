"""Height of the ground below and around one drone, in its own local frame."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from radron.agent.config.mission import AreaConfig
from radron.agent.localization.ownpose import OwnPose
from radron.agent.motion.goals import HEIGHT_INSIDE_M
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.tracker import Relief
from radron.agent.terrain.ground import Ground
from radron.agent.vehicle.interface import VehicleState


class OwnGround:
    """Ground model of the mission in the local frame of one drone, with its height corrected by the rangefinder."""

    def __init__(self, ground: Ground, own: OwnPose, area: AreaConfig) -> None:
        self._ground = ground
        self._own = own
        self._low_m, self._high_m = area.floor_m + HEIGHT_INSIDE_M, area.ceiling_m - HEIGHT_INSIDE_M

    def level_m(self, vehicle: VehicleState) -> float:
        """Return the local z (m) from which the heights of references and fence count: that of the ground below the vehicle.

        0 if the mission's ground is not level: then these heights count from the ground, and the tracker adds the ground's own
        height under its plan.
        """
        return _below_m(vehicle) if self._ground.level else 0.0

    def relief(self, vehicle: VehicleState) -> Relief | None:
        """Return the heights of the ground around the vehicle, local z; None if the mission's ground is level."""
        if self._ground.level:
            return None
        (x, y, _), frame = vehicle.position_m, self._own.frame
        return self._ground.around(frame.mission_from_local if frame is not None else None, (x, y), _below_m(vehicle))

    def kept_off(self, reference: Reference, vehicle: VehicleState) -> Reference:
        """Return the reference, raised or lowered by as much as the vehicle is below or above the vertical limits of plans.

        The vehicle may be there although its plans are not: an autopilot with an error in its climb rate stays off its setpoint
        for some seconds, by a metre at worst. The rangefinder shows that.
        """
        lacking_m = max(0.0, self._low_m - vehicle.height_m) - max(0.0, vehicle.height_m - self._high_m)
        if lacking_m == 0.0:
            return reference
        return replace(reference, positions=reference.positions + np.array([0.0, 0.0, lacking_m]))

    def above_level(self, state: PeerState, vehicle: VehicleState) -> PeerState:
        """Return the state, near the vehicle, with z as in references: above the ground if that is not level."""
        relief, (x, y, z) = self.relief(vehicle), state.position
        if relief is None:
            return state
        return replace(state, position=(x, y, z - float(relief(np.array([[x, y]]))[0])))


def _below_m(vehicle: VehicleState) -> float:
    """Return the local z (m) of the ground below the vehicle, by its measured height above the ground."""
    return vehicle.position_m[2] - vehicle.height_m
