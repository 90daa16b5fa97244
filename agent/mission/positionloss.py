"""What a drone does while its position cannot be trusted: satellites lost, or an estimate that has jumped.

At first it stays in place by setpoints, with separation from the others, who keep clear of it by its stated uncertainty. If that
lasts, hold is requested while the autopilot still accepts it: PX4 goes back to the mode chosen last when the satellites return,
and in hold it stays. (In the failsafe that follows it accepts no mode that needs a position.)

The mission continues when the position is confirmed and the drone is certainly well above the ground: a real one has landed
unnoticed, and then taken off at 5 m/s. Near the ground it lands, and wherever it is if the position stays lost for
``LONGEST_NS``, or the battery is low before. A landing that has begun goes on when the position is confirmed; but from then on,
well above the ground, an operator may send the drone home.
"""

from __future__ import annotations

from agent.vehicle.interface import FlightMode, VehicleState

HOLD_NS = 1_000_000_000  # time in place by setpoints; PX4's failsafe comes after EKF2_NOAID_TOUT, 2 s
_LONGEST_STEP_NS = 1_000_000_000
NEAR_GROUND_M = 1.0  # height estimates drift by as much
LONGEST_NS = 30_000_000_000  # it hovers without a position for at most this long
FALL_MPS = 1.0  # PX4 descends at 0.5 to 0.8 m/s without a position
_LOST = "its position could not be trusted (satellites lost, or its estimate jumped)"
WHY = f"{_LOST}, and it was near the ground"
WHY_LONG = f"{_LOST} for {LONGEST_NS * 1e-9:.0f} s"
WHY_LOW = f"{_LOST}, and its battery is below the mission's reserve"


class PositionLoss:
    """Reaction of one drone. ``stays``: it is to hold; ``lands``: why it is to land, or None."""

    def __init__(self) -> None:
        self.stays = False
        self.lands: str | None = None
        self._lost_ns: int | None = None  # for how long; None while it can be trusted
        self._last_ns = 0
        self._flew = False
        self._least_m = 0.0  # lower bound of its height

    def stay_on(self, vehicle: VehicleState, now_ns: int) -> None:
        """The agent before a restart had this vehicle hold, and nothing has told yet that its position can be trusted again."""
        self.stays, self._flew = True, True
        self._lost_ns, self._last_ns, self._least_m = HOLD_NS, now_ns, vehicle.height_m

    def step(self, vehicle: VehicleState, now_ns: int, *, battery_low: bool = False) -> None:
        """Take the newest telemetry of a flight; ``battery_low``: the battery calls for the return."""
        if vehicle.position_trusted:
            self._resume(vehicle)
            return
        passed_ns = min(max(now_ns - self._last_ns, 0), _LONGEST_STEP_NS)  # the clock may have been set
        self._last_ns = now_ns
        if self._lost_ns is None:
            self._lost_ns, self._flew, self._least_m = 0, False, vehicle.height_m
        else:
            self._lost_ns += passed_ns
            if not vehicle.healthy and vehicle.mode is FlightMode.LAND:
                self._least_m -= FALL_MPS * passed_ns * 1e-9
        self._flew = self._flew or vehicle.in_air
        self.stays = self._flew and (not vehicle.healthy or self._lost_ns >= HOLD_NS)
        if not vehicle.healthy and min(vehicle.height_m, self._least_m) < NEAR_GROUND_M:
            self.lands = WHY
        elif self.stays and (battery_low or self._lost_ns >= LONGEST_NS):
            self.lands = WHY_LOW if battery_low else WHY_LONG

    def _resume(self, vehicle: VehicleState) -> None:
        """The position is confirmed; a drone near or on the ground by then does not resume its mission."""
        if vehicle.in_air and vehicle.height_m >= NEAR_GROUND_M:
            self.lands = None
        elif self.stays:
            self.lands = WHY
        self._lost_ns, self.stays = None, False
