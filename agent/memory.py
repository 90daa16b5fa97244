"""What an agent that is restarted in flight must know of its mission: so little that it can be written at every change."""

from __future__ import annotations

from msgspec import Struct

from agent.vehicle.interface import Vector3, VehicleState
from protocol.messages import Stage

REFRESH_NS = 5_000_000_000
OLDEST_NS = 120_000_000_000  # after so long the vehicle is down, or another flight's
_FROM_THE_GROUND = (Stage.TAKEOFF, Stage.LANDING, Stage.ABORT)


class Memory(Struct, frozen=True, kw_only=True):
    """A drone that flies the mission, as of ``stamp_ns`` (UTC, in whole ``REFRESH_NS``: equal memories need no new writing).

    ``started_ns``: stamp of the start command. ``home_m``: where a return leads, mission frame; None if it is not known.
    ``resume``: the stage that a hold goes on to. ``released``: somebody else has taken over the vehicle. ``epoch_offset``: of
    the epochs that it has published, over the vehicle's own.
    """

    mission: str
    stamp_ns: int
    started_ns: int
    stage: Stage
    resume: Stage
    released: bool = False
    tracking_since_ns: int | None = None
    home_m: Vector3 | None = None
    epoch_offset: int = 0

    def fits(self, mission: str, vehicle: VehicleState) -> bool | None:
        """Whether a flight of this mission goes on, by the telemetry; None: not to be told yet (armed, but not in the air)."""
        if self.mission != mission or not vehicle.armed or abs(vehicle.stamp_ns - self.stamp_ns) > OLDEST_NS:
            return False
        return True if vehicle.in_air or self.stage in _FROM_THE_GROUND else None
