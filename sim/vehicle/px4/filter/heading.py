"""Reset of the heading in each takeoff, at the height without disturbance by the ground's magnetic field.

PX4 v1.16.1 aligns its heading to the magnetometer again there; position and velocity, and with them the local frame, stay.
"""

from __future__ import annotations

import numpy as np

STEP_RAD = 0.064  # 1 sigma; of 15 recorded ones: 0.056, 0.074, 0.092, 0.111 and 0.163 rad, and ten below 0.05


class TakeoffAlignment:
    """Simulates the reset of one vehicle's heading during takeoff, when the ground no longer disturbs the magnetometer."""

    def __init__(self, height_m: float, rng: np.random.Generator) -> None:
        """``height_m``: height above the ground at which the heading is reset."""
        self._height_m, self._rng = height_m, rng
        self._ground_m = 0.0
        self._is_due = False

    def step(self, landed: bool, up_m: float) -> float | None:
        """Return the angle (rad) by which the heading is reset now, or None. ``up_m``: estimated height, of any origin."""
        if landed:
            self._ground_m, self._is_due = up_m, True
        elif self._is_due and up_m - self._ground_m >= self._height_m:
            self._is_due = False
            return float(self._rng.normal(0.0, STEP_RAD))
        return None
