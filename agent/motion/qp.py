"""Optimisation of a plan within limits and half-planes: a quadratic programme, solved by OSQP.

The unknowns are the deviations w of the jerks from the unconstrained optimum, so the cost is w' H w / 2. Every bound is a limit
minus the value of the optimum. Half-planes are soft: each step has a slack, by which its half-planes may be violated, at a cost
far above that of the tracking. So a drone beyond a half-plane is led back, and the problem is never infeasible.

The solver must be deterministic: no time limit, a step size adapted at fixed iterations, and a limited number of iterations.
"""

from __future__ import annotations

import ctypes
import signal
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Any

import numpy as np
import osqp
from numpy.typing import NDArray
from scipy import sparse

from radron.agent.geometry import Array
from radron.agent.motion.prediction import Prediction

# Normals of an octagon's sides; each counts with both signs. Rounded, so that zeros are exact and need no entry in the matrix.
_OCTAGON: Array = np.array([[cos(k * pi / 4.0), sin(k * pi / 4.0)] for k in range(4)]).round(15)
OCTAGON_INRADIUS = cos(pi / 8.0)  # of an octagon whose corners lie on the unit circle
_SLACK_WEIGHT = 100.0  # cost of a step's slack, 1/m2; a position error costs 1/m2
_SETTINGS = {
    "verbose": False,
    "eps_abs": 1e-2,  # m, m/s, m/s2: accurate enough for a plan
    "eps_rel": 1e-3,
    "max_iter": 300,
    "check_termination": 5,
    "adaptive_rho": 1,  # at every "adaptive_rho_interval" iterations; 2 would depend on the clock
    "adaptive_rho_interval": 25,
    "rho": 0.03,
    "warm_starting": True,
    "polishing": False,
}
_USABLE = ("solved", "solved inaccurate", "maximum iterations reached")
_INTERRUPTED = "interrupted"
# Not part of OSQP's interface, but its own check in each iteration; covers a SIGINT after the last iteration, too.
_has_caught_sigint = ctypes.CDLL(osqp.ext_builtin.__file__).osqp_is_interrupted


@dataclass(frozen=True, slots=True)
class HalfPlanes:
    """Limits on the planned positions p: up to R half-planes n . p >= b for each of H steps.

    normals: (R, H, axes), n. offsets: (R, H), b; -inf: no limit. yielding: (R, H), metres by which a limit is relaxed per metre
    of its step's slack; more than 1 for limits of lower priority.
    """

    normals: Array
    offsets: Array
    yielding: Array


class LimitedProblem:
    """Optimisation of a plan in one or two axes, with limits on speed, acceleration and jerk, and half-planes on the position.

    With two axes, the limits on speed and acceleration are octagons inscribed in their circles; with one axis, intervals.
    """

    def __init__(self, prediction: Prediction, step_s: float, axes: int, limits: tuple[float, float, float], rows: int) -> None:
        """Set up the problem. ``limits``: speed m/s, acceleration m/s2, jerk m/s3. ``rows``: half-planes per step."""
        self._prediction = prediction
        self._axes, self._rows = axes, rows
        self._horizon = horizon = len(prediction.hessian)
        self._times: Array = step_s * np.arange(1, horizon + 1, dtype=np.float64)
        self._directions = _OCTAGON if axes == 2 else np.ones((1, 1))
        inradius = OCTAGON_INRADIUS if axes == 2 else 1.0
        self._speed, self._acceleration, self._jerk = limits[0] * inradius, limits[1] * inradius, limits[2]
        tracking = sparse.block_diag([prediction.hessian] * axes)
        slack = _SLACK_WEIGHT * sparse.eye(horizon)
        fixed = sparse.vstack(
            (
                np.kron(self._directions, prediction.velocity),
                np.kron(self._directions, prediction.acceleration),
                sparse.eye(axes * horizon),
            )
        )
        fixed = sparse.hstack((fixed, sparse.csc_matrix((fixed.shape[0], horizon))))
        matrix, self._variable = self._layout(fixed)
        self._lower: Array = np.full(matrix.shape[0], -np.inf)
        self._upper: Array = np.full(matrix.shape[0], np.inf)
        self._first: Array = np.zeros(matrix.shape[1])
        self._solver = osqp.OSQP()
        self._solver.setup(
            sparse.triu(sparse.block_diag((tracking, slack)), format="csc"),
            np.zeros(matrix.shape[1]),
            matrix,
            self._lower,
            self._upper,
            **_SETTINGS,
        )

    def _layout(self, fixed: sparse.spmatrix) -> tuple[sparse.csc_matrix, NDArray[np.int32]]:
        """Return the constraint matrix with placeholders for the half-planes, and the indices of the placeholders in its data.

        Their order: for each half-plane of a step and each axis, the lower triangle of (H, H); then, for each half-plane of a
        step, the slack of each step.
        """
        horizon, axes, rows = self._horizon, self._axes, self._rows
        self._steps, starts = np.tril_indices(horizon)
        self._triangle = self._prediction.position[self._steps, starts]
        row, column = [], []
        for plane in range(rows):
            for axis in range(axes):
                row.append(plane * horizon + self._steps)
                column.append(axis * horizon + starts)
        for plane in range(rows):
            row.append(plane * horizon + np.arange(horizon))
            column.append(axes * horizon + np.arange(horizon))
        rows_index, columns_index = np.concatenate(row), np.concatenate(column)
        planes = sparse.coo_matrix(
            (np.ones(len(rows_index)), (rows_index, columns_index)), shape=(rows * horizon, (axes + 1) * horizon)
        )
        matrix = sparse.vstack((fixed, planes), format="csc")
        matrix.sort_indices()
        # Position of the k-th placeholder: its column and row in the final matrix, which are in this order.
        height, width = matrix.shape
        entries = np.repeat(np.arange(width), np.diff(matrix.indptr)) * height + matrix.indices
        where = np.searchsorted(entries, columns_index * height + fixed.shape[0] + rows_index)
        return matrix, where.astype(np.int32)

    def solve(self, start: Array, optimum: Array, planes: HalfPlanes | None, guess: Array) -> Array | None:
        """Return the jerks (H, axes) for H steps, within the limits and as near as possible to the unconstrained optimum; None
        without a usable solution.

        A speed or acceleration beyond its limit at the start has to return to the limit gradually, not at once.

        Args:
            start: (3, axes), position, velocity, acceleration at the start.
            optimum: (4, H, axes), jerks, positions, velocities, accelerations of the unconstrained optimum.
            planes: half-planes on the position; None: none.
            guess: (H, axes), initial jerks for the solver.
        """
        jerk, position, velocity, acceleration = optimum
        horizon, axes = self._horizon, self._axes
        lower, upper = self._lower, self._upper
        size = len(self._directions) * horizon
        rate, force = start[1:] @ self._directions.T
        # Speed in each direction once the acceleration at the start is down to zero.
        speed = float(np.abs(rate + force * np.abs(force) / (2.0 * self._jerk)).max())
        pull = float(np.abs(force).max())
        braked = np.maximum(self._speed, speed - 0.5 * self._acceleration * self._times)
        eased = np.maximum(self._acceleration, pull - 0.5 * self._jerk * self._times)
        along = (velocity @ self._directions.T).T
        upper[:size], lower[:size] = (braked - along).ravel(), (-braked - along).ravel()
        along = (acceleration @ self._directions.T).T
        upper[size : 2 * size], lower[size : 2 * size] = (eased - along).ravel(), (-eased - along).ravel()
        flat = jerk.T.ravel()
        tail = 2 * size + axes * horizon
        upper[2 * size : tail], lower[2 * size : tail] = self._jerk - flat, -self._jerk - flat
        if planes is None:
            lower[tail:] = -np.inf
            self._solver.update(l=lower, u=upper)
        else:
            values = planes.normals.transpose(0, 2, 1)[:, :, self._steps] * self._triangle
            lower[tail:] = (planes.offsets - np.einsum("rka,ka->rk", planes.normals, position)).ravel()
            self._solver.update(
                l=lower, u=upper, Ax=np.concatenate((values.ravel(), planes.yielding.ravel())), Ax_idx=self._variable
            )
        self._first[: axes * horizon] = (guess - jerk).T.ravel()
        self._solver.warm_start(x=self._first)
        result = _solved(self._solver)
        if result.info.status not in _USABLE:
            return None
        found: Array = jerk + result.x[: axes * horizon].reshape(axes, horizon).T
        return np.clip(found, -self._jerk, self._jerk)


def _solved(solver: osqp.OSQP) -> Any:
    """Solve the problem, and return OSQP's result, without the loss of a SIGINT in the meantime.

    OSQP catches SIGINT while it solves, and merely stops. So the signal is blocked until the solution is there. If it arrives
    through another thread of the process, it is raised again. That ends a simulation; an agent ignores the signal, and the
    problem is solved once more.
    """
    while True:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            result = solver.solve(raise_error=False)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if _has_caught_sigint():
            signal.raise_signal(signal.SIGINT)
        if result.info.status != _INTERRUPTED:
            return result
