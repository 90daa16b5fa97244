"""Geofence of a drone: a simple polygon, convex or not, with floor and ceiling."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np
import shapely

from radron.agent.config.mission import AreaConfig
from radron.agent.errors import ConfigError
from radron.agent.geometry import Array

_PIECES = 12  # greatest number of half-planes of a convex part
_SIMPLIFY_M = 0.5  # tolerance with which the round corners of the widened area are simplified


class Fence:
    """Geofence of a drone: a polygon in the planning frame, with a range of heights, metres.

    The planner needs convex constraints: ``half_planes`` gives a convex part of the polygon around a position; a convex polygon
    is returned whole.
    """

    def __init__(self, outline: shapely.Polygon, floor_m: float, ceiling_m: float) -> None:
        """Set up the fence. Raises ConfigError if the outline is empty or crosses itself, or if the floor is not below the
        ceiling.

        ``outline``: holes are ignored.
        """
        if not outline.is_valid or outline.area <= 0.0:
            raise ConfigError("fence: the outline is not a simple polygon; check area.polygon_m")
        if floor_m >= ceiling_m:
            raise ConfigError(f"fence: floor_m = {floor_m:g} must be below ceiling_m = {ceiling_m:g}")
        self.outline = shapely.Polygon(outline.exterior)
        self._boundary = self.outline.exterior
        shapely.prepare(self.outline)
        shapely.prepare(self._boundary)
        self.floor_m, self.ceiling_m = floor_m, ceiling_m
        corners = np.asarray(self.outline.exterior.normalize().coords)[:-1]
        if not self.outline.exterior.normalize().is_ccw:
            corners = corners[::-1]
        self._starts: Array = corners  # (E, 2)
        self._edges: Array = np.roll(corners, -1, axis=0) - corners
        lengths = np.hypot(self._edges[:, 0], self._edges[:, 1])
        inward = np.column_stack((-self._edges[:, 1], self._edges[:, 0])) / lengths[:, None]
        offsets = np.einsum("ij,ij->i", inward, corners)
        convex = bool((corners @ inward.T >= offsets - 1e-6).all())
        self._planes: tuple[Array, Array] | None = (inward, offsets) if convex else None

    @classmethod
    def from_area(
        cls, area: AreaConfig, points: Sequence[tuple[float, float]] | Array | None = None, ground_m: float = 0.0
    ) -> Fence:
        """Return the fence around a mission's area: the area widened by its margin.

        Args:
            area: area, margin, floor and ceiling of the mission.
            points: corners (N, 2) of the area in the planning frame; None: the planning frame is the mission frame.
            ground_m: z of the ground in the planning frame, from which floor and ceiling count.
        """
        polygon = shapely.Polygon(area.polygon_m if points is None else points)
        outline = polygon.buffer(area.fence_margin_m, quad_segs=4).simplify(_SIMPLIFY_M) if area.fence_margin_m > 0.0 else polygon
        return cls(outline, area.floor_m + ground_m, area.ceiling_m + ground_m)

    def clearance(self, x: float, y: float) -> float:
        """Return the horizontal distance (m) of a place from the fence: positive inside, negative outside."""
        distance = float(self._boundary.distance(shapely.Point(x, y)))
        return distance if shapely.contains_xy(self.outline, x, y) else -distance

    def half_planes(self, x: float, y: float) -> tuple[Array, Array]:
        """Return a convex part of the polygon around (x, y) as M half-planes n . p >= b: inward normals n (M, 2), offsets b (M,).

        In a non-convex polygon, the nearest point of the boundary gives the first half-plane. The boundary behind it is cut off,
        and the rest gives the next one in the same way. For a place outside, there is one half-plane, at the nearest boundary.
        The clipping is written by hand: with shapely's intersections, the part of an L-shaped fence takes 2.1 times as long.
        """
        if self._planes is not None:
            return self._planes
        place = np.array([x, y])
        if not shapely.contains_xy(self.outline, x, y):
            return self._way_in(place)
        normals, offsets = [], []
        starts, ends = self._starts, self._starts + self._edges
        for _ in range(_PIECES):
            near = _nearest(place, starts, ends)
            gaps = np.hypot(near[:, 0] - x, near[:, 1] - y)
            first = int(gaps.argmin())
            normal = (place - near[first]) / max(float(gaps[first]), 1e-9)
            offset = float(normal @ near[first])
            normals.append(normal)
            offsets.append(offset)
            starts, ends = _in_front(starts, ends, normal, offset)
            if len(starts) == 0:
                break
        return np.array(normals), np.array(offsets)

    def _way_in(self, place: Array) -> tuple[Array, Array]:
        nearest = shapely.get_coordinates(shapely.shortest_line(self._boundary, shapely.Point(place)))[0]
        inward = (nearest - place) / max(hypot(*(nearest - place)), 1e-9)
        return inward[None, :], np.array([float(inward @ nearest)])


def _nearest(place: Array, starts: Array, ends: Array) -> Array:
    """Return the point of each edge that is nearest to a place (2,): (E, 2)."""
    edges = ends - starts
    along = np.einsum("ij,ij->i", place - starts, edges) / np.maximum(np.einsum("ij,ij->i", edges, edges), 1e-12)
    points: Array = starts + np.clip(along, 0.0, 1.0)[:, None] * edges
    return points


def _in_front(starts: Array, ends: Array, normal: Array, offset: float) -> tuple[Array, Array]:
    """Return the parts of the edges in the half-plane n . p > b, as starts and ends, (E', 2) each."""
    first, last = starts @ normal - offset, ends @ normal - offset
    keep = np.maximum(first, last) > 1e-6
    starts, ends, first, last = starts[keep], ends[keep], first[keep], last[keep]
    share = np.where((first < 0.0) | (last < 0.0), first / np.where(first == last, 1.0, first - last), 0.0)[:, None]
    crossing = starts + share * (ends - starts)
    return np.where((first < 0.0)[:, None], crossing, starts), np.where((last < 0.0)[:, None], crossing, ends)
