"""What a plan was made with: where the others were expected, and the room it flies in. The simulation judges it by the truth."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, copysign, hypot, inf, isinf

import numpy as np
from msgspec import Struct
from shapely import Polygon

from agent.frames.transform import Transform
from agent.geometry import Array, Vector3
from agent.motion.separation import PeerPlan


class End(Struct, frozen=True):
    """Where another drone is expected when a plan ends, seen from that end: how far away, at least, and in which direction (rad).
    ``blind``: it does not know of the planning one, and may turn up within any distance.
    """

    id: str
    clearance_m: float
    bearing_rad: float
    blind: bool


class Reckoning(Struct, frozen=True):
    """What a plan was made with, own local frame: where the drone was, where others are expected, the room it flies in.

    ``mission_from_local``: None while that frame is not known; then the room is a circle around the waiting drone. ``planned``:
    (H + 1, 3) m, what the plan became, at stamp_ns, stamp_ns + step_s, ... ``divided``: the places on the shared circle
    that are kept free for drones that are not heard.
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
        """How near another drone may be, horizontally: where it is expected, less so many sigmas; infinite if it is not.

        ``place_m``: where it really is, mission frame. A line or circle that is kept from for the sake of one keeps from all
        beyond it, or so little before it.
        """
        frame = self.mission_from_local
        place = None if frame is None else frame.inverse().apply_point(place_m)
        places = (*self.others, *self.divided)
        expected = (one for one in places if one.id == drone or _is_beyond(place, one, self.stamp_ns, before_m))
        return min((_distance_m(self.position_m, one, self.stamp_ns, sigmas) for one in expected), default=inf)

    def keeps_from_circle(self, place_m: Vector3, before_m: float) -> bool:
        """Whether a place, mission frame, lies beyond a circle that is kept from, for whomever, or so little before it."""
        if self.mission_from_local is None:
            return False
        place = self.mission_from_local.inverse().apply_point(place_m)
        return any(_is_beyond(place, one, self.stamp_ns, before_m) for one in self.others if not isinf(one.radius_m))

    def ends(self, sigmas: float) -> list[End]:
        """Where others are expected when the plan ends, as seen from there, less so many sigmas; those that are somewhere beyond
        a line, where it is nearest.
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
    """Distance from a place to where a plan expects another drone, or to the line or circle that it is beyond, less its doubt."""
    if plan.away is not None:
        return max(0.0, _in_front_m(place, plan, now_ns)) - sigmas * plan.sigma_m
    x, y = plan.at(now_ns)
    return hypot(place[0] - x, place[1] - y) - sigmas * plan.sigma_m


def _is_beyond(place: Vector3 | None, plan: PeerPlan, now_ns: int, before_m: float) -> bool:
    """Whether a place, where it is known, lies beyond the line or circle of a plan, or at most ``before_m`` before it."""
    return place is not None and plan.away is not None and _in_front_m(place, plan, now_ns) <= before_m


def _in_front_m(place: Vector3, plan: PeerPlan, now_ns: int, after_s: float = 0.0) -> float:
    """How far a place lies in front of the line of a plan, or of the circle that it touches: seen from elsewhere, the tangent
    would leave out a part of the circle, or hold what is inside. ``after_s``: seconds from now on, 0 or to the plan's end.
    """
    assert plan.away is not None
    x, y = plan.at(now_ns, after_s)
    away_x, away_y = plan.away[-1 if after_s > 0.0 else 0].tolist()
    if isinf(plan.radius_m):
        return float((place[0] - x) * away_x + (place[1] - y) * away_y)
    centre_x, centre_y = x + plan.radius_m * away_x, y + plan.radius_m * away_y
    return plan.radius_m - copysign(hypot(place[0] - centre_x, place[1] - centre_y), plan.radius_m)
