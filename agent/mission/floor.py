"""Whether a vehicle is above the floor, below which nobody searches."""

from __future__ import annotations

from agent.vehicle.interface import VehicleState

_STOPS_S = 0.5  # a vehicle told to stop sinking still sinks as far as it would in this time: its lag, and braking at 2 m/s^2
_ABOVE_FLOOR_M = 0.25  # so far above the floor for sure: heights err by 0.05 m (1 sigma), and references are 0.5 m above it


def is_low(vehicle: VehicleState, floor_m: float) -> bool:
    """Whether it is not surely above the floor (m, above ground), or sinks so fast that it will not be."""
    return vehicle.height_m + _STOPS_S * min(vehicle.velocity_mps[2], 0.0) < floor_m + _ABOVE_FLOOR_M
