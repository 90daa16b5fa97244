"""The ground below and around one drone, in its own local frame."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from agent.ground import Ground
from agent.motion.reference import PeerState
from agent.motion.tracker import Relief
from agent.ownframe import OwnFrame
from agent.vehicle.interface import VehicleState


class OwnGround:
    """By the mission's model and the rangefinder."""

    def __init__(self, ground: Ground, own: OwnFrame) -> None:
        self._ground = ground
        self._own = own

    def level_m(self, vehicle: VehicleState) -> float:
        """Local z from which a reference's heights above ground count, and the fence's: of the ground below.

        Where the ground is not even it is 0: there the tracker adds the height of what lies under its plan.
        """
        return _below_m(vehicle) if self._ground.level else 0.0

    def relief(self, vehicle: VehicleState) -> Relief | None:
        """The ground around the vehicle; None where it is even."""
        if self._ground.level:
            return None
        x, y, _ = vehicle.position_m
        return self._ground.around(self._own.mission_from_local if self._own.is_known else None, (x, y), _below_m(vehicle))

    def above_level(self, state: PeerState, vehicle: VehicleState) -> PeerState:
        """A state near the vehicle with z as references count it."""
        relief, (x, y, z) = self.relief(vehicle), state.position
        if relief is None:
            return state
        return replace(state, position=(x, y, z - float(relief(np.array([[x, y]]))[0])))


def _below_m(vehicle: VehicleState) -> float:
    """Local z of the ground below the vehicle, by what its rangefinder says now."""
    return vehicle.position_m[2] - vehicle.height_m
