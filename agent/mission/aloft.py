"""Whether a vehicle flies that this agent has not started: its agent was restarted in flight and has lost its state, or somebody
else has taken off. One faulty or forged packet does not show it: landed state, arming and height come in packets of their own.
"""

from __future__ import annotations

from agent.mission.positionloss import NEAR_GROUND_M
from agent.vehicle.interface import VehicleState

SHOWN_NS = 500_000_000  # telemetry of so long must say the same
_GAP_NS = 500_000_000  # after a longer gap it begins anew


class Aloft:
    """Takes the telemetry of one vehicle. ``shown``: it evidently flies."""

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self._newest_ns = 0

    def take(self, vehicle: VehicleState) -> None:
        """Take telemetry, each once."""
        flies = vehicle.armed and vehicle.in_air and vehicle.height_m > NEAR_GROUND_M
        follows = 0 < vehicle.stamp_ns - self._newest_ns < _GAP_NS
        if not flies:
            self._since_ns = None
        elif self._since_ns is None or not follows:
            self._since_ns = vehicle.stamp_ns
        self._newest_ns = vehicle.stamp_ns

    @property
    def shown(self) -> bool:
        """Whether it has been in the air for long enough."""
        return self._since_ns is not None and self._newest_ns - self._since_ns >= SHOWN_NS
