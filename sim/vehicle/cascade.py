"""PX4's cascade of controllers with the vehicle dynamics, for each axis separately.

Position, velocity with integrator, tilt (vertical axis: thrust) and drag: p position, v velocity, both as estimated where the
controllers use them, I integrator, a acceleration by thrust; p_r, v_r, a_r the setpoint, ``delay_s`` old:

    v_s = v_r + Kp (p_r - p),  limited: the position's part has priority
    a_s = a_r + Kv (v_s - v) + I - Kd dv/dt (through a low pass),  limited
    dI/dt = Ki (v_s - v - (2 / Kv) (a_s - its limited value)),  da/dt = lag_rate (a_s - a)
    dv/dt = a - D v + gust,  dp/dt = v

With PX4's default gains this follows 28 recordings of a real PX4 (SITL with its own simulator) to 0.18 m RMS, and others, with
gains and drag that were not used for fitting, to 0.10-0.16 m, given the recorded estimation error (``tests/contract``). Where no
limit is active a step is exact, by the matrix exponential; the others are integrated in short steps.
"""

from __future__ import annotations

from functools import cache
from math import ceil, exp, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, expm

from radron.sim.geometry import Array

LOW_PASS_PS = 2.0 * pi * 5.0  # cutoff of the velocity derivative's filter, PX4's MPC_VELD_LP
SUBSTEP_S = 0.005  # step while a limit is active; PX4's own controllers step at 0.004-0.01 s
POSITION, VELOCITY, THRUST, INTEGRATOR, FILTERED = range(5)  # indices of a state; the last is the low-pass filtered velocity
_STATES, _SETPOINTS = 5, 3  # position, velocity, acceleration
_OTHERS = 3  # errors of the estimated position and velocity; gust
_OUTPUTS = 4  # speed setpoint and thrust setpoint, when the new setpoint takes effect and at the end of the step


class Axis(NamedTuple):
    """Controller gains of one axis of a vehicle in 1/s; of the integrator in 1/s2; the derivative's is dimensionless."""

    position_gain: float
    velocity_gain: float
    integrator_gain: float
    derivative_gain: float
    lag_rate: float
    drag: float

    @property
    def stable(self) -> bool:
        """Whether the closed loop of controllers and vehicle is stable on this axis."""
        return bool(np.linalg.eigvals(_motion(self)[:_STATES, :_STATES]).real.max() < 0.0)


class Limits(NamedTuple):
    """Limits of the speed setpoints, m/s, and of the horizontal and vertical thrust setpoint, m/s2, of a vehicle."""

    horizontal_mps: float
    up_mps: float
    down_mps: float
    horizontal_mps2: float
    vertical_mps2: float


class Cascade:
    """Simulates PX4's cascade of controllers (position, velocity, thrust) for N vehicles with three axes each.

    ``state``: (N, 3, 5), the five states of each axis.
    """

    def __init__(self, count: int, step_s: float, delay_s: float) -> None:
        """``delay_s``: delay from a setpoint to its effect. The gains are set afterwards, by :meth:`equip`."""
        self._step_s = step_s
        self._late, self._late_s = in_steps(delay_s, step_s)
        self._substeps = ceil(step_s / SUBSTEP_S - 1e-9)
        self._all = np.zeros((count, 3, _STATES + 2 * _SETPOINTS + _OTHERS))  # state and inputs of one step
        self._history: list[Array] = []  # setpoints (N, 3, 3), the newest last
        # Exact transitions without limits, for axes with and without position control, and those in use.
        self._exact = np.zeros((2, count, 3, _STATES + _OUTPUTS, self._all.shape[-1]))
        self._steered: NDArray[np.bool_] = np.ones((count, 3), dtype=bool)
        self._forced: Array = self._exact[1].copy()
        self._harmless = np.zeros((count, 3, _OUTPUTS))
        self._gains = np.zeros((count, 3, len(Axis._fields)))
        self._plant = np.zeros((count, 3, 3, 5))
        self._limits = np.zeros((count, len(Limits._fields)))

    @property
    def state(self) -> Array:
        """(N, 3, 5) states of all axes: position, velocity, thrust, integrator, and filtered velocity; writable."""
        return self._all[:, :, :_STATES]

    def equip(self, vehicle: int, horizontal: Axis, vertical: Axis, limits: Limits) -> None:
        """Set the controller gains and limits of a vehicle."""
        self._limits[vehicle] = limits
        up = min(limits.up_mps, limits.down_mps)
        level = np.array([limits.horizontal_mps] * 2 + [limits.horizontal_mps2] * 2) / 2.0**0.5
        self._harmless[vehicle] = level, level, [up, up, limits.vertical_mps2, limits.vertical_mps2]
        for k, axis in enumerate((horizontal, horizontal, vertical)):
            self._gains[vehicle, k] = axis
            for steered in (0, 1):
                used = axis if steered else axis._replace(position_gain=0.0)
                self._exact[steered, vehicle, k] = _discretise(used, self._late_s, self._step_s - self._late_s)
            self._plant[vehicle, k] = _plant(axis, self._step_s / self._substeps)
        self._forced[vehicle] = np.where(self._steered[vehicle, :, None, None], self._exact[1, vehicle], self._exact[0, vehicle])

    def step(self, setpoint: Array, errors: Array, gust: Array, steered: NDArray[np.bool_]) -> None:
        """Simulate controllers and motion of all vehicles for one time step.

        Args:
            setpoint: (N, 3, 3), position, velocity and acceleration of each axis.
            errors: (2, N, 3) of the position and velocity that the controllers use, estimated minus true.
            gust: (N, 3) acceleration by the wind, m/s2.
            steered: (N, 3), axes with position control; without it, the velocity setpoint is used as given.
        """
        history, every = self._history, self._all
        history.append(setpoint)
        if len(history) > self._late + 2:
            del history[0]
        newest = len(history) - 1 - self._late
        every[..., 5:8], every[..., 8:11] = history[max(0, newest - 1)], history[max(0, newest)]
        every[..., 11], every[..., 12], every[..., 13] = errors[0], errors[1], gust
        if steered is not self._steered and not np.array_equal(steered, self._steered):
            self._steered = steered
            self._forced = np.where(steered[:, :, None, None], self._exact[1], self._exact[0])
        result = np.matvec(self._forced, every)
        harmful = np.abs(result[..., _STATES:]) > self._harmless
        if harmful.any():
            which = np.flatnonzero(harmful.any(axis=(1, 2)))
            result[which, :, :_STATES] = self._limited(which)
        every[..., :_STATES] = result[..., :_STATES]

    def _limited(self, which: NDArray[np.intp]) -> Array:
        """The state of some vehicles (K, 3, 5) after this step, with the limits."""
        every, limits = self._all[which], self._limits[which]
        gain, speed_gain, integrator_gain, derivative_gain = (self._gains[which, :, k] for k in range(4))
        gain = gain * self._steered[which]
        plant = self._plant[which]
        state, old, new = every[..., :5].copy(), every[..., 5:8], every[..., 8:11]
        position_error, velocity_error, gust = every[..., 11], every[..., 12], every[..., 13]
        substep_s = self._step_s / self._substeps
        passed = 1.0 - exp(-LOW_PASS_PS * substep_s)
        for k in range(self._substeps):
            setpoint = old if (k + 0.5) * substep_s < self._late_s else new
            velocity = state[..., VELOCITY] + velocity_error
            behind = setpoint[..., 0] - state[..., POSITION] - position_error
            short = _limit_speed(gain * behind, setpoint[..., 1], limits) - velocity
            beyond = velocity - state[..., FILTERED]
            wanted = setpoint[..., 2] + speed_gain * short + state[..., INTEGRATOR] - derivative_gain * LOW_PASS_PS * beyond
            given = _limit_thrust(wanted, limits)
            state[..., :3] = np.matvec(plant, np.concatenate((state[..., :3], given[..., None], gust[..., None]), axis=-1))
            state[..., INTEGRATOR] += substep_s * integrator_gain * (short - 2.0 / speed_gain * (wanted - given))
            state[..., FILTERED] += passed * beyond
        return state


def in_steps(delay_s: float, step_s: float) -> tuple[int, float]:
    """Split a delay into whole time steps and the remainder (s)."""
    whole = int(round(delay_s / step_s, 9))
    return whole, max(0.0, delay_s - whole * step_s)


def _limit_speed(first: Array, second: Array, limits: Array) -> Array:
    """The sum (K, 3) limited to the highest speeds; horizontally ``second`` is reduced before ``first``, as in PX4."""
    total = first + second
    total[:, 2] = np.clip(total[:, 2], -limits[:, 2], limits[:, 1])
    most, a, b = limits[:, 0], first[:, :2], second[:, :2]
    too_fast = np.hypot(*total[:, :2].T) > most
    if too_fast.any():
        size = np.maximum(np.hypot(*a.T), 1e-9)
        # first + share * second has exactly the highest speed
        along, square, room = (a * b).sum(axis=1), np.maximum((b * b).sum(axis=1), 1e-9), most**2 - size**2
        share = (np.sqrt(np.maximum(along**2 + square * room, 0.0)) - along) / square
        cut = np.where((size >= most)[:, None], a * (most / size)[:, None], a + b * share[:, None])
        total[too_fast, :2] = cut[too_fast]
    return total


def _limit_thrust(wanted: Array, limits: Array) -> Array:
    """(K, 3) limited to the largest tilt and the available thrust."""
    given = np.empty_like(wanted)
    size = np.maximum(np.hypot(wanted[:, 0], wanted[:, 1]), 1e-9)
    given[:, :2] = wanted[:, :2] * np.minimum(1.0, limits[:, 3] / size)[:, None]
    given[:, 2] = np.clip(wanted[:, 2], -limits[:, 4], limits[:, 4])
    return given


def _motion(axis: Axis) -> Array:
    """(7, 11): derivatives of the state, speed setpoint and thrust setpoint by state, setpoint, errors and gust."""
    p, v, a, i, filtered, p_r, v_r, a_r, p_error, v_error, gust = np.eye(_STATES + _SETPOINTS + _OTHERS)
    estimated = v + v_error
    speed = v_r + axis.position_gain * (p_r - p - p_error)
    derivative = LOW_PASS_PS * (estimated - filtered)
    thrust = a_r + axis.velocity_gain * (speed - estimated) + i - axis.derivative_gain * derivative
    return np.array(
        [
            v,
            a - axis.drag * v + gust,
            axis.lag_rate * (thrust - a),
            axis.integrator_gain * (speed - estimated),
            derivative,
            speed,
            thrust,
        ]
    )


@cache
def _discretise(axis: Axis, first_s: float, second_s: float) -> Array:
    """(9, 14): state after ``first_s`` with the old setpoint and ``second_s`` with the new one, and the outputs."""
    motion = _motion(axis)
    inputs = _SETPOINTS + _OTHERS
    continuous = np.vstack((motion[:_STATES], np.zeros((inputs, _STATES + inputs))))
    first, second = expm(continuous * first_s), expm(continuous * second_s)
    # Columns of a whole step: state, old setpoint, new setpoint, others.
    old, new = _chosen(5), _chosen(8)
    middle = np.vstack((first[:_STATES] @ old, new[_STATES:]))
    end = np.vstack((second[:_STATES] @ middle, new[_STATES:]))
    speed_and_thrust = motion[_STATES:]
    outputs = np.stack((speed_and_thrust @ middle, speed_and_thrust @ end), axis=1).reshape(_OUTPUTS, -1)
    return np.vstack((end[:_STATES], outputs))


def _chosen(column: int) -> Array:
    """(11, 14) selection of the state, the setpoint that begins at this column, and the other inputs."""
    chosen = block_diag(np.eye(_STATES), np.zeros((_SETPOINTS, 2 * _SETPOINTS)), np.eye(_OTHERS))
    chosen[_STATES : _STATES + _SETPOINTS, column : column + _SETPOINTS] = np.eye(_SETPOINTS)
    return np.asarray(chosen)


@cache
def _plant(axis: Axis, step_s: float) -> Array:
    """(3, 5): position, velocity and thrust after a step with this thrust setpoint and gust."""
    continuous = np.zeros((5, 5))
    continuous[0, 1] = continuous[1, 2] = continuous[1, 4] = 1.0
    continuous[1, 1] = -axis.drag
    continuous[2, 2], continuous[2, 3] = -axis.lag_rate, axis.lag_rate
    return np.asarray(expm(continuous * step_s))[:3]
