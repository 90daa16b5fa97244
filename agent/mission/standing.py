"""A vehicle that has landed and stays armed: its autopilot does not disarm it (COM_DISARM_LAND), or has not noticed."""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.lasting import since
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

STANDS_NS = 10_000_000_000  # PX4 disarms 2 s after a landing by default
WHAT = "has landed and is still armed, for {seconds:.0f} s: command land once more to disarm it, or disarm it by remote control"


class StandingArmed(Struct, frozen=True):
    """The state of one vehicle. ``disarms``: an operator wants it disarmed, as long as it stands."""

    since_ns: int | None = None
    disarms: bool = False

    def observed(self, vehicle: VehicleState, now_ns: int, *, comes_down: bool) -> StandingArmed:
        """Take the newest telemetry; ``comes_down``: in a stage in which it lands."""
        stands = comes_down and vehicle.armed and not vehicle.in_air
        return StandingArmed(since(self.since_ns, now_ns, holds=stands), self.disarms and stands)

    def ordered(self) -> StandingArmed:
        """An operator has commanded to land: a vehicle that stands is to be disarmed."""
        return replace(self, disarms=self.since_ns is not None)

    def problem(self, now_ns: int) -> CodedText | None:
        """Return the message to the operator; None in flight, and until the autopilot has had time to disarm."""
        if self.since_ns is None or now_ns - self.since_ns < STANDS_NS:
            return None
        return CodedText(Code.STILL_ARMED, WHAT.format(seconds=(now_ns - self.since_ns) * 1e-9))
