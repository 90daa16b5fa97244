"""Emulation of PX4's EKF2 without satellites (dead reckoning), for a vehicle that uses them: loss and return.

As recorded: it continues by its inertial sensors for EKF2_NOAID_TOUT with a growing error, and reports little of it; after that
the position is unknown. 20 s without satellites in a hover gave an error of 99 m. When they return after a few seconds the
position converges; once the fusion had stopped it is reset, which the reset counter reports. A vehicle that has landed and been
disarmed detects that it is at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from math import cos, exp, hypot, sin, tau

import numpy as np

from radron.sim.geometry import Array
from radron.sim.vehicle.px4 import events
from radron.sim.vehicle.px4.events import Announcement
from radron.sim.vehicle.px4.parameters import Parameters
from radron.sim.world.localization import Localization

DRIFT_MPS = (0.1, 0.8)  # initial velocity error
DRIFT_MPS2 = (0.08, 0.35)  # its growth: tilt and accelerometer errors
ASIDE_RAD = 0.5  # largest angle between the two
AIDING_END_DELAY_S = (0.22, 0.25)  # delay beyond EKF2_NOAID_TOUT
GIVEN_UP_S = 2.32  # beyond EKF2_NOAID_TOUT: the fusion has stopped
AT_REST_S = 2.7  # after disarming
TAKEN_S = (0.28, 0.4)  # delay after the return until they are used, with the position known throughout
RESET_S = (1.0, 1.25)  # else, in the air
RESET_STANDING_S = 0.5
VALID_S = 1.0  # after that, until the position is trusted
FAST_SLIDE_S, SLIDE_S = 0.3, 0.9  # time constants of the convergence
REPORTED_MPS, REPORTED_MPS2 = 0.22, 0.0125  # growth of the reported accuracy
RATIO_KEEP_S = 1.12  # decay time of test ratios without comparisons
RESETS_FLYING, RESETS_STANDING = 4, 2
EXTERNAL_SHARE, EXTERNAL_SHARE_BLIND = 0.3, 0.75  # share of the way to an externally sent position
TOLD_RESETS, TOLD_RESETS_BLIND, TOLD_SLIDE_S = 1, 2, 2.2
HEADING_S = 8.0  # time constant of the recovery of a reset heading, as recorded (v1.16.1)


class _Phase(Enum):
    AIDED = 0
    BLIND = 1  # no satellites
    RETURNING = 2  # available, but not used yet
    SLIDING = 3  # used; converging


class DeadReckoning:
    """Simulates the position error of one vehicle that has lost its satellites, and what its filter reports.

    Errors are estimate minus truth, world axes, in addition to the small errors of ``radron.sim.world.localization``. known: the
    position is known. fused: satellites are used, or were recently. still: the filter assumes to be at rest. resets: number so
    far. reported_sigma_m: 1 sigma, horizontal, in addition to the usual one. velocity_ratio, position_ratio: innovation test
    ratios.
    """

    def __init__(
        self,
        parameters: Parameters,
        step_s: float,
        rng: np.random.Generator,
        announce: Callable[[Announcement], None],
        drift_mps2: tuple[float, float] = DRIFT_MPS2,
    ) -> None:
        """``drift_mps2``: smallest and largest growth of the velocity error."""
        self.known = self.fused = True
        self.still = False
        self.resets = 0
        self.reported_sigma_m = 0.0
        self.velocity_ratio, self.position_ratio = 0.1, 0.05
        self.error_m, self.velocity_mps = np.zeros(3), np.zeros(3)
        self._parameters, self._step_s, self._rng, self._announce = parameters, step_s, rng, announce
        self._phase = _Phase.AIDED
        self._blind_s = self._since_s = self._rest_s = 0.0
        self._growth_mps2 = np.zeros(3)
        self._drift_mps2 = drift_mps2
        self._notice_s = self._reset_s = 0.0
        self._slide_s = SLIDE_S

    def step(self, aided: bool, armed: bool) -> Array | None:
        """Simulate the error for one time step; return the jump (3,) of the position at a reset, else None.

        ``aided``: the filter has satellites.
        """
        self._since_s += self._step_s
        self._rest_s = 0.0 if armed else self._rest_s + self._step_s
        if aided and self._phase is _Phase.BLIND:
            self._begin(_Phase.RETURNING)
            self._reset_s = self._return_delay_s(armed)
        elif not aided and self._phase is not _Phase.BLIND:
            self._lose()
        if self._phase in (_Phase.BLIND, _Phase.RETURNING):
            return self._coast()
        self._settle()
        return None

    def accept_place(self, place_m: Array, true_m: Array) -> None:
        """Process a position (3,) that an external source has sent, world. ``true_m``: (3,) the true position.

        The filter moves a part of the way: little while satellites contradict, most of it without them.
        """
        blind = self._phase is _Phase.BLIND
        shift_m = (EXTERNAL_SHARE_BLIND if blind else EXTERNAL_SHARE) * (place_m - true_m - self.error_m)
        self.error_m = self.error_m + shift_m
        self.resets += TOLD_RESETS_BLIND if blind else TOLD_RESETS
        self.position_ratio = min(0.95, self.position_ratio + 0.15 * float(np.linalg.norm(shift_m)))
        if self._phase is _Phase.AIDED:
            self._begin(_Phase.SLIDING)
            self._slide_s = TOLD_SLIDE_S

    def _begin(self, phase: _Phase) -> None:
        self._phase, self._since_s = phase, 0.0

    def _lose(self) -> None:
        rng = self._rng
        self._begin(_Phase.BLIND)
        self._blind_s = 0.0
        self._notice_s = float(rng.uniform(*AIDING_END_DELAY_S))
        angle = float(rng.uniform(0.0, tau))
        aside = angle + float(rng.uniform(-ASIDE_RAD, ASIDE_RAD))
        self.velocity_mps = self.velocity_mps + rng.uniform(*DRIFT_MPS) * np.array([cos(angle), sin(angle), 0.0])
        self._growth_mps2 = rng.uniform(*self._drift_mps2) * np.array([cos(aside), sin(aside), 0.0])

    def _return_delay_s(self, armed: bool) -> float:
        if not armed and not self.known:
            return RESET_STANDING_S
        return float(self._rng.uniform(*(TAKEN_S if self.known else RESET_S)))

    def _coast(self) -> Array | None:
        self._blind_s += self._step_s
        timeout_s = self._parameters["EKF2_NOAID_TOUT"] * 1e-6
        if self.still:
            self.velocity_mps = np.zeros(3)
        else:
            self.velocity_mps = self.velocity_mps + self._growth_mps2 * self._step_s
            self.error_m = self.error_m + self.velocity_mps * self._step_s
            self.reported_sigma_m = REPORTED_MPS * self._blind_s + REPORTED_MPS2 * self._blind_s**2
        if self._phase is _Phase.RETURNING and self._since_s >= self._reset_s:
            return self._take_again()
        keep = exp(-self._step_s / RATIO_KEEP_S)
        self.velocity_ratio, self.position_ratio = self.velocity_ratio * keep, self.position_ratio * keep
        if self.known and self._blind_s > timeout_s + self._notice_s:
            self.known = False
            if self._phase is _Phase.RETURNING:  # they came back too late
                self._reset_s = self._since_s + float(self._rng.uniform(*RESET_S))
        if self.fused and self._blind_s > timeout_s + GIVEN_UP_S:
            self.fused = False
            self._announce(events.FUSION_STOPPED)
        if not self.known and not self.still and self._rest_s > AT_REST_S:
            self.still = True
            self.resets += RESETS_STANDING
            self.reported_sigma_m = 0.0
        return None

    def _take_again(self) -> Array | None:
        """Satellites are used again; returns the jump (3,) if the fusion had stopped."""
        error = float(np.linalg.norm(self.error_m))
        self.velocity_ratio, self.position_ratio = min(0.95, 0.1 + 0.25 * min(1.0, error)), min(0.95, 0.06 + 0.09 * error)
        self._begin(_Phase.SLIDING)
        self._slide_s = SLIDE_S if self.known else FAST_SLIDE_S
        self.velocity_mps = np.zeros(3)
        if self.fused:
            return None
        jump = -self.error_m
        self.error_m = np.zeros(3)
        self.resets += RESETS_STANDING if self.still else RESETS_FLYING
        if not self.still:
            self._announce(events.FUSION_STARTED)
        self.fused, self.still, self.reported_sigma_m = True, False, 0.7
        return jump

    def _settle(self) -> None:
        if self._phase is _Phase.AIDED:
            return
        self.error_m = self.error_m * exp(-self._step_s / self._slide_s)
        self.reported_sigma_m *= exp(-self._step_s / 0.6)
        fade = exp(-self._step_s / 2.5)
        self.velocity_ratio = 0.1 + (self.velocity_ratio - 0.1) * fade
        self.position_ratio = 0.05 + (self.position_ratio - 0.05) * fade
        if self._since_s >= VALID_S:
            self.known = True
        if self.known and hypot(*self.error_m.tolist()) < 0.01 and self.reported_sigma_m < 0.01:
            self.error_m = np.zeros(3)
            self.reported_sigma_m = 0.0
            self._begin(_Phase.AIDED)


class FilterErrors:
    """Simulates all errors of N vehicles' filters: the small errors, those without satellites, and heading resets.

    The interface is that of ``radron.sim.world.localization``.
    """

    def __init__(self, small: Localization, step_s: float) -> None:
        """``small``: the small errors, with satellites. ``step_s``: time step."""
        self._small = small
        count = len(small.position_error_m)
        self._drift_m, self._drift_mps = np.zeros((count, 3)), np.zeros((count, 3))
        self._turned_rad, self._turned_keep = np.zeros(count), exp(-step_s / HEADING_S)

    def turn(self, drone: int, angle_rad: float) -> None:
        """Reset a vehicle's heading by an angle; the filter finds the right heading again within seconds."""
        self._turned_rad[drone] += angle_rad

    def take(self, drone: int, reckoning: DeadReckoning) -> None:
        """Use the latest error of one vehicle without satellites."""
        self._drift_m[drone], self._drift_mps[drone] = reckoning.error_m, reckoning.velocity_mps

    @property
    def position_sigma_m(self) -> tuple[float, float]:
        """Horizontal and vertical accuracy that the filters report, 1 sigma in metres."""
        return self._small.position_sigma_m

    @property
    def yaw_sigma_rad(self) -> float:
        """Accuracy of the heading that the filters report, 1 sigma in radians."""
        return self._small.yaw_sigma_rad

    @property
    def position_error_m(self) -> Array:
        """(N, 3) position errors, world axes, metres."""
        return self._small.position_error_m + self._drift_m

    @property
    def velocity_error_mps(self) -> Array:
        """(N, 3) velocity errors, world axes, m/s."""
        return self._small.velocity_error_mps + self._drift_mps

    @property
    def yaw_error_rad(self) -> Array:
        """(N,) heading errors, radians."""
        return self._small.yaw_error_rad + self._turned_rad

    @property
    def tilt_error(self) -> Array:
        """(N, 3) tilt errors, radians: how far the body's up axis leans towards the world's axes."""
        return self._small.tilt_error

    @property
    def height_error_m(self) -> Array:
        """(N,) errors of the measured heights above ground, metres."""
        return self._small.height_error_m

    def step(self) -> None:
        """Simulate the errors for one time step, except those without satellites."""
        self._small.step()
        self._turned_rad *= self._turned_keep
