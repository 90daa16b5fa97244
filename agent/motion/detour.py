"""Shortest paths between two points inside an area."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from shapely import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

_EPS_M = 1e-4  # paths may leave the area by this much: they touch corners, and coordinates are rounded


class Detours:
    """Shortest paths inside an area, around its corners if needed, by a visibility graph over its inward (reflex) corners. The
    graph is built when it is first needed.
    """

    def __init__(self, area: Polygon | MultiPolygon) -> None:
        self._area = area
        self._tolerant = area.buffer(_EPS_M, join_style="mitre")
        shapely.prepare(self._tolerant)
        self._graph: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def between(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the corners (P, 2) of the shortest path from ``start`` (2,) to ``end`` (2,), without these two. (0, 2) if the
        straight line is free, or if no path inside the area connects the two.
        """
        if self._sees(start[None], end[None])[0]:
            return np.empty((0, 2))
        corners, lengths = self._corners()
        nodes = np.concatenate([start[None], end[None], corners])
        count = len(nodes)
        distances = np.full((count, count), np.inf)
        distances[2:, 2:] = lengths
        for number in (0, 1):
            seen = self._sees(np.broadcast_to(nodes[number], corners.shape), corners)
            reach = np.where(seen, np.hypot(*(corners - nodes[number]).T), np.inf)
            distances[number, 2:] = reach
            distances[2:, number] = reach
        _, previous = dijkstra(distances, indices=0, return_predecessors=True)
        way: list[int] = []
        node = int(previous[1])
        while node > 0:
            way.append(node)
            node = int(previous[node])
        return nodes[way[::-1]]

    def _sees(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.bool_]:
        lines = shapely.linestrings(np.stack([start, end], axis=1))
        seen: NDArray[np.bool_] = np.atleast_1d(shapely.covers(self._tolerant, lines))
        return seen

    def _corners(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the reflex corners (C, 2), and the distances (C, C) between those in view of each other; infinite for others."""
        if self._graph is None:
            corners = np.concatenate([_inward_corners(part) for part in shapely.get_parts(self._area)])
            first, second = np.triu_indices(len(corners), k=1)
            seen = self._sees(corners[first], corners[second]) if len(first) else np.zeros(0, dtype=bool)
            lengths = np.full((len(corners), len(corners)), np.inf)
            reach = np.where(seen, np.hypot(*(corners[first] - corners[second]).T), np.inf)
            lengths[first, second] = reach
            lengths[second, first] = reach
            self._graph = corners, lengths
        return self._graph


def _inward_corners(part: Polygon) -> NDArray[np.float64]:
    """Return the reflex corners (C, 2) of a polygon: those at which a path may have to turn."""
    oriented = orient(part)  # exterior counter-clockwise, holes clockwise: the area is on the left
    found = []
    for ring in (oriented.exterior, *oriented.interiors):
        points = shapely.get_coordinates(ring)[:-1]
        before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
        found.append(points[before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < 0.0])
    return np.concatenate(found)
