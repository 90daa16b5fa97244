"""The way home around the homes of others that are not heard, and may come down there at any time.

Straight on, a drone stopped before a row of such homes that its own lies behind, and hovered there until all had to be down.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, dist, floor, pi

import numpy as np
import shapely
from msgspec import Struct
from shapely import Polygon

from agent.config.mission import MissionConfig
from agent.geometry import Array, Point2
from agent.motion.detour import Detours
from agent.motion.separation import DOUBT_SIGMAS, margin_m

_FENCE_M = 1.5  # that plans keep from the fence
_QUARTER = 3  # edges of a circle's quarter
_GRAIN_M = 0.25  # of a circle that is smaller because the drone is in it, so that ways are not worked out anew at each step


class KeptHome(Struct, frozen=True):
    """A place to keep clear of, mission frame, and its error relative to this drone (1 sigma)."""

    place: Point2
    sigma_m: float = 0.0


class AroundHomes:
    """Ways of one drone; horizontal, mission frame."""

    def __init__(self, mission: MissionConfig) -> None:
        self._separation_m = mission.limits.separation_m
        self._room = Polygon(mission.area.polygon_m).buffer(mission.area.fence_margin_m - _FENCE_M)
        self._circles: tuple[tuple[Point2, float], ...] = ()
        self._detours = Detours(self._room)

    def way(self, here: Point2, there: Point2, homes: Sequence[KeptHome], deviation_m: float) -> Array:
        """Points (P, 2) of the shortest way, both ends included; straight where the homes leave none.

        As far from the homes as plans keep, or as both ends are. ``deviation_m``: RMS deviation of this drone from its plans.
        """
        keep_m = self._separation_m + margin_m(deviation_m, 0.0)
        widened = 1.0 / cos(0.25 * pi / _QUARTER)  # the corners of the polygon, so that its edges touch the circle
        circles = []
        for home in homes:
            free_m = min(dist(home.place, end) for end in (here, there)) / widened
            wanted_m = keep_m + DOUBT_SIGMAS * home.sigma_m
            radius_m = wanted_m if free_m > wanted_m else _GRAIN_M * floor(free_m / _GRAIN_M)
            circles += [(home.place, widened * radius_m)] if radius_m > 0.0 else []
        if tuple(circles) != self._circles:
            self._circles = tuple(circles)
            holes = [shapely.Point(place).buffer(radius_m, quad_segs=_QUARTER) for place, radius_m in circles]
            self._detours = Detours(shapely.difference(self._room, shapely.union_all(holes)))
        ends = np.array(here), np.array(there)
        return np.vstack((ends[0], self._detours.between(*ends), ends[1]))
