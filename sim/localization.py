"""The small errors of the vehicles' localisation: biases, slowly wandering errors of position and attitude, and noise.

How each vehicle localises itself, and so where its local frame lies, is in ``sim.positioning`` and ``sim.movingframes``.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from protocol.units import DroneId
from sim.positioning import LiarTruth, VehicleTruth

Array = NDArray[np.float64]
Metres = Annotated[float, Meta(ge=0.0, le=100.0)]
Degrees = Annotated[float, Meta(ge=0.0, le=45.0)]


class LocalizationTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """1-sigma errors, each slowly varying unless said otherwise. Defaults: a real PX4's EKF against the truth.

    The biases come on top of what wanders; each vehicle has its own, drawn once for the whole flight. All zero: ideal poses.
    ``vehicles``: those whose local frames are not simply where the mission has them, and ``liar``: that one of them is far off.
    """

    horizontal_m: Metres = 0.13  # of the horizontal distance; each axis has 1/sqrt(2) of it
    vertical_m: Metres = 0.2
    height_m: Metres = 0.05  # of the rangefinder's height above ground; half of its variance is white
    yaw_deg: Degrees = 1.0
    tilt_deg: Degrees = 0.5  # of roll and of pitch
    correlation_s: Annotated[float, Meta(gt=0.0, le=1e6)] = 20.0
    velocity_mps: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.05  # of each axis, white
    bias_m: Metres = 0.0  # of each horizontal axis, constant
    bias_yaw_deg: Degrees = 0.0  # constant
    vehicles: dict[DroneId, VehicleTruth] = {}
    liar: LiarTruth | None = None

    @property
    def event_s(self) -> float | None:
        """When something happens to a frame for the first time; None where nothing does."""
        times = [event.at_s for vehicle in self.vehicles.values() for event in vehicle.events]
        if self.liar is not None and self.liar.at_s > 0.0:
            times.append(self.liar.at_s)
        return min(times, default=None)

    @property
    def told_horizontal_m(self) -> float:
        """What an autopilot that knows how good it is tells of its accuracy: 1 sigma of the horizontal distance."""
        return float(np.hypot(self.horizontal_m, 2.0**0.5 * self.bias_m))

    @property
    def told_yaw_deg(self) -> float:
        """The same of its heading."""
        return float(np.hypot(self.yaw_deg, self.bias_yaw_deg))


class Localization:
    """Errors of N vehicles (estimate minus truth): biases and first-order Gauss-Markov, advanced in fixed steps."""

    def __init__(self, truth: LocalizationTruth, count: int, step_s: float, rng: np.random.Generator) -> None:
        horizontal, height = truth.horizontal_m / 2.0**0.5, truth.height_m / 2.0**0.5
        yaw, tilt = np.deg2rad(truth.yaw_deg), np.deg2rad(truth.tilt_deg)
        # As the autopilot's own filter would tell them.
        self.position_sigma_m = (truth.told_horizontal_m, truth.vertical_m)
        self.yaw_sigma_rad = float(np.deg2rad(truth.told_yaw_deg))
        self._sigma = np.array([horizontal, horizontal, truth.vertical_m, yaw, tilt, tilt, height])
        self._white_sigma = np.array([truth.velocity_mps, truth.velocity_mps, truth.velocity_mps, height])
        self._keep = float(np.exp(-step_s / truth.correlation_s))
        self._kick = (1.0 - self._keep**2) ** 0.5 * self._sigma
        self._rng = rng
        self._error = self._sigma * rng.standard_normal((count, 7))
        self._white = self._white_sigma * rng.standard_normal((count, 4))
        # From a stream of their own: the errors that wander are the same with biases and without.
        bias = np.array([truth.bias_m, truth.bias_m, 0.0, np.deg2rad(truth.bias_yaw_deg)])
        self._bias = bias * rng.spawn(1)[0].standard_normal((count, 4))
        self._total: Array = self._error[:, :4] + self._bias

    @property
    def position_bias_m(self) -> Array:
        """(N, 3), world axes: the part of the position error that stays."""
        return self._bias[:, :3]

    @property
    def position_error_m(self) -> Array:
        """(N, 3), world axes."""
        return self._total[:, :3]

    @property
    def velocity_error_mps(self) -> Array:
        """(N, 3), world axes."""
        return self._white[:, :3]

    @property
    def yaw_error_rad(self) -> Array:
        """(N,)."""
        return self._total[:, 3]

    @property
    def tilt_error(self) -> Array:
        """(N, 3): by how much the body's up leans towards the world's axes, radians; nothing along z."""
        lean = np.zeros((len(self._error), 3))
        lean[:, :2] = self._error[:, 4:6]
        return lean

    @property
    def height_error_m(self) -> Array:
        """(N,)."""
        error: Array = self._error[:, 6] + self._white[:, 3]
        return error

    def step(self) -> None:
        """Advance one time step."""
        noise = self._rng.standard_normal((len(self._error), 11))
        self._error *= self._keep
        self._error += self._kick * noise[:, :7]
        self._total = self._error[:, :4] + self._bias
        self._white = self._white_sigma * noise[:, 7:]
