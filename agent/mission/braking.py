"""The way to a hold, or a landing: the drone brakes by its own setpoints, which keep clear of the others.

Its autopilot would brake straight ahead, over 10 m from the speed of a search. When a whole swarm is commanded to hold, two
drones about to pass each other would both go straight on.
"""

from __future__ import annotations

from math import hypot

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.lasting import since
from radron.agent.vehicle.interface import FlightMode, VehicleState

_STILL_MPS = 0.5
# A vehicle that has just become slow still leans against its way. An autopilot commanded to hold then continues with that
# acceleration, and so backwards, by up to 2.6 m.
_SETTLED_NS = 800_000_000
_LONGEST_NS = 5_000_000_000


class Braking(Struct, frozen=True):
    """The braking of one drone. ``begun_ns``: when the hold, or the landing, was commanded; None once no longer steered."""

    slow_since_ns: int | None = None
    begun_ns: int | None = None

    def begun(self, vehicle: VehicleState, now_ns: int) -> Braking:
        """Begin to brake."""
        return replace(self, begun_ns=now_ns).observed(vehicle, now_ns)

    def observed(self, vehicle: VehicleState, now_ns: int) -> Braking:
        """Brake until the vehicle has been slow for long enough that it accelerates no more, has left offboard, or has lost its
        trusted position; for some seconds at most.
        """
        slow_ns = since(self.slow_since_ns, now_ns, holds=hypot(*vehicle.velocity_mps) <= _STILL_MPS)
        rests = slow_ns is not None and now_ns - slow_ns >= _SETTLED_NS
        is_steered = vehicle.mode is FlightMode.OFFBOARD and vehicle.position_trusted
        is_in_time = self.begun_ns is not None and now_ns - self.begun_ns < _LONGEST_NS
        return Braking(slow_ns, self.begun_ns if is_in_time and is_steered and not rests else None)
