"""Context of a plan: predictions of the other drones, and the room for the flight. The simulation compares it with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, copysign, hypot, inf, isinf

import numpy as np
from msgspec import Struct
from shapely import Polygon

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array, Vector3
from radron.agent.motion.separation import PeerPlan


class End(Struct, frozen=True):
    """Prediction of another drone at the end of a plan, as seen from there: least distance, and direction (rad).
    ``blind``: it does not know of the planning drone, and may appear within any distance.
    """

    id: str
    clearance_m: float
    bearing_rad: float
    blind: bool


class Reckoning(Struct, frozen=True):
    """Context of a plan, own local frame: position of the drone, predictions of the other drones, room for the flight.

    ``mission_from_local``: None while that frame is not known; then the room is a circle around the waiting drone. ``planned``:
    (H + 1, 3) m, the resulting plan, at stamp_ns, stamp_ns + step_s, ... ``divided``: the places on the shared circle that stay
    free for missing drones.
    """

    stamp_ns: int
    position_m: Vector3
    others: Sequence[PeerPlan]
    room: Polygon
    mission_from_local: Transform | None
    planned: Array
    step_s: float
    divided: Sequence[PeerPlan] = ()

    def distance_m(self, drone: str, sigmas: float, place_m: Vector3, before_m: float = 0.0) -> float:
        """Return the least horizontal distance to another drone: to its prediction, less so many sigmas; infinite without one.

        ``place_m``: its true position, mission frame. A line or circle to be kept clear of covers all drones beyond it, and up to
        ``before_m`` before it, whatever drone is the reason.
        """
        frame = self.mission_from_local
        place = None if frame is None else frame.inverse().apply_point(place_m)
        places = (*self.others, *self.divided)
        expected = (one for one in places if one.id == drone or _is_beyond(place, one, self.stamp_ns, before_m))
        return min((_distance_m(self.position_m, one, self.stamp_ns, sigmas) for one in expected), default=inf)

    def keeps_from_circle(self, place_m: Vector3, before_m: float) -> bool:
        """Whether a position, mission frame, lies beyond a circle to be kept clear of, or at most ``before_m`` before it."""
        if self.mission_from_local is None:
            return False
        place = self.mission_from_local.inverse().apply_point(place_m)
        return any(_is_beyond(place, one, self.stamp_ns, before_m) for one in self.others if not isinf(one.radius_m))

    def ends(self, sigmas: float) -> list[End]:
        """Return the predictions of other drones at the end of the plan, as seen from there, less so many sigmas. For drones
        somewhere beyond a line, its nearest point counts.
        """
        end_s, (x, y, z) = (len(self.planned) - 1) * self.step_s, self.planned[-1].tolist()
        found = []
        for one in self.others:
            u, v = one.at(self.stamp_ns, end_s)
            if one.away is None:
                away_m, bearing_rad = hypot(u - x, v - y), atan2(v - y, u - x)
            else:
                back_x, back_y = one.away[-1].tolist()
                away_m, bearing_rad = _in_front_m((x, y, z), one, self.stamp_ns, end_s), atan2(-back_y, -back_x)
            found.append(End(one.id, away_m - sigmas * one.sigma_m, bearing_rad, one.blind))
        return found

    @property
    def corners_m(self) -> Array | None:
        """Corners (N, 2) of the room in the mission frame; None while that is not known."""
        corners = np.asarray(self.room.exterior.coords)
        known = self.mission_from_local
        return None if known is None else known.apply(np.column_stack((corners, np.zeros(len(corners)))))[:, :2]


def _distance_m(place: Vector3, plan: PeerPlan, now_ns: int, sigmas: float) -> float:
    """Return the distance from a position to the prediction by a plan, or to its line or circle, less the uncertainty."""
    if plan.away is not None:
        return max(0.0, _in_front_m(place, plan, now_ns)) - sigmas * plan.sigma_m
    x, y = plan.at(now_ns)
    return hypot(place[0] - x, place[1] - y) - sigmas * plan.sigma_m


def _is_beyond(place: Vector3 | None, plan: PeerPlan, now_ns: int, before_m: float) -> bool:
    """Whether a position, if known, lies beyond the line or circle of a plan, or at most ``before_m`` before it."""
    return place is not None and plan.away is not None and _in_front_m(place, plan, now_ns) <= before_m


def _in_front_m(place: Vector3, plan: PeerPlan, now_ns: int, after_s: float = 0.0) -> float:
    """Return the distance of a position in front of the line of a plan, or of its circle. The tangent is no substitute: off the
    point of contact, it would leave out a part of the circle, or hold its inside. ``after_s``: seconds from now on, 0 or to the
    plan's end.
    """
    assert plan.away is not None
    x, y = plan.at(now_ns, after_s)
    away_x, away_y = plan.away[-1 if after_s > 0.0 else 0].tolist()
    if isinf(plan.radius_m):
        return float((place[0] - x) * away_x + (place[1] - y) * away_y)
    centre_x, centre_y = x + plan.radius_m * away_x, y + plan.radius_m * away_y
    return plan.radius_m - copysign(hypot(place[0] - centre_x, place[1] - centre_y), plan.radius_m)
