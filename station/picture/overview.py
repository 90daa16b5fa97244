"""Course of a whole flight in coarse steps, for charts and tracks on the web page: a row each second, fewer for long flights."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right

from radron.station.picture.frame import Frame, Point

MAX_OVERVIEW_ROWS = 600  # of a flight: more than a chart has columns
TRAIL_MS = 60_000

Row = list[int | list[float | None] | None]


class Overview:
    """Stores the course of a flight: for each second the source's position and RMS error, and each drone's position and hit rate.

    Positions are in the mission frame, metres. In memory a row is a time and three numbers for the source and for each drone, NaN
    if unknown.
    """

    def __init__(self, drones: int) -> None:
        """``drones``: number of drones."""
        self._width = 3 * (1 + drones)
        self._at_ms = array("q")
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._at_ms)

    def add(self, frame: Frame) -> None:
        """Append the row for a state of the swarm."""
        self._at_ms.append(frame.at_ms)
        source = frame.source
        self._values.extend((*source.place[:2], round(source.rms_m, 3)) if source is not None else _UNKNOWN)
        for drone in frame.drones:
            hits = drone.rates_ps[0] if drone.rates_ps is not None else math.nan
            self._values.extend((*drone.place[:2], hits) if drone.place is not None else _UNKNOWN)

    def row(self, place: int) -> Row:
        """Return the row with the index ``place`` for the web page; unknown values are None."""
        values = self._values[place * self._width : (place + 1) * self._width].tolist()
        row: Row = [self._at_ms[place]]
        row += [None if math.isnan(x) else [x, y, _known(last)] for x, y, last in zip(*3 * [iter(values)], strict=True)]
        return row

    def rows(self) -> list[Row]:
        """Return the whole flight in about ``MAX_OVERVIEW_ROWS`` rows, with the newest row last."""
        last = len(self) - 1
        step = max(1, -(-last // MAX_OVERVIEW_ROWS))
        return [self.row(place) for place in (*range(0, last, step), last) if place >= 0]

    def trails(self, at_ms: int) -> list[list[Point]]:
        """Return the positions of each drone in the minute before a time (ms)."""
        first, behind = bisect_right(self._at_ms, at_ms - TRAIL_MS), bisect_right(self._at_ms, at_ms)
        trails: list[list[Point]] = []
        for column in range(3, self._width, 3):
            starts = range(first * self._width + column, behind * self._width, self._width)
            places = ((self._values[start], self._values[start + 1]) for start in starts)
            trails.append([place for place in places if not math.isnan(place[0])])
        return trails


_UNKNOWN = (math.nan, math.nan, math.nan)


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value
