"""Feed-forward: the acceleration setpoint with which a vehicle flies a plan exactly, and a measure of the remaining deviation.

A cascade such as PX4's (position P, velocity PID, a tilt with lag, drag; velocity and acceleration fed forward with gain 1) flies
exactly p(t) if its setpoints, ahead by the dead time, are p, v and

    a + D v + tau (j + D a - w x (a + D v)) + K_d a,

with the acceleration a and jerk j of the plan, drag D, attitude lag tau, commanded yaw rate w (PX4 feeds it forward as a rotation
about the vertical, which rotates the thrust too) and gain K_d on the derivative of the velocity. Then the controllers have
nothing to correct, and the integrator of the velocity controller compensates the wind alone.
"""

from __future__ import annotations

from math import exp, hypot, sqrt

from radron.agent.config.drone import ResponseConfig
from radron.agent.geometry import Vector3

MOST_MPS2 = 9.0  # horizontal limit of a setpoint: 43 degrees of tilt; PX4 tilts to 45 and needs a reserve for corrections
DEVIATION_S = 10.0  # averaging time of deviations
_FARTHEST_M = 3.0  # larger deviations are jumps or gusts, and are limited to this


def feedforward(
    response: ResponseConfig,
    velocity: Vector3,
    acceleration: Vector3,
    jerk: tuple[float, float],
    yaw_rate_rps: float = 0.0,
) -> tuple[float, float, float]:
    """Return the acceleration setpoint (m/s^2) with which the vehicle flies this velocity, acceleration and horizontal jerk.

    It makes up for drag and for the lag of the attitude, also while the vehicle yaws at ``yaw_rate_rps``. The vertical axis has
    no attitude lag; its thrust follows at once.
    """
    drag, lag = response.drag_ps, response.attitude_lag_s
    (u, v, w), (ax, ay, az), (jx, jy) = velocity, acceleration, jerk
    x, y = ax + drag * u, ay + drag * v  # acceleration to be produced by the thrust
    share, turn = lag * drag + response.derivative_gain, lag * yaw_rate_rps
    x, y = x + share * ax + lag * jx + turn * y, y + share * ay + lag * jy - turn * x
    scale = min(1.0, MOST_MPS2 / max(hypot(x, y), 1e-9))
    return scale * x, scale * y, az + drag * w


def reaction_s(response: ResponseConfig) -> float:
    """Return the delay (s) with which the vehicle reacts to a setpoint that is not sent ahead of time."""
    return response.lag_s + 1.5 * response.attitude_lag_s


class Deviation:
    """Exponentially weighted RMS of a vehicle's horizontal deviations from its plans over the last 10 s. It begins with
    ``expected_m``.
    """

    def __init__(self, expected_m: float) -> None:
        self._square = expected_m**2
        self._stamp_ns: int | None = None

    @property
    def rms_m(self) -> float:
        """RMS deviation (m) of the vehicle from its plans at present."""
        return sqrt(self._square)

    def add(self, stamp_ns: int, x: float, y: float) -> float:
        """Add a deviation (x, y) in m. Return the time (s) since the previous deviation, at most 1 s."""
        elapsed_s = min(max((stamp_ns - self._stamp_ns) * 1e-9, 0.0), 1.0) if self._stamp_ns is not None else 0.0
        self._stamp_ns = stamp_ns
        square = min(x * x + y * y, _FARTHEST_M**2)
        self._square += (1.0 - exp(-elapsed_s / DEVIATION_S)) * (square - self._square)
        return elapsed_s
