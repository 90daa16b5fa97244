"""Small errors of the vehicles' localisation: filter errors, slowly varying errors, biases, and noise.

The kind of localisation, and so the position of each local frame, is in ``radron.sim.world.localizers`` and
``radron.sim.world.movingframes``.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from radron.protocol.units import DroneId
from radron.sim.geometry import Array
from radron.sim.world.localizers import LiarTruth, VehicleTruth

Metres = Annotated[float, Meta(ge=0.0, le=100.0)]
Degrees = Annotated[float, Meta(ge=0.0, le=45.0)]
_LEAD_S = 0.85  # by which the velocity's error leads the position's


class LocalizationTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """True errors of the vehicles' localisation, 1 sigma.

    Defaults: errors of a real PX4's EKF against the truth, in 70 recordings of half a minute each. Its position and velocity
    errors are correlated: along each axis they are p and 1.3 (p + 0.85 s dp/dt) in size, with p smooth and a correlation time of
    some seconds. (dp/dt itself is only a third of the velocity's error.) The other errors vary slowly at random; the biases are
    added, drawn once per vehicle and flight. All zero: ideal poses. ``vehicles``: vehicles whose local frames differ from the
    mission's launch layout; ``liar``: a vehicle with a spoofed pose.
    """

    horizontal_m: Metres = 0.25  # of the horizontal distance; each axis has 1/sqrt(2) of it
    vertical_m: Metres = 0.2
    velocity_mps: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.25  # of each horizontal axis
    climb_mps: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.16
    filter_s: Annotated[float, Meta(gt=0.0, le=1e3)] = 2.0  # of these four: correlation (1 + t / filter_s) exp(-t / filter_s)
    wander_m: Metres = 0.0  # of the horizontal distance; slow, like satellite errors
    drift_m: Metres = 0.4  # of the height by barometer
    drift_s: Annotated[float, Meta(gt=0.0, le=1e6)] = 60.0
    height_m: Metres = 0.05  # of the rangefinder's height above ground; half of its variance is white
    yaw_deg: Degrees = 1.0
    tilt_deg: Degrees = 0.5  # of roll and of pitch
    correlation_s: Annotated[float, Meta(gt=0.0, le=1e6)] = 20.0  # of wander, height above ground, yaw and tilt
    bias_m: Metres = 0.0  # of each horizontal axis, constant
    bias_yaw_deg: Degrees = 0.0  # constant
    vehicles: dict[DroneId, VehicleTruth] = {}
    liar: LiarTruth | None = None

    @property
    def event_s(self) -> float | None:
        """Time of the first event (such as a jump) that happens to a vehicle's localisation; None without events."""
        times = [event.at_s for vehicle in self.vehicles.values() for event in vehicle.events]
        if self.liar is not None and self.liar.at_s > 0.0:
            times.append(self.liar.at_s)
        return min(times, default=None)

    @property
    def reported_horizontal_m(self) -> float:
        """Accuracy that a calibrated autopilot reports: 1 sigma of the horizontal distance, metres."""
        return math.hypot(self.horizontal_m, self.wander_m, 2.0**0.5 * self.bias_m)

    @property
    def reported_vertical_m(self) -> float:
        """Accuracy that a calibrated autopilot reports for its height: 1 sigma, metres."""
        return math.hypot(self.vertical_m, self.drift_m)

    @property
    def reported_yaw_deg(self) -> float:
        """Accuracy that a calibrated autopilot reports for its heading: 1 sigma, degrees."""
        return math.hypot(self.yaw_deg, self.bias_yaw_deg)


class Localization:
    """Simulates the localisation errors of N vehicles (estimate minus truth) in fixed time steps.

    The filter's errors are critically damped second-order Gauss-Markov processes, the slow errors are of first order.
    """

    def __init__(self, truth: LocalizationTruth, count: int, step_s: float, rng: np.random.Generator) -> None:
        horizontal, wander, height = (size / 2.0**0.5 for size in (truth.horizontal_m, truth.wander_m, truth.height_m))
        yaw, tilt = np.deg2rad(truth.yaw_deg), np.deg2rad(truth.tilt_deg)
        # As the autopilot's own filter would report them.
        self.position_sigma_m = (truth.reported_horizontal_m, truth.reported_vertical_m)
        self.yaw_sigma_rad = float(np.deg2rad(truth.reported_yaw_deg))
        # Filter errors: a process of size 1 and its derivative times filter_s, also of size 1; the two are independent at each
        # time.
        self._advance, self._stir = _second_order(step_s / truth.filter_s)
        lead = _LEAD_S / truth.filter_s
        velocity = np.array([truth.velocity_mps, truth.velocity_mps, truth.climb_mps]) / math.hypot(1.0, lead)
        self._position_sigma = np.array([horizontal, horizontal, truth.vertical_m])
        self._velocity_sigma = np.array([velocity, lead * velocity])
        self._slow_sigma = np.array([wander, wander, truth.drift_m, yaw, tilt, tilt, height])
        memory_s = np.array([truth.correlation_s] * 2 + [truth.drift_s] + [truth.correlation_s] * 4)
        self._keep = np.exp(-step_s / memory_s)
        self._kick = np.sqrt(1.0 - self._keep**2) * self._slow_sigma
        self._white_height_m = height
        self._rng = rng
        noise = rng.standard_normal((count, 14))
        self._filter: Array = noise[:, :6].reshape(count, 2, 3)
        self._slow: Array = self._slow_sigma * noise[:, 6:13]
        self._white: Array = self._white_height_m * noise[:, 13]
        # From a separate stream: the varying errors are the same with and without biases.
        bias = np.array([truth.bias_m, truth.bias_m, 0.0, np.deg2rad(truth.bias_yaw_deg)])
        self._bias = bias * rng.spawn(1)[0].standard_normal((count, 4))
        self._sum_up()

    @property
    def position_bias_m(self) -> Array:
        """(N, 3) constant part of the position errors, world axes, metres."""
        return self._bias[:, :3]

    @property
    def position_error_m(self) -> Array:
        """(N, 3) position errors, world axes, metres."""
        return self._total[:, :3]

    @property
    def velocity_error_mps(self) -> Array:
        """(N, 3) velocity errors, world axes, m/s."""
        return self._velocity

    @property
    def yaw_error_rad(self) -> Array:
        """(N,) heading errors, radians."""
        return self._total[:, 3]

    @property
    def tilt_error(self) -> Array:
        """(N, 3) tilt errors, radians: how far the body's up axis leans towards the world's axes; zero along z."""
        lean = np.zeros((len(self._slow), 3))
        lean[:, :2] = self._slow[:, 4:6]
        return lean

    @property
    def height_error_m(self) -> Array:
        """(N,) errors of the measured heights above ground, metres."""
        error: Array = self._slow[:, 6] + self._white
        return error

    def step(self) -> None:
        """Simulate the errors for one time step."""
        count = len(self._slow)
        noise = self._rng.standard_normal((count, 14))
        self._filter = self._advance @ self._filter + self._stir @ noise[:, :6].reshape(count, 2, 3)
        self._slow = self._keep * self._slow + self._kick * noise[:, 6:13]
        self._white = self._white_height_m * noise[:, 13]
        self._sum_up()

    def _sum_up(self) -> None:
        self._total: Array = self._slow[:, :4] + self._bias
        self._total[:, :3] += self._position_sigma * self._filter[:, 0]
        self._velocity: Array = (self._velocity_sigma * self._filter).sum(axis=1)


def _second_order(share: float) -> tuple[Array, Array]:
    """Transition and noise matrices (2, 2) of such a process and its derivative over a step of this share of the time constant,
    for unit stationary size.
    """
    advance = math.exp(-share) * np.array([[1.0 + share, share], [-share, 1.0 - share]])
    size, vectors = np.linalg.eigh(np.eye(2) - advance @ advance.T)
    return advance, vectors * np.sqrt(np.maximum(size, 0.0))
