"""The ground below and around one drone, in its own local frame."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from agent.localization.ownpose import OwnPose
from agent.motion.reference import PeerState
from agent.motion.tracker import Relief
from agent.terrain.ground import Ground
from agent.vehicle.interface import VehicleState


class OwnGround:
    """The mission's ground model, corrected by the rangefinder."""

    def __init__(self, ground: Ground, own: OwnPose) -> None:
        self._ground = ground
        self._own = own

    def level_m(self, vehicle: VehicleState) -> float:
        """Local z of the ground below, from which the heights of references and fence count.

        0 where the ground is not level: there the tracker adds the height of the ground under its plan.
        """
        return _below_m(vehicle) if self._ground.level else 0.0

    def relief(self, vehicle: VehicleState) -> Relief | None:
        """The ground around the vehicle; None where it is level."""
        if self._ground.level:
            return None
        (x, y, _), frame = vehicle.position_m, self._own.frame
        return self._ground.around(frame.mission_from_local if frame is not None else None, (x, y), _below_m(vehicle))

    def above_level(self, state: PeerState, vehicle: VehicleState) -> PeerState:
        """A state near the vehicle with z above ground, as in references."""
        relief, (x, y, z) = self.relief(vehicle), state.position
        if relief is None:
            return state
        return replace(state, position=(x, y, z - float(relief(np.array([[x, y]]))[0])))


def _below_m(vehicle: VehicleState) -> float:
    """Local z of the ground below the vehicle, by its rangefinder."""
    return vehicle.position_m[2] - vehicle.height_m
