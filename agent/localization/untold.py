"""Local frame of this drone as long as the log does not give it."""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.frames.drift import Drift
from radron.agent.frames.transform import Transform
from radron.agent.vehicle.interface import VehicleState


class Untold(Struct, frozen=True):
    """Frame of an epoch (``transform``: mission from local) at ``stamp_ns``, by continuous motion, or as last known."""

    epoch: int
    transform: Transform
    stamp_ns: int

    def drifted(self, drone: str, vehicle: VehicleState, drift: Drift) -> Untold:
        """Return the frame with its uncertainty grown up to the time of this telemetry; unchanged within a second of the last
        time, and for telemetry of another epoch.
        """
        seconds = (vehicle.stamp_ns - self.stamp_ns) * 1e-9
        if vehicle.epoch != self.epoch or 0.0 <= seconds < 1.0:
            return self
        transform = drift.aged(drone, self.transform, seconds, vehicle.position_m)
        return replace(self, transform=transform, stamp_ns=vehicle.stamp_ns)
