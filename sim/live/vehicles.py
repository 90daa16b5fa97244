"""Interface of the vehicles in a live world: emulated in its process, or flown by other programs."""

from __future__ import annotations

from typing import Protocol

from radron.sim.vehicle.px4.faults import VehicleFault
from radron.sim.vehicle.px4.fleet import VehicleReport


class Vehicles(Protocol):
    """The vehicles of a live flight, whether they are emulated here or flown by other programs."""

    async def start(self) -> None:
        """Open the links in the running event loop."""

    def begin(self) -> None:
        """Mark the start of the mission: times of localisation events count from now."""

    def step(self) -> None:
        """Emulate the vehicles for one time step."""

    def switch_satellites(self, drone: int, received: bool) -> None:
        """Switch a vehicle's satellite reception."""

    def take_over(self, drone: int, mode: str) -> None:
        """Override a vehicle as a safety pilot does by remote control. ``mode``: ``manual``, ``hold``, ``return`` or ``land``."""

    def begin_fault(self, drone: int, fault: VehicleFault) -> None:
        """Begin a fault of a vehicle, such as a gust or a failed motor."""

    def end_fault(self, drone: int, fault: VehicleFault) -> None:
        """End a fault of a vehicle that has been begun."""

    def reports(self) -> list[VehicleReport]:
        """Return what an observer sees of each vehicle, besides its motion."""

    def close(self) -> None:
        """Close the links of all vehicles."""
