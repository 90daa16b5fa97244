"""The frame of a drone that the mission knows exactly: for its first epoch by the mission, from then on by its motion."""

from __future__ import annotations

from math import dist, hypot, remainder, sqrt, tau

import msgspec

from radron.agent.frames.transform import Transform
from radron.agent.localization.continuity import carried_on, spread
from radron.agent.vehicle.interface import VehicleState

# Two places, and two headings, nearer to each other than this are one: the error of continuity after a few jumps.
SAME_M, SAME_RAD = 1.0, 0.1
LARGEST_DOUBT_M = 7.0  # of its place, above which a drone leaves the mission
NO_JUMP_M, NO_JUMP_RAD = 0.5, 0.05  # as much as a vehicle's driver takes for noise (``vehicle.resets``)
_PART = 0.25  # a jump back over a gap may miss the other place by this share of the doubt, if the motion explains it
_SIGMAS = 3.0
# A position that jumps may have slid away by as much until then, at any speed. After a slide at this speed, or faster, all
# measurements of that time are taken back. After a slower slide the last part is taken back. With a lower limit more correct
# measurements would be lost.
SLIDE_MPS = 1.0
_LONGEST_S = 30.0  # taken back at most: after a jump by hundreds of metres the position is rather wrong from then on


class KnownFrame:
    """An exactly known frame over jumps of the localisation.

    An announced jump begins another frame, which continues the motion. An unannounced jump has two explanations that cannot be
    distinguished. Either the position is wrong from then on, or it was wrong until then, as at the end of satellite spoofing. The
    drone flies on by continuity. The position by its localisation is the alternative hypothesis, ``otherwise`` (None: no such
    doubt). Measurements during a possible slide are taken back (``elsewhere``). The frame stays after an announced jump with
    which an untrusted localisation finds its satellites again, within its stated error. It also stays without a jump, as at the
    loss of satellites.
    """

    def __init__(self) -> None:
        self.otherwise: Transform | None = None
        self.elsewhere: tuple[int, int] | None = None  # see ``OwnPose.elsewhere``

    def after_jump(
        self, old: Transform, last: VehicleState, vehicle: VehicleState, turning_rps: float | None, *, announced: bool
    ) -> Transform | None:
        """Return the frame of the epoch that begins with ``vehicle``; arguments as of ``carried_on``. None after an announced
        jump in a gap in flight that is too long for continuity: the position is unknown since then.

        ``last`` has the errors stated by the localisation, without the agent's own doubt: with it, any jump would count as a
        correction.
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
            self.otherwise = self.elsewhere = None  # the jump has undone the previous one
            return otherwise
        self.otherwise = otherwise
        if not announced:
            since_ns = vehicle.stamp_ns - round(1e9 * min(_LONGEST_S, _apart_m(onward, old, vehicle) / SLIDE_MPS))
            untold_ns = since_ns if self.elsewhere is None else self.elsewhere[0]  # of a jump since the last step
            self.elsewhere = min(since_ns, untold_ns), vehicle.stamp_ns
        return onward

    def doubt_m(self, frame: Transform | None, vehicle: VehicleState) -> float:
        """Distance between the two places where the drone may be; 0 without a doubt."""
        return 0.0 if self.otherwise is None or frame is None else _apart_m(frame, self.otherwise, vehicle)

    def doubted(self, frame: Transform, vehicle: VehicleState) -> Transform:
        """Return the frame with the doubt in its covariance: the RMS difference from the frame in use, as both explanations are
        equally likely.
        """
        if self.otherwise is None:
            return frame
        axis_m2, turned_rad = 0.25 * self.doubt_m(frame, vehicle) ** 2, _turned_rad(frame, self.otherwise)
        return frame.blurred(vehicle.position_m, (axis_m2, axis_m2, 0.0, 0.5 * turned_rad**2))

    def stated(self, frame: Transform | None, vehicle: VehicleState) -> VehicleState:
        """Telemetry with the doubt in its errors."""
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
    """A frame that was carried on, with what its localisation has come to state as its error since then."""
    if frame.covariance is None:
        return frame  # to which ``carried_on`` adds all of that
    place_m, yaw_rad = frame.sigmas_at(last.position_m)
    axis_m2 = 0.5 * max(0.0, last.position_sigma_m**2 - place_m**2)
    return frame.blurred(last.position_m, (axis_m2, axis_m2, 0.0, max(0.0, last.yaw_sigma_rad**2 - yaw_rad**2)))


def _apart_m(one: Transform, other: Transform, vehicle: VehicleState) -> float:
    """Horizontal distance between the places of a vehicle by two frames of its epoch."""
    return dist(one.apply_point(vehicle.position_m)[:2], other.apply_point(vehicle.position_m)[:2])


def _turned_rad(one: Transform, other: Transform) -> float:
    return remainder(one.yaw_rad - other.yaw_rad, tau)
