"""Behaviour of a drone whose position cannot be trusted: satellites lost, or an estimate that has jumped.

At first it stays in place by setpoints, with separation from the others, which keep clear of it by its stated uncertainty. If
that lasts, hold is requested while the autopilot still accepts it: PX4 goes back to the mode chosen last when the satellites
return, and in hold it stays. (In the failsafe that follows it accepts no mode that needs a position.)

The mission continues when the position is confirmed and the drone is certainly well above the ground. A real drone has landed
unnoticed, and then taken off at 5 m/s. The drone lands near the ground, and anywhere if the position stays lost for
``LONGEST_NS``, or the battery is low before. A landing that has begun continues when the position is confirmed. But from then on,
well above the ground, an operator may send the drone home.
"""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.vehicle.interface import FlightMode, VehicleState

HOLD_NS = 1_000_000_000  # time in place by setpoints; PX4's failsafe comes after EKF2_NOAID_TOUT, 2 s
_LONGEST_STEP_NS = 1_000_000_000
NEAR_GROUND_M = 1.0  # height estimates drift by as much
LONGEST_NS = 30_000_000_000  # longest hover without a position
FALL_MPS = 1.0  # PX4 descends at 0.5 to 0.8 m/s without a position
_LOST = "its position could not be trusted (satellites lost, or its estimate jumped)"
WHY = f"{_LOST}, and it was near the ground"
WHY_LONG = f"{_LOST} for {LONGEST_NS * 1e-9:.0f} s"
WHY_LOW = f"{_LOST}, and its battery is below the mission's reserve"


class PositionLoss(Struct, frozen=True):
    """The reaction of one drone. ``stays``: it is to hold; ``lands``: why it is to land, or None. ``lost_ns``: for how long the
    position has been lost; None while it can be trusted. ``least_m``: lower bound of the height.
    """

    stays: bool = False
    lands: str | None = None
    lost_ns: int | None = None
    last_ns: int = 0
    flew: bool = False
    least_m: float = 0.0

    @classmethod
    def held(cls, vehicle: VehicleState, now_ns: int) -> PositionLoss:
        """The agent before a restart had this vehicle hold, and its position is not confirmed yet."""
        return cls(stays=True, lost_ns=HOLD_NS, last_ns=now_ns, flew=True, least_m=vehicle.height_m)

    def observed(self, vehicle: VehicleState, now_ns: int, *, battery_low: bool = False) -> PositionLoss:
        """Take the newest telemetry of a flight; ``battery_low``: the battery calls for the return."""
        if vehicle.position_trusted:
            return self._confirmed(vehicle)
        lost_ns, flew, least_m, lands = 0, vehicle.in_air, vehicle.height_m, self.lands
        if self.lost_ns is not None:
            passed_ns = min(now_ns - self.last_ns, _LONGEST_STEP_NS)
            falls = not vehicle.healthy and vehicle.mode is FlightMode.LAND
            lost_ns, flew = self.lost_ns + passed_ns, self.flew or vehicle.in_air
            least_m = self.least_m - (FALL_MPS * passed_ns * 1e-9 if falls else 0.0)
        stays = flew and (not vehicle.healthy or lost_ns >= HOLD_NS)
        if not vehicle.healthy and min(vehicle.height_m, least_m) < NEAR_GROUND_M:
            lands = WHY
        elif stays and (battery_low or lost_ns >= LONGEST_NS):
            lands = WHY_LOW if battery_low else WHY_LONG
        return PositionLoss(stays, lands, lost_ns, now_ns, flew, least_m)

    def _confirmed(self, vehicle: VehicleState) -> PositionLoss:
        """The position is confirmed; a drone near or on the ground by then does not resume its mission."""
        is_high = vehicle.in_air and vehicle.height_m >= NEAR_GROUND_M
        lands = None if is_high else WHY if self.stays else self.lands
        return replace(self, lands=lands, lost_ns=None, stays=False)
