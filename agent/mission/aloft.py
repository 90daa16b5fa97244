"""Detect an in-flight start: the vehicle flies, and this agent has not started it. The agent was restarted in flight and has lost
its state, or a pilot or a ground station has taken off. One faulty or forged packet does not show it: landed state, arming and
height come in packets of their own.
"""

from __future__ import annotations

from msgspec import Struct

from radron.agent.lasting import since
from radron.agent.mission.positionloss import NEAR_GROUND_M
from radron.agent.vehicle.interface import VehicleState

SHOWN_NS = 500_000_000  # telemetry over this time must agree
_GAP_NS = 500_000_000  # after a longer gap it begins anew


class Aloft(Struct, frozen=True):
    """The evidence that one vehicle flies: since when its telemetry says so, and the stamp of the newest."""

    since_ns: int | None = None
    newest_ns: int = 0

    def observed(self, vehicle: VehicleState) -> Aloft:
        """Take telemetry, each once."""
        flies = vehicle.armed and vehicle.in_air and vehicle.height_m > NEAR_GROUND_M
        follows = 0 < vehicle.stamp_ns - self.newest_ns < _GAP_NS
        return Aloft(since(self.since_ns if follows else None, vehicle.stamp_ns, holds=flies), vehicle.stamp_ns)

    @property
    def shown(self) -> bool:
        """Whether the vehicle has been in the air for long enough."""
        return self.since_ns is not None and self.newest_ns - self.since_ns >= SHOWN_NS
