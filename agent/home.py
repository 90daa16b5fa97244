"""Where a return leads: the place of the take-off, in the drone's own frame by then."""

from __future__ import annotations

from math import hypot

from agent.ownframe import OwnFrame
from agent.vehicle.interface import Vector3, VehicleState

AT_HOME_M = 0.5
AT_HOME_MPS = 0.3


class Home:
    """Of one drone."""

    def __init__(self, own: OwnFrame) -> None:
        self._own = own
        self._launch: VehicleState | None = None
        self._remembered: Vector3 | None = None

    def took_off(self, vehicle: VehicleState) -> None:
        """It is here."""
        self._launch = vehicle

    def remember(self, place: Vector3 | None) -> None:
        """Take the place from before this agent was restarted; mission frame."""
        self._remembered = place

    @property
    def in_mission(self) -> Vector3 | None:
        """The place in the mission frame; None while nobody knows where that is."""
        launch = self._launch
        return self._own.in_mission(launch.epoch, launch.stamp_ns, launch.position_m) if launch is not None else self._remembered

    def in_local(self, epoch: int) -> Vector3 | None:
        """The place in the local frame of this epoch; also where only that frame is known, if the drone took off in it."""
        place = self.in_mission
        if self._own.locate(epoch) and place is not None:
            return self._own.local_from_mission.apply_point(place)
        launch = self._launch
        return launch.position_m if launch is not None and launch.epoch == epoch else None

    def is_reached(self, vehicle: VehicleState) -> bool:
        """Whether the drone hovers over it, near enough to land there."""
        place = self.in_local(vehicle.epoch)
        if place is None:
            return False
        x, y, _ = place
        u, v, _ = vehicle.velocity_mps
        return hypot(vehicle.position_m[0] - x, vehicle.position_m[1] - y) < AT_HOME_M and hypot(u, v) < AT_HOME_MPS
