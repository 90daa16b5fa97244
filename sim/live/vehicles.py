"""The interface of the vehicles in a live world: emulated in its process, or flown elsewhere."""

from __future__ import annotations

from typing import Protocol

from radron.sim.vehicle.px4.faults import VehicleFault
from radron.sim.vehicle.px4.fleet import VehicleReport


class Vehicles(Protocol):
    """The vehicles' simulation, here or elsewhere."""

    async def start(self) -> None:
        """Open the links on the running loop."""

    def begin(self) -> None:
        """Start the mission."""

    def step(self) -> None:
        """Advance by one step."""

    def switch_satellites(self, drone: int, received: bool) -> None:
        """Switch a vehicle's satellite reception."""

    def take_over(self, drone: int, mode: str) -> None:
        """Override a vehicle as a safety pilot by remote control: ``manual``, ``hold``, ``return`` or ``land``."""

    def begin_fault(self, drone: int, fault: VehicleFault) -> None:
        """Begin a fault of a vehicle."""

    def end_fault(self, drone: int, fault: VehicleFault) -> None:
        """End a fault of a vehicle."""

    def reports(self) -> list[VehicleReport]:
        """Return an observer's view of each vehicle, besides its motion."""

    def close(self) -> None:
        """Close the links."""
