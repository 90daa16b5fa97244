"""The fence in one drone's own local frame, and where that frame is not known, around where it waits."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace
from shapely import Point

from agent.config import AreaConfig
from agent.motion.fence import Fence
from agent.motion.reference import Array
from agent.ownframe import OwnFrame
from agent.vehicle.interface import VehicleState

_DOUBT_SIGMAS = 2.0  # as in agent.motion.separation
_LEAST_MARGIN_M = 5.0  # of the fence, however little is known of where the drone is
_MOVED_M = 0.3  # by which the fence may be elsewhere in the local frame before it is put there
_WAITING_M = 12.0  # about a drone that does not know its frame


class OwnFence:
    """Put where the area lies in the local frame, and put anew as that comes to be known better."""

    def __init__(self, area: AreaConfig, own: OwnFrame) -> None:
        self._area = area
        self._own = own
        self._corners = np.array([(x, y, 0.0) for x, y in area.polygon_m])
        self._outlined: tuple[Array, float] | None = None  # corners (N, 2) and margin of the fence that was put; none: it waits
        self._level_m = 0.0

    def put(self, vehicle: VehicleState, level_m: float) -> Fence:
        """The fence where the drone takes over; ``level_m``: local z from which its heights count."""
        self._level_m = level_m
        return self._made(vehicle)

    def moved(self, vehicle: VehicleState) -> Fence | None:
        """The fence where it is by now, if that differs."""
        if (self._outlined is not None) is self._own.is_known:
            if self._outlined is None or self._own.mission_from_local.covariance is None:
                return None
            corners, margin_m = self._outlined
            newest, newest_margin_m = self._outline(vehicle)
            if max(float(np.abs(newest - corners).max()), abs(newest_margin_m - margin_m)) < _MOVED_M:
                return None
        return self._made(vehicle)

    def _outline(self, vehicle: VehicleState) -> tuple[Array, float]:
        """The area's corners (N, 2) in the local frame; and the fence's margin, less what is doubted of where the vehicle is."""
        margin_m = self._area.fence_margin_m
        if self._own.mission_from_local.covariance is not None:
            doubted_m = margin_m - _DOUBT_SIGMAS * self._own.sigma_m(vehicle)
            margin_m = max(doubted_m, min(margin_m, _LEAST_MARGIN_M))
        return self._own.local_from_mission.apply(self._corners)[:, :2], margin_m

    def _made(self, vehicle: VehicleState) -> Fence:
        area, level_m = self._area, self._level_m
        if not self._own.is_known:
            self._outlined = None
            return Fence(Point(vehicle.position_m[:2]).buffer(_WAITING_M), area.floor_m + level_m, area.ceiling_m + level_m)
        corners, margin_m = self._outlined = self._outline(vehicle)
        return Fence.from_area(replace(area, fence_margin_m=margin_m), corners, ground_m=level_m)
