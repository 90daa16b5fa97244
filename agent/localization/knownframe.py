"""Local frame of a drone whose frame the mission gives exactly, over jumps of its localisation: for its first epoch it is that of
the mission, and from then on it follows from the motion.
"""

from __future__ import annotations

from math import dist, hypot, remainder, sqrt, tau

import msgspec

from radron.agent.frames.transform import Transform
from radron.agent.localization.continuity import carried_on, spread
from radron.agent.vehicle.interface import VehicleState

# Two positions, or headings, that differ by less count as the same: the error of continued motion after a few jumps.
SAME_M, SAME_RAD = 1.0, 0.1
LARGEST_DOUBT_M = 7.0  # position uncertainty, or distance of two position hypotheses, above which a drone leaves the mission
NO_JUMP_M, NO_JUMP_RAD = 0.5, 0.05  # a smaller jump is noise, as for the driver of the vehicle (``vehicle.resets``)
# A jump back, after a gap in the telemetry, may miss the alternative position by this share of the distance between both position
# hypotheses, if the motion in the gap explains the miss.
_PART = 0.25
_SIGMAS = 3.0
# A position that jumps back to the truth may have slid away from it before, by as much as the jump, at an unknown speed. With
# this speed the begin of the slide is estimated, and the measurements since then are taken back. After a slower slide that is
# only the last part of it. A lower value would take back more correct measurements.
SLIDE_MPS = 1.0
_LONGEST_S = 30.0  # at most this much is taken back: after a jump by hundreds of metres, rather the new position is wrong


class KnownFrame:
    """Local frame of one drone, given exactly by the mission, over jumps of its localisation.

    After an announced jump (a reset that the autopilot reports), the new frame follows from the continuous motion. The old frame
    stays if the position has hardly jumped, or if a localisation without satellites finds them again within its stated error.

    An unannounced jump has two explanations that cannot be distinguished: the position is wrong from then on, or it was wrong
    until then, as at the end of satellite spoofing. The drone goes on by the first one, with the frame of the continuous motion.

    otherwise: frame by the second explanation, the alternative position hypothesis; None without one.
    elsewhere: stamps between which measurements may have wrong positions, and are taken back (``OwnPose.elsewhere``); or None.
    """

    def __init__(self) -> None:
        self.otherwise: Transform | None = None
        self.elsewhere: tuple[int, int] | None = None  # see ``OwnPose.elsewhere``

    def after_jump(
        self, old: Transform, last: VehicleState, vehicle: VehicleState, turning_rps: float | None, *, announced: bool
    ) -> Transform | None:
        """Return the frame (mission from local) after a jump, and update the alternative position hypothesis.

        None if the jump was announced, and telemetry was missing in flight for so long that a position by continuous motion is
        uncertain by more than ``LARGEST_DOUBT_M``: then the position is not known any more.

        Args:
            old: frame before the jump.
            last: last state before the jump, with the errors that the localisation states. Errors that include the distance
                between the position hypotheses would let any jump pass for a correction.
            vehicle: first state after the jump.
            turning_rps: turn rate (rad/s) before the jump; None if not known.
            announced: the vehicle has reported the jump.
        """
        onward = carried_on(_as_unsure(old, last), last, vehicle, turning_rps)
        if announced and not last.position_trusted and self._is_put_right(onward, old, last, vehicle):
            return old
        spread_m, spread_rad = spread(last, vehicle, turning_rps)
        if announced and last.in_air and spread_m > LARGEST_DOUBT_M:
            self.otherwise = None
            return None
        otherwise = self.otherwise or old
        doubt_m, doubt_rad = _apart_m(old, otherwise, last), abs(_turned_rad(old, otherwise))
        if announced:
            otherwise = carried_on(_as_unsure(otherwise, last), last, vehicle, turning_rps)
        same_m, same_rad = SAME_M + min(spread_m, _PART * doubt_m), SAME_RAD + min(spread_rad, _PART * doubt_rad)
        if _apart_m(onward, otherwise, vehicle) < same_m and abs(_turned_rad(onward, otherwise)) < same_rad:
            self.otherwise = self.elsewhere = None  # this jump has undone the last one
            return otherwise
        self.otherwise = otherwise
        if not announced:
            since_ns = vehicle.stamp_ns - round(1e9 * min(_LONGEST_S, _apart_m(onward, old, vehicle) / SLIDE_MPS))
            untold_ns = since_ns if self.elsewhere is None else self.elsewhere[0]  # of an earlier jump, not reported yet
            self.elsewhere = min(since_ns, untold_ns), vehicle.stamp_ns
        return onward

    def doubt_m(self, frame: Transform | None, vehicle: VehicleState) -> float:
        """Return the horizontal distance (m) between the drone's two possible positions; 0 without an alternative. ``frame``: the
        frame in use.
        """
        return 0.0 if self.otherwise is None or frame is None else _apart_m(frame, self.otherwise, vehicle)

    def doubted(self, frame: Transform, vehicle: VehicleState) -> Transform:
        """Return the frame in use, with a covariance that includes the alternative position hypothesis: the RMS difference
        between both, as they are equally likely.
        """
        if self.otherwise is None:
            return frame
        axis_m2, turned_rad = 0.25 * self.doubt_m(frame, vehicle) ** 2, _turned_rad(frame, self.otherwise)
        return frame.blurred(vehicle.position_m, (axis_m2, axis_m2, 0.0, 0.5 * turned_rad**2))

    def stated(self, frame: Transform | None, vehicle: VehicleState) -> VehicleState:
        """Return the telemetry with errors (1 sigma) that include the alternative position hypothesis."""
        if self.otherwise is None or frame is None:
            return vehicle
        position_m = hypot(vehicle.position_sigma_m, self.doubt_m(frame, vehicle) / sqrt(2.0))
        yaw_rad = hypot(vehicle.yaw_sigma_rad, _turned_rad(frame, self.otherwise) / sqrt(2.0))
        return msgspec.structs.replace(vehicle, position_sigma_m=position_m, yaw_sigma_rad=yaw_rad)

    @staticmethod
    def _is_put_right(onward: Transform, old: Transform, last: VehicleState, vehicle: VehicleState) -> bool:
        jump_m, turn_rad = _apart_m(onward, old, vehicle), abs(_turned_rad(onward, old))
        if jump_m <= NO_JUMP_M and turn_rad <= NO_JUMP_RAD:
            return True
        within = jump_m <= SAME_M + _SIGMAS * last.position_sigma_m and turn_rad <= SAME_RAD + _SIGMAS * last.yaw_sigma_rad
        return vehicle.aided and within


def _as_unsure(frame: Transform, last: VehicleState) -> Transform:
    """Return the frame with a covariance raised to the errors that the localisation states at ``last``. An exactly known frame is
    returned as it is.
    """
    if frame.covariance is None:
        return frame  # ``carried_on`` adds these errors itself
    place_m, yaw_rad = frame.sigmas_at(last.position_m)
    axis_m2 = 0.5 * max(0.0, last.position_sigma_m**2 - place_m**2)
    return frame.blurred(last.position_m, (axis_m2, axis_m2, 0.0, max(0.0, last.yaw_sigma_rad**2 - yaw_rad**2)))


def _apart_m(one: Transform, other: Transform, vehicle: VehicleState) -> float:
    """Return the horizontal distance (m) between the positions of a vehicle by two frames of its epoch."""
    return dist(one.apply_point(vehicle.position_m)[:2], other.apply_point(vehicle.position_m)[:2])


def _turned_rad(one: Transform, other: Transform) -> float:
    return remainder(one.yaw_rad - other.yaw_rad, tau)
