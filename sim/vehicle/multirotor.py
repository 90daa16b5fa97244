"""Horizontal, vertical and heading response of PX4-flown multirotors to setpoints.

A linear model per axis, fitted to what a real PX4 did: on a circle of 12 m at 3 m/s, with position + velocity setpoints at
20 Hz, the position lags by 0.35-0.41 s and the radius is 0.7-1.1 m too large; feeding acceleration forward changes nothing. The
response is two delay poles on the setpoint, a position loop P, a velocity loop P and an attitude lag, all of one time step by the
matrix exponential; tilt limits the acceleration.
"""

from __future__ import annotations

from math import atan2, cos, hypot, sin
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray
from scipy.linalg import expm

from agent.errors import ConfigError

Gain = Annotated[float, Meta(gt=0.0, le=100.0)]
Lag = Annotated[float, Meta(ge=0.01, le=10.0)]
GRAVITY_MPS2 = 9.80665
Array = NDArray[np.float64]


class MultirotorTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Parameters of the vehicles as they really are; the agent knows only a lag (its ``vehicle_lag_s``)."""

    position_gain_ps: Gain = 0.95
    velocity_gain_ps: Gain = 1.0
    attitude_lag_s: Lag = 0.15
    setpoint_lag_s: Lag = 0.32  # two poles together
    maximum_acceleration_mps2: Annotated[float, Meta(gt=0.0, le=100.0)] = 5.0  # tilt limit of 27 degrees
    maximum_yaw_rate_rps: Annotated[float, Meta(gt=0.0, le=100.0)] = 1.5
    yaw_lag_s: Lag = 0.3
    gust_mps2: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.1  # 1-sigma acceleration by wind
    gust_correlation_s: Annotated[float, Meta(gt=0.0, le=1e6)] = 2.0

    def check(self, where: str) -> None:
        """Raise ConfigError where the vehicle would be unstable (Routh's criterion of its three poles)."""
        if self.position_gain_ps * self.attitude_lag_s >= 1.0:
            raise ConfigError(
                f"{where}: vehicle: position_gain_ps = {self.position_gain_ps:g} times attitude_lag_s = {self.attitude_lag_s:g} "
                "must be below 1, or the vehicle oscillates ever more"
            )


class Multirotors:
    """N vehicles, true motion in the world frame (ENU).

    position_m, velocity_mps, acceleration_mps2: (N, 3) views of the state; yaw_rad: (N,).
    """

    def __init__(
        self, truth: MultirotorTruth, position_m: Array, yaw_rad: Array, step_s: float, rng: np.random.Generator
    ) -> None:
        self._truth = truth
        self._step_s = step_s
        self._rng = rng
        count = len(position_m)
        # rows: position, velocity, acceleration, two filter stages of the position and of the velocity setpoint
        # and last the inputs: position and velocity setpoint
        self._state = np.zeros((9, count, 3))
        self._state[[0, 3, 4]] = position_m
        self._propagate = _discretise(truth, step_s)
        self._gust = np.zeros((count, 3))
        self._gust_keep = float(np.exp(-step_s / truth.gust_correlation_s))
        self._gust_kick = truth.gust_mps2 * (1.0 - self._gust_keep**2) ** 0.5
        self.yaw_rad = np.array(yaw_rad, dtype=np.float64)

    @property
    def position_m(self) -> Array:
        """(N, 3), world, metres."""
        position: Array = self._state[0]
        return position

    @property
    def velocity_mps(self) -> Array:
        """(N, 3), world."""
        velocity: Array = self._state[1]
        return velocity

    @property
    def acceleration_mps2(self) -> Array:
        """(N, 3), world, without gravity."""
        acceleration: Array = self._state[2]
        return acceleration

    def step(
        self,
        position_sp: Array,
        velocity_sp: Array,
        yaw_sp: Array,
        grounded: NDArray[np.bool_],
        unsteered: NDArray[np.bool_] | None = None,
    ) -> None:
        """Advance one time step towards setpoints (N, 3), (N, 3), (N,); grounded vehicles stay where they are.

        unsteered: (N, 3), axes along which there is no position to keep, only a velocity.
        """
        count = position_sp.shape[0]
        if unsteered is not None:
            position_sp = np.where(unsteered, self._state[0], position_sp)
            self._state[3:5] = np.where(unsteered, self._state[0], self._state[3:5])
        truth = self._truth
        some_rest = grounded.any()
        resting = self._state[0, grounded] if some_rest else None
        self._state[7], self._state[8] = position_sp, velocity_sp
        self._state[:7] = (self._propagate @ self._state.reshape(9, -1)).reshape(7, count, 3)
        self._gust *= self._gust_keep
        self._gust += self._gust_kick * self._rng.standard_normal((count, 3))
        self._state[1] += self._gust * self._step_s
        self._limit_acceleration()
        if some_rest:
            self._state[:7, grounded] = 0.0
            for row in (0, 3, 4):
                self._state[row, grounded] = resting
        error = np.remainder(yaw_sp - self.yaw_rad + np.pi, 2.0 * np.pi) - np.pi
        most = truth.maximum_yaw_rate_rps
        rate = np.maximum(-most, np.minimum(error / truth.yaw_lag_s, most))
        self.yaw_rad += rate * self._step_s * ~grounded

    def rest_on(self, ground_m: Array) -> None:
        """Nothing sinks below the ground (N,), heights in the world."""
        below = self._state[0, :, 2] < ground_m
        if below.any():
            self._state[0, below, 2] = ground_m[below]
            self._state[1:3, below, 2] = np.maximum(self._state[1:3, below, 2], 0.0)

    def _limit_acceleration(self) -> None:
        acceleration = self._state[2]
        size = np.hypot(acceleration[:, 0], acceleration[:, 1])
        limit = self._truth.maximum_acceleration_mps2
        if size.max() > limit:
            acceleration[:, :2] *= np.minimum(1.0, limit / np.maximum(size, 1e-9))[:, None]

    def quaternion(self, drone: int) -> tuple[float, float, float, float]:
        """World-from-body attitude (w, x, y, z): heading, and the tilt that the acceleration needs."""
        ax, ay, az = self._state[2, drone].tolist()
        return attitude(float(self.yaw_rad[drone]), ax, ay, az)


def attitude(yaw: float, ax: float, ay: float, az: float) -> tuple[float, float, float, float]:
    """Quaternion of a multirotor with this heading whose thrust gives this acceleration (ENU, m/s2)."""
    forward = ax * cos(yaw) + ay * sin(yaw)
    left = -ax * sin(yaw) + ay * cos(yaw)
    pitch = atan2(forward, GRAVITY_MPS2 + az)  # nose down is positive about the left axis
    roll = -atan2(left, hypot(forward, GRAVITY_MPS2 + az))
    cy, sy = cos(0.5 * yaw), sin(0.5 * yaw)
    cp, sp = cos(0.5 * pitch), sin(0.5 * pitch)
    cr, sr = cos(0.5 * roll), sin(0.5 * roll)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def _discretise(truth: MultirotorTruth, step_s: float) -> Array:
    """(7, 9) exact zero-order-hold discretisation; states and inputs as in ``Multirotors``."""
    tau, lag = truth.attitude_lag_s, truth.setpoint_lag_s / 2.0
    kp, kv = truth.position_gain_ps, truth.velocity_gain_ps
    a = np.zeros((9, 9))
    a[0, 1] = a[1, 2] = 1.0
    a[2, [0, 1, 2, 4, 6]] = np.array([-kv * kp, -kv, -1.0, kv * kp, kv]) / tau
    a[3, [3, 7]] = -1.0 / lag, 1.0 / lag
    a[4, [4, 3]] = -1.0 / lag, 1.0 / lag
    a[5, [5, 8]] = -1.0 / lag, 1.0 / lag
    a[6, [6, 5]] = -1.0 / lag, 1.0 / lag
    discrete: Array = expm(a * step_s)
    return discrete[:7]
