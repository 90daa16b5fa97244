"""Fence in one drone's local frame; while that frame is not known, a circle around the waiting drone."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace
from shapely import Point, Polygon

from radron.agent.config.mission import AreaConfig
from radron.agent.geometry import Array
from radron.agent.localization.ownpose import LocalFrame, OwnPose
from radron.agent.motion.fence import Fence
from radron.agent.motion.separation import DOUBT_SIGMAS
from radron.agent.vehicle.interface import VehicleState

_LEAST_MARGIN_M = 5.0  # the fence stays at least this far outside of the area, however uncertain the own position is
_MOVED_M = 0.3  # smaller shifts of the fence in the local frame, or of its heights, are not applied
_WAITING_M = 12.0  # radius of the fence around a drone with an unknown frame
_ROOM_M = 4.0  # a fence into which no circle of this radius fits is too small for a flight


class OwnFence:
    """Fence around the mission's area, in the local frame. It moves as the estimate of that frame improves, or its height drifts.

    With two position hypotheses, the drone stays inside the fence by both.
    """

    def __init__(self, area: AreaConfig, own: OwnPose) -> None:
        self._area = area
        self._own = own
        self._corners = np.array([(x, y, 0.0) for x, y in area.polygon_m])
        self._outlined: tuple[Array, float] | None = None  # corners (N, 2) and margin of the present fence; None: the drone waits
        self._level_m = 0.0

    def put(self, vehicle: VehicleState, level_m: float) -> Fence:
        """Return the fence for a flight that begins at the vehicle; ``level_m``: local z of the fence's height 0, m."""
        self._level_m = level_m
        return self._made(vehicle)

    def moved(self, vehicle: VehicleState, level_m: float) -> Fence | None:
        """Return the fence by the newest estimate of frame and ground; None while it differs from the present one by less than
        0.3 m.

        The height of an autopilot's frame drifts, by metres in a long flight; the ground's height in that frame drifts with it.
        """
        frame = self._own.frame
        if abs(level_m - self._level_m) >= _MOVED_M:
            return self.put(vehicle, level_m)
        if self._outlined is not None and frame is not None:
            if frame.mission_from_local.covariance is None:
                return None
            corners, margin_m = self._outlined
            newest, newest_margin_m = self._outline(frame)
            if max(float(np.abs(newest - corners).max()), abs(newest_margin_m - margin_m)) < _MOVED_M:
                return None
        elif self._outlined is None and frame is None:
            return None
        return self._made(vehicle)

    def _outline(self, frame: LocalFrame) -> tuple[Array, float]:
        """Return the area's corners (N, 2) in the local frame, and the distance (m) from the area out to the fence, reduced by
        the position uncertainty.
        """
        margin_m = self._area.fence_margin_m
        if frame.mission_from_local.covariance is not None:
            sigma_m = (
                self._own.sigma_m if self._own.otherwise is None else 0.0
            )  # the other fence accounts for a second hypothesis
            doubted_m = margin_m - DOUBT_SIGMAS * sigma_m
            margin_m = max(doubted_m, min(margin_m, _LEAST_MARGIN_M))
        return frame.local_from_mission.apply(self._corners)[:, :2], margin_m

    def _made(self, vehicle: VehicleState) -> Fence:
        area, level_m, frame = self._area, self._level_m, self._own.frame
        if frame is None:
            self._outlined = None
            return Fence(Point(vehicle.position_m[:2]).buffer(_WAITING_M), area.floor_m + level_m, area.ceiling_m + level_m)
        corners, margin_m = self._outlined = self._outline(frame)
        fence = Fence.from_area(replace(area, fence_margin_m=margin_m), corners, ground_m=level_m)
        otherwise = self._own.otherwise
        if otherwise is None:
            return fence
        other = Fence.from_area(area, otherwise.inverse().apply(self._corners)[:, :2], ground_m=level_m)
        both = fence.outline & other.outline
        roomy = isinstance(both, Polygon) and not both.buffer(-_ROOM_M).is_empty
        return Fence(both, fence.floor_m, fence.ceiling_m) if roomy else fence
