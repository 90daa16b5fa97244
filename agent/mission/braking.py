"""The way to a hold, or a landing: a drone that is told so brakes by its own setpoints, which keep clear of the others.

Its autopilot would brake straight ahead, over 10 m from the speed of a search. Where a whole swarm is told to hold, two that were
about to pass each other would both go straight on.
"""

from __future__ import annotations

from math import hypot

from agent.vehicle.interface import FlightMode, VehicleState

_STILL_MPS = 0.5
# A vehicle that has just become slow still leans against its way. An autopilot that is told to hold then goes on with that
# acceleration, and so backwards, by up to 2.6 m.
_SETTLED_NS = 800_000_000
_LONGEST_NS = 5_000_000_000


class Braking:
    """Of one drone. ``lasts``: it is still steered."""

    def __init__(self) -> None:
        self._begun_ns = 0
        self._slow_since_ns: int | None = None
        self.lasts = False

    def begin(self, vehicle: VehicleState, now_ns: int) -> None:
        """It is told to hold, or to land."""
        self._begun_ns, self.lasts = now_ns, True
        self.step(vehicle, now_ns)

    def step(self, vehicle: VehicleState, now_ns: int) -> None:
        """Until it has been slow for long enough that it accelerates no more, or something else flies it, or its position cannot
        be trusted; for some seconds at most.
        """
        if hypot(*vehicle.velocity_mps) > _STILL_MPS:
            self._slow_since_ns = None
        elif self._slow_since_ns is None or self._slow_since_ns > now_ns:  # or the clock was set back
            self._slow_since_ns = now_ns
        rests = self._slow_since_ns is not None and now_ns - self._slow_since_ns >= _SETTLED_NS
        is_steered = vehicle.mode is FlightMode.OFFBOARD and vehicle.position_trusted
        self.lasts = self.lasts and not rests and is_steered and 0 <= now_ns - self._begun_ns < _LONGEST_NS
