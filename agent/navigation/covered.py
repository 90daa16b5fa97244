"""Area covered by the swarm, from the coverage entries of the log. It is updated in small portions, so that the cost of a step is
bounded, however many entries arrive.

A swath is the strip along a flown path that counts as searched. Each drone's swaths are united in windows of time, the windows in
pairs, and so on up to the whole mission. So a new entry changes a few shapes of bounded size. Once the work is complete, the
result depends on the entries alone, not on their order. Of each drone and window only the first ``MOST_ENTRIES`` count. An entry
that no drone of this mission can have flown does not count at all.
"""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from radron.agent.motion.survey import MOST_POINTS, covered
from radron.protocol.entries import Coverage, EntryId

WINDOW_NS = 20_000_000_000
MOST_ENTRIES = 8  # counted entries per drone and window: one each 5 s, and more at jumps of its frame and restarts of its agent
MOST_WINDOWS = 4_320  # windows that count per drone: those of a day
_LEVELS = 13  # levels of united windows: 2^13 windows hold a day, from any first window
_TANGLED = 3.0  # a path longer than this times its extent crosses itself often: only some of its points count
_FEW_POINTS = 12
_TOLERANCE, _COARSE = 0.003, 0.05  # tolerance of simplified shapes, as a share of the swath; with over MOST_POINTS points
_CHEAP = 0.05  # cost of a shape that is taken over unchanged, relative to the union of two shapes

Path: TypeAlias = NDArray[np.float64]  # (K, 2), mission frame
Area: TypeAlias = Polygon | MultiPolygon


@dataclass(slots=True)
class _Drone:
    """Coverage of one drone.

    windows: entries of each window of time, in the order of their identities. shapes: united area by level and number; at level 0
        the number is the window, at the next level half of it, and so on. stale: numbers to be computed anew, by level.
    newest: the entry with the greatest identity.
    """

    windows: dict[int, list[tuple[EntryId, Coverage]]] = field(default_factory=dict)
    shapes: dict[tuple[int, int], Area] = field(default_factory=dict)
    stale: list[set[int]] = field(default_factory=lambda: [set() for _ in range(_LEVELS + 1)])
    newest: tuple[EntryId, Coverage] | None = None

    @property
    def whole(self) -> Area:
        tops = [shape for (level, _), shape in sorted(self.shapes.items(), key=lambda one: one[0]) if level == _LEVELS]
        return tops[0] if len(tops) == 1 else shapely.union_all(tops)


class Covered:
    """Area covered by all drones.

    ``path_of``: returns an entry's path in the mission frame, None while its frame is not known; ``swath_m``: width of all
    swaths, by the mission; ``longest_m``: longest path that one entry can have.
    """

    def __init__(self, path_of: Callable[[Coverage], Path | None], swath_m: float, longest_m: float) -> None:
        self._path_of = path_of
        self._swath_m, self._longest_m = swath_m, longest_m
        self._since_ns = 0
        self._drones: dict[str, _Drone] = {}
        self._turn = 0

    def begin(self, since_ns: int) -> None:
        """Count only entries stamped from ``since_ns`` on: a source may have come into an area that was searched earlier."""
        self._since_ns = since_ns
        kept = [entry for drone in self._drones.values() for held in drone.windows.values() for _, entry in held]
        self._drones = {}
        for entry in kept:
            self.take(entry)

    def take(self, entry: Coverage) -> None:
        """Add a coverage entry of the log; the order does not matter. It replaces an entry with the same identity."""
        if entry.stamp_ns < self._since_ns or not self._plausible(entry):
            return
        drone, window = self._drones.setdefault(entry.drone, _Drone()), entry.stamp_ns // WINDOW_NS
        held = drone.windows.get(window)
        if held is None:
            if len(drone.windows) >= MOST_WINDOWS:
                return
            held = drone.windows[window] = []
        identity = entry.entry_id
        held[:] = [one for one in held if one[0] != identity]
        insort(held, (identity, entry), key=lambda one: one[0])
        del held[MOST_ENTRIES:]
        if drone.newest is None or identity >= drone.newest[0]:
            drone.newest = identity, entry
        drone.stale[0].add(window)

    def recount(self, drone: str, entries: Iterable[Coverage]) -> None:
        """Replace all coverage of a drone by these entries."""
        self._drones.pop(drone, None)
        for entry in entries:
            self.take(entry)

    def moved(self, drone: str, from_ns: int) -> None:
        """Note that the estimate of a drone's frame has changed for stamps from ``from_ns`` on."""
        found = self._drones.get(drone)
        if found is not None:
            found.stale[0].update(window for window in found.windows if window >= from_ns // WINDOW_NS)

    def work(self, portion: float) -> None:
        """Update about ``portion`` shapes, of one drone after the other; each takes a millisecond or two."""
        names = sorted(self._drones)
        idle = 0
        while portion > 0.0 and idle < len(names):
            self._turn += 1
            cost = self._renew(self._drones[names[self._turn % len(names)]])
            portion -= cost
            idle = 0 if cost else idle + 1

    @property
    def pending(self) -> bool:
        """Whether coverage is left that ``area`` does not account for yet."""
        return any(level for drone in self._drones.values() for level in drone.stale)

    @property
    def area(self) -> Area:
        """The covered area, mission frame, as far as it has been computed."""
        found: Area = shapely.union_all([self._drones[name].whole for name in sorted(self._drones)])
        return found

    def end(self, drone: str) -> tuple[float, float] | None:
        """Return the last point of a drone's newest path, mission frame; None without a path, or while its frame is not known."""
        found = self._drones.get(drone)
        path = self._path_of(found.newest[1]) if found is not None and found.newest is not None else None
        return (float(path[-1, 0]), float(path[-1, 1])) if path is not None else None

    def _plausible(self, entry: Coverage) -> bool:
        """Whether a drone of this mission can have flown the entry's path, by its width, its length, and points a metre apart."""
        length_m = sum(math.dist(one, other) for one, other in zip(entry.path_m, entry.path_m[1:], strict=False))
        return abs(entry.swath_m - self._swath_m) < 1e-6 and length_m <= self._longest_m and len(entry.path_m) <= length_m + 2.0

    def _renew(self, drone: _Drone) -> float:
        """Compute one outdated shape of a drone, those of windows first. Return the cost, in shapes; 0 if none is outdated."""
        level = next((level for level, stale in enumerate(drone.stale) if stale), None)
        if level is None:
            return 0.0
        number = drone.stale[level].pop()
        if level < _LEVELS:
            drone.stale[level + 1].add(number // 2)
        if level == 0:
            drone.shapes[0, number] = self._united([entry for _, entry in drone.windows[number]])
            return 1.0
        halves = [drone.shapes.get((level - 1, half)) for half in (2 * number, 2 * number + 1)]
        pair = [half for half in halves if half is not None]
        if len(pair) == 1:
            drone.shapes[level, number] = pair[0]
            return _CHEAP
        drone.shapes[level, number] = self._simple(shapely.union_all(pair))
        return 1.0

    def _simple(self, shape: Area) -> Area:
        tolerance = _TOLERANCE if shapely.get_num_coordinates(shape) <= MOST_POINTS else _COARSE
        simple: Area = shapely.simplify(shape, tolerance * self._swath_m)
        return simple

    def _united(self, entries: list[Coverage]) -> Area:
        paths = [_untangled(path) for path in map(self._path_of, entries) if path is not None]
        return self._simple(covered([(path, self._swath_m) for path in paths]))


def _untangled(path: Path) -> Path:
    """Return the path, or a few of its points if it often crosses itself: the cost of its shape grows with the crossings."""
    steps = np.diff(path, axis=0)
    extent_m = float(np.hypot(*np.ptp(path, axis=0)))
    if len(path) <= _FEW_POINTS or float(np.hypot(*steps.T).sum()) <= _TANGLED * extent_m:
        return path
    few: Path = path[np.linspace(0, len(path) - 1, _FEW_POINTS).round().astype(int)]
    return few
