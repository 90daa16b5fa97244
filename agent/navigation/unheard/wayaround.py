"""Way home around keep-out discs: over the homes of missing drones, which may descend there at any time, and hovering vehicles.

Separation alone would stop a drone on a straight way before a row of such homes until all these drones must have landed. Before
two vehicles that safety pilots hold side by side, it would hover until it had to land.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, dist, floor, hypot, pi

import numpy as np
import shapely
from msgspec import Struct
from shapely import Polygon

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array, Point2
from radron.agent.localization.ownpose import LocalFrame
from radron.agent.motion.detour import Detours
from radron.agent.motion.separation import DOUBT_SIGMAS, PeerPlan, margin_m

_FENCE_M = 1.5  # distance of the way from the fence: the margin of plans
_QUARTER = 3  # discs are polygons with this many edges in each quarter
_GRAIN_M = 0.25  # radii of discs that reach up to an end of the way are rounded to this: else the way changes at each step
_HOVERS_MPS, _HOVER_GRAIN_M = 1.0, 0.5  # greatest speed of a hovering vehicle; its position is rounded to this, likewise


class KeptPlace(Struct, frozen=True):
    """Keep-out disc around ``place``, mission frame. ``sigma_m``: 1 sigma of the place relative to this drone; ``deviation_m``:
    RMS deviation of a vehicle from it.
    """

    place: Point2
    sigma_m: float = 0.0
    deviation_m: float = 0.0


def hovering(others: Sequence[PeerPlan], mission_from_local: Transform) -> list[KeptPlace]:
    """Return keep-out discs around the vehicles that hover and give no way: held by a safety pilot, or by the autopilot alone."""
    found = []
    for other in others:
        if other.blind and other.measured is not None and hypot(*other.measured.velocity[:2]) < _HOVERS_MPS:
            x, y, _ = mission_from_local.apply_point(other.measured.position)
            place = _HOVER_GRAIN_M * round(x / _HOVER_GRAIN_M), _HOVER_GRAIN_M * round(y / _HOVER_GRAIN_M)
            found.append(KeptPlace(place, other.sigma_m, other.deviation_m))
    return found


class WayAround:
    """Shortest horizontal ways around keep-out discs inside the fence, for one drone."""

    def __init__(self, mission: MissionConfig) -> None:
        self._separation_m = mission.limits.separation_m
        self._room = Polygon(mission.area.polygon_m).buffer(mission.area.fence_margin_m - _FENCE_M)
        self._circles: tuple[tuple[Point2, float], ...] = ()
        self._detours = Detours(self._room)

    def local(self, here: Point2, to: Point2, frame: LocalFrame, kept: Sequence[KeptPlace], deviation_m: float) -> Array:
        """Return the way as ``way`` does, but from ``here`` and ``to`` in the own local frame, and with points in that frame."""
        if not kept:
            return np.array([here, to])
        ends = frame.mission_from_local.apply(np.array([(*here, 0.0), (*to, 0.0)]))[:, :2].tolist()
        way = self.way((ends[0][0], ends[0][1]), (ends[1][0], ends[1][1]), kept, deviation_m)
        placed: Array = frame.local_from_mission.apply(np.column_stack((way, np.zeros(len(way)))))
        return placed[:, :2]

    def way(self, here: Point2, there: Point2, kept: Sequence[KeptPlace], deviation_m: float) -> Array:
        """Return the points (P, 2) of the shortest way around the discs, both ends included, mission frame. It is straight if the
        discs leave no way.

        The radius of a disc is the distance that plans keep from such a place; but no disc covers an end of the way.
        ``deviation_m``: RMS deviation of this drone from its plans.
        """
        widened = 1.0 / cos(0.25 * pi / _QUARTER)  # outer over inner radius of such a polygon, whose edges shall touch the disc
        circles = []
        for one in kept:
            free_m = min(dist(one.place, end) for end in (here, there)) / widened
            wanted_m = self._separation_m + margin_m(deviation_m, one.deviation_m) + DOUBT_SIGMAS * one.sigma_m
            radius_m = wanted_m if free_m > wanted_m else _GRAIN_M * floor(free_m / _GRAIN_M)
            circles += [(one.place, widened * radius_m)] if radius_m > 0.0 else []
        if tuple(circles) != self._circles:
            self._circles = tuple(circles)
            holes = [shapely.Point(place).buffer(radius_m, quad_segs=_QUARTER) for place, radius_m in circles]
            self._detours = Detours(shapely.difference(self._room, shapely.union_all(holes)))
        ends = np.array(here), np.array(there)
        return np.vstack((ends[0], self._detours.between(*ends), ends[1]))
