"""Context of a plan of this drone: the predicted positions of the other drones, and the area for the flight. The simulation
compares it with the truth.
"""

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
    """Prediction of another drone for the end of this drone's plan, as seen from the planned end: least horizontal distance (m),
    and direction (rad).

    ``blind``: the other drone does not know of this one, and gives no way.
    """

    id: str
    clearance_m: float
    bearing_rad: float
    blind: bool


class Reckoning(Struct, frozen=True):
    """Context of a plan, own local frame.

    position_m: of this drone at ``stamp_ns``.
    others: predictions of the other drones, and the lines and circles beyond which missing drones may be.
    room: area inside the fence; a circle around the waiting drone while its frame is not known.
    mission_from_local: None while that frame is not known.
    planned: (H + 1, 3) m, the resulting plan, at stamp_ns, stamp_ns + step_s, ...
    divided: predictions of missing drones whose places on the own circle stay free.
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
        """Return the horizontal distance (m) from this drone to the nearest prediction of another drone; infinite without one.

        Args:
            drone: id of the other drone.
            sigmas: multiple of a prediction's position uncertainty that is taken off its distance.
            place_m: true position of the other drone, mission frame. A line or circle of any missing drone counts as a
                prediction of this one, too, if this place lies beyond it.
            before_m: or lies at most this far on this drone's side of it.
        """
        frame = self.mission_from_local
        place = None if frame is None else frame.inverse().apply_point(place_m)
        places = (*self.others, *self.divided)
        expected = (one for one in places if one.id == drone or _is_beyond(place, one, self.stamp_ns, before_m))
        return min((_distance_m(self.position_m, one, self.stamp_ns, sigmas) for one in expected), default=inf)

    def keeps_from_circle(self, place_m: Vector3, before_m: float) -> bool:
        """Whether a position, mission frame, lies beyond a circle that this plan keeps clear of, or at most ``before_m`` on this
        drone's side of it. False while the own frame is not known.
        """
        if self.mission_from_local is None:
            return False
        place = self.mission_from_local.inverse().apply_point(place_m)
        return any(_is_beyond(place, one, self.stamp_ns, before_m) for one in self.others if not isinf(one.radius_m))

    def ends(self, sigmas: float) -> list[End]:
        """Return the predictions of the other drones for the end of the plan, as seen from there.

        ``sigmas``: multiple of a prediction's position uncertainty that is taken off its distance. For a drone anywhere beyond a
        line or circle, the nearest point of that counts.
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
        """Corners (N, 2) of ``room`` in the mission frame; None while the own frame is not known."""
        corners = np.asarray(self.room.exterior.coords)
        known = self.mission_from_local
        return None if known is None else known.apply(np.column_stack((corners, np.zeros(len(corners)))))[:, :2]


def _distance_m(place: Vector3, plan: PeerPlan, now_ns: int, sigmas: float) -> float:
    """Return the distance (m) from a position to the predicted position of another drone, or to the line or circle beyond which
    it may be; less ``sigmas`` times its position uncertainty.
    """
    if plan.away is not None:
        return max(0.0, _in_front_m(place, plan, now_ns)) - sigmas * plan.sigma_m
    x, y = plan.at(now_ns)
    return hypot(place[0] - x, place[1] - y) - sigmas * plan.sigma_m


def _is_beyond(place: Vector3 | None, plan: PeerPlan, now_ns: int, before_m: float) -> bool:
    """Whether a position lies beyond the line or circle beyond which another drone may be, or at most ``before_m`` on this
    drone's side of it. False if the position is not known, or ``plan`` is a path.
    """
    return place is not None and plan.away is not None and _in_front_m(place, plan, now_ns) <= before_m


def _in_front_m(place: Vector3, plan: PeerPlan, now_ns: int, after_s: float = 0.0) -> float:
    """Return how far (m) a position is on this drone's side of the border beyond which a missing drone may be; negative beyond
    it.

    The border is a line, or a circle (``PeerPlan.radius_m``). The distance is that to the circle itself, because its tangent is
    right near one point only. ``after_s``: 0 for the border now; else the time to the plan's end, for the border then.
    """
    assert plan.away is not None
    x, y = plan.at(now_ns, after_s)
    away_x, away_y = plan.away[-1 if after_s > 0.0 else 0].tolist()
    if isinf(plan.radius_m):
        return float((place[0] - x) * away_x + (place[1] - y) * away_y)
    centre_x, centre_y = x + plan.radius_m * away_x, y + plan.radius_m * away_y
    return plan.radius_m - copysign(hypot(place[0] - centre_x, place[1] - centre_y), plan.radius_m)
