"""Flight along a survey path: the progress of a drone along it, and the reference at constant speed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_LEAD_IN_M = 2.0  # a drone nearer to the path than this is not led to it: the reference lies on the path
_SHORTEST_M = 0.1  # a shorter path is a single point to stay at
_REACH_M = 3.0  # greatest progress in one update: more than a drone flies, less than the distance to a neighbouring lane


class PathFollower:
    """Path of straight legs that a drone flies at constant speed, as a function of the arc length (m flown along the path).

    At its end the path reverses, and again at its begin, so arc lengths are unbounded. The caller keeps the progress; the object
    does not change. Positions are horizontal, metres. Corners are not rounded: the tracker does that.
    """

    def __init__(self, path: NDArray[np.float64]) -> None:
        """Set up the path (M, 2) with M >= 1 points, which may repeat. A path shorter than 0.1 m is reduced to its first point.

        Raises:
            ValueError: another shape.
        """
        if path.ndim != 2 or path.shape[1] != 2 or len(path) == 0:
            raise ValueError(f"a path needs the shape (M, 2) with M >= 1, this one has {path.shape}")
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
        if lengths[-1] < _SHORTEST_M:
            path, lengths = path[:1], lengths[:1]
        moved = np.concatenate([[True], np.diff(lengths) > 0.0])  # adjoining lanes may be apart by less than the sum resolves
        self._points = path[moved]
        self._lengths = lengths[moved]
        self._x, self._y = np.ascontiguousarray(self._points[:, 0]), np.ascontiguousarray(self._points[:, 1])
        self._legs: list[tuple[float, float, float, float, float]] = [  # start, unit vector, length
            (x, y, (x_next - x) / length, (y_next - y) / length, length)
            for (x, y), (x_next, y_next), length in zip(
                self._points[:-1].tolist(), self._points[1:].tolist(), np.diff(self._lengths).tolist(), strict=True
            )
        ]
        self._starts: list[float] = self._lengths.tolist()

    @property
    def length_m(self) -> float:
        """Length (m) of the survey path, one way."""
        return self._starts[-1]

    def at(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points (K, 2) at K arc lengths s (K,), reflected at both ends of the path."""
        folded = self.length_m - np.abs(self.length_m - np.mod(s, 2.0 * self.length_m)) if self._legs else np.zeros_like(s)
        return np.stack([np.interp(folded, self._lengths, self._x), np.interp(folded, self._lengths, self._y)], axis=1)

    def advance(self, s: float, position: Sequence[float], reach_m: float = _REACH_M) -> float:
        """Return the progress (arc length, m) along the path of a drone at ``position`` whose progress was ``s``.

        The progress is the nearest point of the path between s and s + ``reach_m``. This window keeps a drone from skipping to
        the next lane, or across the end of the path. There the way out and the way back are equally near.
        """
        best, best_gap = s, math.inf
        for begin, x, y, dx, dy, length in self._legs_from(s, s + reach_m):
            along = (position[0] - x) * dx + (position[1] - y) * dy
            along = min(max(along, s - begin, 0.0), length, s + reach_m - begin)
            gap = math.hypot(x + along * dx - position[0], y + along * dy - position[1])
            if gap < best_gap:
                best, best_gap = begin + along, gap
        return best

    def reference(
        self, s: float, position: Sequence[float], speed_mps: float, steps: int, step_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the reference now and at the next ``steps`` steps, at constant speed along the path from arc length ``s`` on.

        A drone that is off the path is first led back to it, straight and at that speed. ``position`` should be the planned
        position, which the vehicle follows with a lag: a reference from the measured position would slow down the plan.

        Returns:
            Positions (steps + 1, 2) and velocities (steps + 1, 2), each velocity the difference to the next position per step.
        """
        travel = speed_mps * step_s * np.arange(steps + 2, dtype=np.float64)
        entry = self.at(np.array([s]))[0]
        here = np.array([position[0], position[1]])
        gap = math.hypot(entry[0] - here[0], entry[1] - here[1])
        if gap <= _LEAD_IN_M:
            points = self.at(s + travel)
        else:
            points = self.at(s + np.maximum(travel - gap, 0.0))
            before = travel < gap
            points[before] = here + (entry - here) * (travel[before, None] / gap)
        return points[:-1], np.diff(points, axis=0) / step_s

    def _legs_from(self, low: float, high: float) -> list[tuple[float, float, float, float, float, float]]:
        """Return the legs that overlap the arc lengths [low, high], in the order of the flight: arc length at the start, start,
        unit vector, length.
        """
        if not self._legs:
            return []
        found = []
        lap = math.floor(low / self.length_m)
        while lap * self.length_m <= high:
            base = lap * self.length_m
            for number, (x, y, dx, dy, length) in enumerate(self._legs if lap % 2 == 0 else self._legs[::-1]):
                leg_start = self._starts[number] if lap % 2 == 0 else self.length_m - self._starts[len(self._legs) - number]
                if base + leg_start + length < low or base + leg_start > high:
                    continue
                if lap % 2 == 0:
                    found.append((base + leg_start, x, y, dx, dy, length))
                else:
                    found.append((base + leg_start, x + dx * length, y + dy * length, -dx, -dy, length))
            lap += 1
        return found
