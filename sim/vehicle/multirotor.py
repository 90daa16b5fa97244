"""True motion of multirotors flown by PX4: controllers of each axis, heading, wind, and contact with the ground."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, exp, expm1, hypot, radians, sin, tan
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from radron.agent.errors import ConfigError
from radron.sim.geometry import Array
from radron.sim.vehicle.cascade import FILTERED, POSITION, THRUST, VELOCITY, Axis, Cascade, Limits, in_steps

Gain = Annotated[float, Meta(gt=0.0, le=20.0)]
NoGain = Annotated[float, Meta(ge=0.0, le=20.0)]
Rate = Annotated[float, Meta(gt=0.0, le=100.0)]
GRAVITY_MPS2 = 9.80665
FALLING_S, SPINNING_S = 0.5, 1.0  # time constants with which a vehicle without control reaches its sink rate, and its spin
SPIN_RPS = 6.0


class MultirotorTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """True parameters of a simulated multirotor and its controllers.

    Defaults: PX4's default gains and the values recorded with them (quadrotor of PX4's own simulator, 1 kg, drag 1 N/(m/s)).
    """

    position_gain_ps: Gain = 0.95  # MPC_XY_P
    velocity_gain_ps: Gain = 1.8  # MPC_XY_VEL_P_ACC
    integrator_gain_ps2: NoGain = 0.4  # MPC_XY_VEL_I_ACC
    derivative_gain: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.2  # MPC_XY_VEL_D_ACC
    attitude_rate_ps: Rate = 4.2  # of the tilt's lag; scales with MC_ROLL_P, known to +-0.5
    drag_ps: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.0  # per mass, linear in the speed
    delay_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.03  # from a setpoint to its effect
    climb_position_gain_ps: Gain = 1.0  # MPC_Z_P; the vertical axis, like the horizontal ones above
    climb_velocity_gain_ps: Gain = 4.0
    climb_integrator_gain_ps2: NoGain = 2.0
    climb_derivative_gain: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    thrust_rate_ps: Rate = 18.0
    maximum_tilt_deg: Annotated[float, Meta(gt=0.0, le=80.0)] = 45.0  # MPC_TILTMAX_AIR
    maximum_speed_mps: Annotated[float, Meta(gt=0.0, le=50.0)] = 12.0  # of setpoints, MPC_XY_VEL_MAX
    maximum_climb_mps: Annotated[float, Meta(gt=0.0, le=50.0)] = 3.0
    maximum_descent_mps: Annotated[float, Meta(gt=0.0, le=50.0)] = 1.5
    yaw_gain_ps: Gain = 2.8  # MC_YAW_P
    yaw_acceleration_gain_ps: Gain = 2.4  # of the yaw rate's response; fitted to recorded turns, like the next one
    maximum_yaw_acceleration_rps2: Rate = 4.25
    maximum_yaw_rate_rps: Rate = 3.49  # MC_YAWRATE_MAX
    gust_mps2: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.1  # 1-sigma acceleration by gusts
    gust_correlation_s: Annotated[float, Meta(gt=0.0, le=1e6)] = 2.0

    @property
    def horizontal(self) -> Axis:
        """Controller gains of the axes east and north."""
        return Axis(
            self.position_gain_ps,
            self.velocity_gain_ps,
            self.integrator_gain_ps2,
            self.derivative_gain,
            self.attitude_rate_ps,
            self.drag_ps,
        )

    @property
    def vertical(self) -> Axis:
        """Controller gains of the vertical axis."""
        return Axis(
            self.climb_position_gain_ps,
            self.climb_velocity_gain_ps,
            self.climb_integrator_gain_ps2,
            self.climb_derivative_gain,
            self.thrust_rate_ps,
            self.drag_ps,
        )

    @property
    def limits(self) -> Limits:
        """Limits of the setpoints. Rotors that hover at half of their thrust can double it, or reduce it to zero."""
        tilted_mps2 = GRAVITY_MPS2 * tan(radians(self.maximum_tilt_deg))
        return Limits(self.maximum_speed_mps, self.maximum_climb_mps, self.maximum_descent_mps, tilted_mps2, GRAVITY_MPS2)

    def check(self, where: str) -> None:
        """Raise ConfigError if the controlled vehicle would be unstable (a pole of one of its axes with a positive real part)."""
        for name, axis in (("horizontal", self.horizontal), ("vertical", self.vertical)):
            if not axis.stable:
                raise ConfigError(
                    f"{where}: vehicle: with these gains the {name} motion is unstable; "
                    "take smaller ones, or a vehicle that tilts faster"
                )


class Setpoints(NamedTuple):
    """Setpoints of N vehicles in the world frame (ENU).

    Positions of axes without position control are ignored; a heading of NaN is free.
    """

    position_m: Array  # (N, 3)
    velocity_mps: Array  # (N, 3)
    acceleration_mps2: Array  # (N, 3)
    yaw_rad: Array  # (N,)
    yaw_rate_rps: Array  # (N,)


class Multirotors:
    """Simulates the true motion of N multirotors in the world frame (ENU). yaw_rad: (N,) headings."""

    def __init__(
        self,
        truth: MultirotorTruth | Sequence[MultirotorTruth],
        position_m: Array,
        yaw_rad: Array,
        step_s: float,
        rng: np.random.Generator,
    ) -> None:
        """``truth``: parameters of all vehicles together, or of each; delay and wind are the first vehicle's."""
        count = len(position_m)
        truths = [truth] * count if isinstance(truth, MultirotorTruth) else list(truth)
        self._truth, self._truths = truths[0], truths
        self._step_s = step_s
        self._rng = rng
        self._cascade = Cascade(count, step_s, self._truth.delay_s)
        self._state = self._cascade.state
        self._state[..., POSITION] = position_m
        self._late, self._late_s = in_steps(self._truth.delay_s, step_s)
        self._headings: list[tuple[Array, Array]] = []  # setpoints of heading and its rate, the newest last
        # gains of heading and its rate, highest rate, largest change of the rate in a step
        self._yaw_gains = np.zeros((4, count))
        for drone, one in enumerate(truths):
            self.equip(drone, one)
        self._gust = np.zeros((count, 3))
        self._gust_keep = float(np.exp(-step_s / self._truth.gust_correlation_s))
        self._gust_kick = self._truth.gust_mps2 * (1.0 - self._gust_keep**2) ** 0.5
        self.push_mps2 = np.zeros((count, 3))  # acceleration by anything else, world
        self._falling: dict[int, float] = {}  # vehicles without thrust: speed of their fall
        self._everywhere = np.ones((count, 3), dtype=bool)
        self._yaw_rate = np.zeros(count)
        self.yaw_rad = np.array(yaw_rad, dtype=np.float64)

    @property
    def position_m(self) -> Array:
        """(N, 3) true positions in the world, metres."""
        position: Array = self._state[..., POSITION]
        return position

    @property
    def velocity_mps(self) -> Array:
        """(N, 3) true velocities in the world, m/s."""
        velocity: Array = self._state[..., VELOCITY]
        return velocity

    @property
    def thrust_mps2(self) -> Array:
        """(N, 3) accelerations by the rotors in the world, in excess of gravity, m/s2.

        They determine the attitudes. Drag is not included.
        """
        thrust: Array = self._state[..., THRUST]
        return thrust

    def vehicle(self, drone: int) -> MultirotorTruth:
        """Return the parameters of one vehicle, as given at first."""
        return self._truths[drone]

    def equip(self, drone: int, truth: MultirotorTruth) -> None:
        """Change a vehicle's gains, limits and drag."""
        self._cascade.equip(drone, truth.horizontal, truth.vertical, truth.limits)
        self._yaw_gains[:, drone] = (
            truth.yaw_gain_ps,
            -np.expm1(-truth.yaw_acceleration_gain_ps * self._step_s),
            truth.maximum_yaw_rate_rps,
            truth.maximum_yaw_acceleration_rps2 * self._step_s,
        )

    def step(
        self,
        setpoints: Setpoints,
        grounded: NDArray[np.bool_],
        position_error_m: Array,
        velocity_error_mps: Array,
        unsteered: NDArray[np.bool_] | None = None,
    ) -> None:
        """Simulate the motion for one time step towards the setpoints.

        Grounded vehicles stay where they are, and their integrators are reset. position_error_m, velocity_error_mps: (N, 3),
        world, estimated minus true: a vehicle controls its estimate. Headings are the true ones. unsteered: (N, 3), axes with
        velocity control only.
        """
        self._gust *= self._gust_keep
        self._gust += self._gust_kick * self._rng.standard_normal(self._gust.shape)
        before = {drone: self._state[drone].copy() for drone in self._falling}
        some_rest = grounded.any()
        resting = self._state[grounded, :, POSITION] if some_rest else None
        self._cascade.step(
            np.stack(setpoints[:3], axis=-1),
            np.stack((position_error_m, velocity_error_mps)),
            self._gust + self.push_mps2,
            self._everywhere if unsteered is None else ~unsteered,
        )
        self._turn(setpoints.yaw_rad, setpoints.yaw_rate_rps, ~grounded)
        for drone, state in before.items():
            self._fall(drone, state, bool(grounded[drone]))
        if some_rest:
            self._state[grounded, :, VELOCITY:] = 0.0
            self._state[grounded, :, POSITION] = resting

    def fail(self, drone: int, descent_mps: float) -> None:
        """Let a vehicle's motors fail for good: it slows down by drag, sinks at this speed and spins."""
        self._falling[drone] = descent_mps

    @property
    def any_falls(self) -> bool:
        """Whether any vehicle has lost its thrust."""
        return bool(self._falling)

    def _fall(self, drone: int, before: Array, rests: bool) -> None:
        """Motion of a vehicle without control over one step, from its state (3, 5) before."""
        step_s = self._step_s
        state = self._state[drone]
        state[:] = before
        state[:2, VELOCITY] *= exp(-self._truths[drone].drag_ps * step_s)
        state[2, VELOCITY] += -expm1(-step_s / FALLING_S) * (-self._falling[drone] - before[2, VELOCITY])
        state[:, POSITION] += 0.5 * step_s * (before[:, VELOCITY] + state[:, VELOCITY])
        state[:, THRUST:] = 0.0
        state[:, FILTERED] = state[:, VELOCITY]
        if not rests:
            self._yaw_rate[drone] += -expm1(-step_s / SPINNING_S) * (SPIN_RPS - self._yaw_rate[drone])
            self.yaw_rad[drone] += step_s * self._yaw_rate[drone]

    def _turn(self, yaw_sp: Array, yaw_rate_sp: Array, free: NDArray[np.bool_]) -> None:
        """Headings turn the shorter way, after the same delay."""
        headings = self._headings
        headings.append((yaw_sp, yaw_rate_sp))
        if len(headings) > self._late + 2:
            del headings[0]
        newest = len(headings) - 1 - self._late
        (old_yaw, old_rate), (new_yaw, new_rate) = headings[max(0, newest - 1)], headings[max(0, newest)]
        before = self._yaw_rate
        halfway = self.yaw_rad + 0.5 * self._step_s * before
        old = self._late_s / self._step_s
        new = 1.0 - old
        error = old * _shorter_way(old_yaw - halfway) + new * _shorter_way(new_yaw - halfway)
        fed_forward = old * old_rate + new * new_rate
        gain, share, most, most_change = self._yaw_gains
        wanted = np.maximum(-most, np.minimum(gain * error + fed_forward, most))
        change = np.maximum(-most_change, np.minimum(share * (wanted - before), most_change))
        self._yaw_rate = (before + change) * free
        self.yaw_rad += 0.5 * (before + self._yaw_rate) * self._step_s * free
        if fed_forward.any():
            self._rotate_tilt(fed_forward * self._step_s)

    def _rotate_tilt(self, angle: Array) -> None:
        """PX4 feeds the yaw rate forward about the vertical, not about the rotors' axis: the tilt rotates with it, and is
        corrected only as fast as the tilt's lag allows. Recorded while circling at 3 m/s and turning at 1.5 rad/s.
        """
        c, s = np.cos(angle), np.sin(angle)
        x, y = self._state[:, 0, THRUST].copy(), self._state[:, 1, THRUST].copy()
        self._state[:, 0, THRUST], self._state[:, 1, THRUST] = c * x - s * y, s * x + c * y

    def rest_on(self, ground_m: Array) -> None:
        """Keep all vehicles above the ground. ``ground_m``: (N,) heights of the ground in the world."""
        up = self._state[:, 2]
        below = up[:, POSITION] < ground_m
        if below.any():
            up[below, POSITION] = ground_m[below]
            for row in (VELOCITY, THRUST, FILTERED):
                up[below, row] = np.maximum(up[below, row], 0.0)

    def quaternion(self, drone: int) -> tuple[float, float, float, float]:
        """Return a vehicle's attitude, which rotates from body to world (w, x, y, z): its heading, and the tilt of its thrust."""
        ax, ay, az = self.thrust_mps2[drone].tolist()
        return attitude(float(self.yaw_rad[drone]), ax, ay, az)


def _shorter_way(angle: Array) -> Array:
    """Reduce angles (N,) to half a turn; 0 instead of NaN, for a free heading."""
    turned: Array = np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi
    return np.where(np.isnan(turned), 0.0, turned)


def attitude(yaw: float, ax: float, ay: float, az: float) -> tuple[float, float, float, float]:
    """Return the attitude (w, x, y, z) of a multirotor with this heading whose thrust gives an acceleration.

    ``ax``, ``ay``, ``az``: acceleration in excess of gravity (ENU, m/s2).
    """
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
