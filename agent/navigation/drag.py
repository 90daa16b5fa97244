"""Identification of a multirotor's drag from its tilt: thrust that does not change the velocity overcomes the drag.

Over a short time T in level flight, horizontally

    change of velocity - integral of g tan(tilt) dt = -D (way) + c T + noise,

D: drag per velocity (1/s), c: wind times D plus accelerometer bias (m/s2). A Kalman filter estimates the state (D, c_x, c_y).
Commands are no input, so the result does not depend on the pilot or autopilot, its gains, or its integrators.
"""

from __future__ import annotations

from math import hypot, sqrt

from radron.agent.vehicle.interface import VehicleState

GRAVITY_MPS2 = 9.80665
_PART_S = 0.5  # duration T of one measurement: long enough to average attitude noise, short compared with manoeuvres
_GAP_S = 0.25  # longer gaps in telemetry interrupt the integral
_STEEPEST = 0.5  # cosine of the largest tilt at which flight counts as level
_VELOCITY_NOISE_MPS = 0.15  # 1 sigma of a change of velocity in that time; errors of 0.3 m/s are correlated over seconds
_SLOWEST_MPS = 1.0  # below this speed the drag is not updated: drift of the position estimate would count as motion
_DRAG_SIGMA_PS = 0.4  # prior 1 sigma of the drone file's value
_DRAG_WALK_PS = 0.02  # random walk of the drag in 1 s, because the drag also depends on the speed
_CONSTANT_SIGMA_MPS2 = 1.0  # prior 1 sigma of c, for a wind of some m/s
_CONSTANT_WALK_MPS2 = 0.1
_GATE = 16.0  # a measurement whose squared innovation exceeds its variance by this factor is an outlier
_MISFIT_PARTS = 20.0  # the misfit is averaged over this many measurements
_MISFIT, _MISFIT_AGAIN = 5.0, 2.5  # mean normalised squared innovation (1) beyond which the model fails; and fits again
_LEAST_PS, _MOST_PS = -0.1, 3.0  # range of a multirotor's drag


class DragFilter:
    """Kalman filter of the drag of one vehicle: ``drag_ps`` (1/s), with the 1 sigma ``sigma_ps``."""

    def __init__(self, drag_ps: float, sigma_ps: float = _DRAG_SIGMA_PS, walk_ps: float = _DRAG_WALK_PS) -> None:
        """``drag_ps``, ``sigma_ps``: prior of the drag and its 1 sigma; ``walk_ps``: random walk of the drag in 1 s."""
        self._walk_square = walk_ps**2
        self._state = [drag_ps, 0.0, 0.0]
        square = _CONSTANT_SIGMA_MPS2**2
        self._covariance = [[sigma_ps**2, 0.0, 0.0], [0.0, square, 0.0], [0.0, 0.0, square]]
        self._misfit = 1.0
        self._fits = True
        self._begun: VehicleState | None = None  # first telemetry of the present measurement
        self._last: VehicleState | None = None
        self._thrust = (0.0, 0.0)  # acceleration by thrust then, horizontal
        self._integral = (0.0, 0.0)

    @property
    def drag_ps(self) -> float:
        """Estimated drag, 1/s."""
        return self._state[0]

    @property
    def sigma_ps(self) -> float:
        """1 sigma of the drag, 1/s."""
        return sqrt(self._covariance[0][0])

    @property
    def fits(self) -> bool:
        """Whether tilt and motion fit the model of a multirotor, with a drag within the usual range."""
        return self._fits and _LEAST_PS <= self._state[0] <= _MOST_PS

    def interrupt(self, turned: bool = False) -> None:
        """Note that the next telemetry does not continue the last one. ``turned``: the axes of its local frame are others, too,
        so wind and bias are unknown again.
        """
        self._begun = self._last = None
        if turned:
            square = _CONSTANT_SIGMA_MPS2**2
            (variance, _, _), _, _ = self._covariance
            self._covariance = [[variance, 0.0, 0.0], [0.0, square, 0.0], [0.0, 0.0, square]]
            self._state[1] = self._state[2] = 0.0

    def follow(self, vehicle: VehicleState) -> None:
        """Process telemetry of a vehicle in flight; after each half second, update the filter."""
        thrust = horizontal_thrust(vehicle.quaternion)
        last = self._last
        follows = last is None or vehicle.stamp_ns - last.stamp_ns <= _GAP_S * 1e9
        if last is not None and (vehicle.epoch != last.epoch or not follows):
            self.interrupt(turned=vehicle.epoch != last.epoch)
        if thrust is None:
            self.interrupt()
            return
        begun, last = self._begun, self._last
        before, self._thrust, self._last = self._thrust, thrust, vehicle
        if begun is None or last is None:
            self._begun, self._integral = vehicle, (0.0, 0.0)
            return
        half_s = 0.5e-9 * (vehicle.stamp_ns - last.stamp_ns)
        x, y = self._integral
        self._integral = (x + half_s * (before[0] + thrust[0]), y + half_s * (before[1] + thrust[1]))
        duration_s = (vehicle.stamp_ns - begun.stamp_ns) * 1e-9
        if duration_s >= _PART_S:
            self._measure(begun, vehicle, duration_s)
            self._begun, self._integral = vehicle, (0.0, 0.0)

    def _measure(self, begun: VehicleState, vehicle: VehicleState, duration_s: float) -> None:
        covariance = self._covariance
        ways = [vehicle.position_m[axis] - begun.position_m[axis] for axis in (0, 1)]
        moves = hypot(*ways) > _SLOWEST_MPS * duration_s
        if moves:
            covariance[0][0] += self._walk_square * duration_s
        covariance[1][1] += _CONSTANT_WALK_MPS2**2 * duration_s
        covariance[2][2] += _CONSTANT_WALK_MPS2**2 * duration_s
        for axis in (0, 1):
            gained = vehicle.velocity_mps[axis] - begun.velocity_mps[axis] - self._integral[axis]
            self._update((-ways[axis], duration_s * (1 - axis), duration_s * axis), gained, moves)

    def _update(self, row: tuple[float, float, float], measured: float, moves: bool) -> None:
        """Update the filter with one scalar measurement.

        ``row``: its derivatives with respect to the state; ``measured``: its value, m/s; ``moves``: the drag is updated, too, and
        not wind and bias alone.
        """
        state, covariance = self._state, self._covariance
        gain = [sum(entry * part for entry, part in zip(line, row, strict=True)) for line in covariance]
        variance = sum(part * entry for part, entry in zip(row, gain, strict=True)) + _VELOCITY_NOISE_MPS**2
        innovation = measured - sum(part * value for part, value in zip(row, state, strict=True))
        square = innovation * innovation / variance
        self._misfit += (min(square, 4.0 * _GATE) - self._misfit) / _MISFIT_PARTS
        self._fits = self._misfit < (_MISFIT if self._fits else _MISFIT_AGAIN)
        if square > _GATE:
            return
        known = covariance[0][0], state[0]
        for one in range(3):
            state[one] += gain[one] * innovation / variance
            for other in range(3):
                covariance[one][other] -= gain[one] * gain[other] / variance
        if not moves:
            covariance[0][0], state[0] = known


def horizontal_thrust(quaternion: tuple[float, float, float, float]) -> tuple[float, float] | None:
    """Return the horizontal acceleration (m/s2, local frame) by the thrust of a vehicle at constant height with this attitude;
    None if the tilt is too large for that.
    """
    w, x, y, z = quaternion
    up = 1.0 - 2.0 * (x * x + y * y)
    if up < _STEEPEST:
        return None
    scale = 2.0 * GRAVITY_MPS2 / up
    return scale * (x * z + w * y), scale * (y * z - w * x)
