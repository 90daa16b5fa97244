"""Motion model of the tracker: a triple integrator for each axis with piecewise constant jerk, in matrix form over all steps.

State x = (p, v, a), input j, step h:  p' = p + h v + h^2/2 a + h^3/6 j,  v' = v + h a + h^2/2 j,  a' = a + h j.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from radron.agent.geometry import Array

# Cost per step: position error 1 /m2, velocity error and jerk as below. The closed loop then has about 1.5 rad/s.
VELOCITY_WEIGHT = 0.3  # s2
JERK_WEIGHT = 0.05  # s6


@dataclass(frozen=True, slots=True)
class Prediction:
    """Matrices of the motion model over H steps, for one axis. Rows are the steps 1 .. H; p0, v0, a0 is the state at the start.

    position, velocity, acceleration: (H, H), each from the jerks. forced: (3 H, H), the three stacked.
    free: (3 H, 2), positions, velocities, accelerations from v0 and a0 without jerk, for p0 = 0.
    hessian: (H, H), of the tracking cost.
    optimum: (4 H, 2 + 2 H), from (v0, a0, H reference positions - p0, H reference velocities) to the unconstrained minimum of
        the cost: H jerks, positions - p0, velocities, accelerations.
    """

    position: Array
    velocity: Array
    acceleration: Array
    forced: Array
    free: Array
    hessian: Array
    optimum: Array


@cache  # shared by all drones and flights
def predict(horizon: int, step_s: float) -> Prediction:
    """Return the matrices of the motion model for H steps (``horizon``) of ``step_s``; computed once for each pair."""
    h = step_s
    transition = np.array([[1.0, h, h * h / 2.0], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    response = np.array([h**3 / 6.0, h * h / 2.0, h])
    forced = np.zeros((3, horizon, horizon))
    free = np.zeros((3, horizon, 2))
    power = np.eye(3)
    for step in range(horizon):
        for start in range(horizon - step):
            forced[:, start + step, start] = power @ response
        power = transition @ power
        free[:, step] = power[:, 1:]
    position, velocity, acceleration = forced
    hessian = position.T @ position + VELOCITY_WEIGHT * velocity.T @ velocity + JERK_WEIGHT * np.eye(horizon)
    zero = np.zeros((horizon, horizon))
    wanted_position = np.hstack((-free[0], np.eye(horizon), zero))
    wanted_velocity = np.hstack((-free[1], zero, np.eye(horizon)))
    jerk = np.linalg.solve(hessian, position.T @ wanted_position + VELOCITY_WEIGHT * velocity.T @ wanted_velocity)
    drift = [np.hstack((part, zero, zero)) for part in free]
    optimum = np.vstack((jerk, drift[0] + position @ jerk, drift[1] + velocity @ jerk, drift[2] + acceleration @ jerk))
    return Prediction(
        position,
        velocity,
        acceleration,
        forced.reshape(3 * horizon, horizon),
        free.reshape(3 * horizon, 2),
        hessian,
        np.ascontiguousarray(optimum),
    )
