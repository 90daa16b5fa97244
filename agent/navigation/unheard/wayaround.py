"""The way home around the homes of others that are not heard, and may come down there at any time, and around those that hover.

Straight on, a drone stopped before a row of such homes that its own lies behind, and hovered there until all had to be down; or
before two that human pilots held in the air beside each other, until it landed there.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, dist, floor, hypot, pi

import numpy as np
import shapely
from msgspec import Struct
from shapely import Polygon

from agent.config.mission import MissionConfig
from agent.frames.transform import Transform
from agent.geometry import Array, Point2
from agent.localization.ownpose import LocalFrame
from agent.motion.detour import Detours
from agent.motion.separation import DOUBT_SIGMAS, PeerPlan, margin_m

_FENCE_M = 1.5  # that plans keep from the fence
_QUARTER = 3  # edges of a circle's quarter
_GRAIN_M = 0.25  # of a circle that is smaller because the drone is in it, so that ways are not worked out anew at each step
_HOVERS_MPS, _HOVER_GRAIN_M = 1.0, 0.5  # slower than this one hovers; the grain of its place, as for the circles


class KeptPlace(Struct, frozen=True):
    """A place to keep clear of, mission frame, its error relative to this drone (1 sigma), and how far off it one may be."""

    place: Point2
    sigma_m: float = 0.0
    deviation_m: float = 0.0


def hovering(others: Sequence[PeerPlan], mission_from_local: Transform) -> list[KeptPlace]:
    """The places of those that stay where they are and give no way: a human pilot holds them, or an autopilot alone."""
    found = []
    for other in others:
        if other.blind and other.measured is not None and hypot(*other.measured.velocity[:2]) < _HOVERS_MPS:
            x, y, _ = mission_from_local.apply_point(other.measured.position)
            place = _HOVER_GRAIN_M * round(x / _HOVER_GRAIN_M), _HOVER_GRAIN_M * round(y / _HOVER_GRAIN_M)
            found.append(KeptPlace(place, other.sigma_m, other.deviation_m))
    return found


class WayAround:
    """Ways of one drone, horizontal."""

    def __init__(self, mission: MissionConfig) -> None:
        self._separation_m = mission.limits.separation_m
        self._room = Polygon(mission.area.polygon_m).buffer(mission.area.fence_margin_m - _FENCE_M)
        self._circles: tuple[tuple[Point2, float], ...] = ()
        self._detours = Detours(self._room)

    def local(self, here: Point2, to: Point2, frame: LocalFrame, kept: Sequence[KeptPlace], deviation_m: float) -> Array:
        """The same as ``way``, but all but the places in the drone's own local frame."""
        if not kept:
            return np.array([here, to])
        ends = frame.mission_from_local.apply(np.array([(*here, 0.0), (*to, 0.0)]))[:, :2].tolist()
        way = self.way((ends[0][0], ends[0][1]), (ends[1][0], ends[1][1]), kept, deviation_m)
        placed: Array = frame.local_from_mission.apply(np.column_stack((way, np.zeros(len(way)))))
        return placed[:, :2]

    def way(self, here: Point2, there: Point2, kept: Sequence[KeptPlace], deviation_m: float) -> Array:
        """Points (P, 2) of the shortest way, both ends included, mission frame; straight where the places leave none.

        As far from the places as plans keep, or as both ends are. ``deviation_m``: RMS deviation of this drone from its plans.
        """
        widened = 1.0 / cos(0.25 * pi / _QUARTER)  # the corners of the polygon, so that its edges touch the circle
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
