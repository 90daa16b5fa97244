"""Pixel hits -> clusters: hits that touch (8 neighbours) and follow each other within a time gap.

There are two algorithms with equal results (held equal by the tests). The few hits of one readout are clustered event by event,
many hits by sorting with a sparse graph.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from radron.agent.detector.readout import PIXEL_PITCH_MM, SATURATED_TOT, SENSOR_PIXELS, PixelHits

FEW = 500  # up to this number of hits the event-by-event algorithm is faster
_STRIDE = SENSOR_PIXELS + 2  # of a row in the padded matrix, so that no neighbour lies across an edge
_AROUND = tuple(row * _STRIDE + column for row in (-1, 0, 1) for column in (-1, 0, 1) if (row, column) != (0, 0))
_CELLS = _STRIDE * (SENSOR_PIXELS + 2)
_CENTRE = (SENSOR_PIXELS - 1) / 2.0


class Cluster(NamedTuple):
    """A cluster: touching pixel hits, close in time, that come from one particle. Camera frame, mm; ticks are steps of 25/16 ns.

    tick: time of the earliest hit; pixels: number of hits; x_mm, y_mm: energy-weighted position; delay: ticks from the earliest
    hit to the energy-weighted mean time of arrival. saturated: the counter of at least one hit was full, so that the energy is a
    lower bound.
    """

    tick: int
    energy_kev: float
    pixels: int
    x_mm: float
    y_mm: float
    delay: float
    saturated: bool = False


class Clusters(Struct, frozen=True):
    """N clusters as arrays (N,), in the order of their earliest hits; fields as in ``Cluster``."""

    tick: NDArray[np.int64]
    energy_kev: NDArray[np.float64]
    pixels: NDArray[np.int64]
    x_mm: NDArray[np.float64]
    y_mm: NDArray[np.float64]
    delay: NDArray[np.float64]
    saturated: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.tick)

    def take(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Clusters:
        """Return the clusters that a mask or indices select."""
        return Clusters(*(column[which] for column in self._columns))

    def each(self) -> list[Cluster]:
        """Return the clusters one by one, as a list of ``Cluster`` objects."""
        return [Cluster(*row) for row in zip(*(column.tolist() for column in self._columns), strict=True)]

    @property
    def _columns(self) -> tuple[NDArray[Any], ...]:
        return self.tick, self.energy_kev, self.pixels, self.x_mm, self.y_mm, self.delay, self.saturated


def cluster_few(hits: PixelHits, energy_kev: NDArray[np.float64], gap_ticks: float) -> Clusters:
    """Group pixel hits into clusters: touching pixels (8 neighbours) that are hit at most ``gap_ticks`` apart.

    hits: sorted by tick. energy_kev: (N,) energy of each of the N hits.
    """
    return _clusters(hits, energy_kev, *_labels_by_event(hits.tick, hits.index, gap_ticks))


def cluster_many(hits: PixelHits, energy_kev: NDArray[np.float64], gap_ticks: float) -> Clusters:
    """Group pixel hits into clusters with the same result and arguments as ``cluster_few``, faster for many hits."""
    return _clusters(hits, energy_kev, *_labels(hits.tick, hits.index, gap_ticks))


def _clusters(hits: PixelHits, energy_kev: NDArray[np.float64], label: NDArray[np.intp], count: int) -> Clusters:
    """Clusters from the sums over the hits (N,) with each label."""
    tick, index = hits.tick, hits.index
    first = _first(label, count)
    first.sort()  # in order of time, like the hits
    place = np.empty(count, np.intp)
    place[label[first]] = np.arange(count)
    label = place[label]
    earliest = tick[first]
    energy = _sum_by(label, energy_kev, count)
    return Clusters(
        tick=earliest,
        energy_kev=energy,
        pixels=np.bincount(label, minlength=count),
        x_mm=(_sum_by(label, energy_kev * (index & 255), count) / energy - _CENTRE) * PIXEL_PITCH_MM,
        y_mm=(_sum_by(label, energy_kev * (index >> 8), count) / energy - _CENTRE) * PIXEL_PITCH_MM,
        delay=_sum_by(label, energy_kev * (tick - earliest[label]), count) / energy,
        saturated=np.bincount(label[hits.tot >= SATURATED_TOT], minlength=count) > 0,
    )


def _labels_by_event(tick: NDArray[np.int64], index: NDArray[np.uint16], gap_ticks: float) -> tuple[NDArray[np.intp], int]:
    """Cluster labels of the hits, and their count; hits further apart than the gap begin another event."""
    times: list[int] = tick.tolist()
    cells: list[int] = (index + 2 * (index >> 8).astype(np.int64)).tolist()
    ends: list[int] = ((tick[1:] - tick[:-1] > gap_ticks).nonzero()[0] + 1).tolist()
    labels: list[int] = []
    start = count = 0
    for end in (*ends, len(times)) if times else ():
        if times[end - 1] - times[start] <= gap_ticks:
            own, number = _flooded(cells[start:end])
        else:  # a pile-up: so long that touching hits may be too far apart in time
            found, number = _labels(tick[start:end], index[start:end], gap_ticks)
            own = found.tolist()
        labels += [count + label for label in own] if number > 1 else [count] * (end - start)
        count += number
        start = end
    return np.array(labels, np.intp), count


def _flooded(cells: list[int]) -> tuple[list[int], int]:
    """Like ``_labels`` for hits (N,) that are all within the gap, so that only their cells in the padded matrix matter."""
    left = set(cells)
    parts: list[list[int]] = []
    while left:
        part = [left.pop()]
        for cell in part:  # grows during the loop
            if not left:
                break
            for step in _AROUND:
                if cell + step in left:
                    left.remove(cell + step)
                    part.append(cell + step)
        parts.append(part)
    if len(parts) == 1:
        return [0] * len(cells), 1
    labels = {cell: label for label, part in enumerate(parts) for cell in part}
    return [labels[cell] for cell in cells], len(parts)


def _labels(tick: NDArray[np.int64], index: NDArray[np.uint16], gap_ticks: float) -> tuple[NDArray[np.intp], int]:
    """Cluster labels of the hits, and their count.

    Hits are sorted by (burst, row, column), where hits further apart than the gap belong to different bursts. Neighbours then
    follow each other directly, or begin at a place that a binary search finds.
    """
    n = len(tick)
    pixel = index.astype(np.int64)
    burst = np.zeros(n, np.int64)
    np.cumsum(np.diff(tick) > gap_ticks, out=burst[1:])
    key = burst * _CELLS + pixel + 2 * (pixel >> 8)
    order = np.argsort(key, kind="stable")
    key = key[order]
    times = tick[order]
    sources = [np.empty(0, np.intp)]
    targets = [np.empty(0, np.intp)]
    next_row = np.searchsorted(key, key + (_STRIDE - 1))
    for start, reach in ((np.arange(1, n + 1), 1), (next_row, _STRIDE + 1)):
        here = np.flatnonzero(start < n)
        there = start[here]
        while len(here):
            near = key[there] <= key[here] + reach
            here, there = here[near], there[near]
            close = np.abs(times[there] - times[here]) <= gap_ticks
            sources.append(here[close])
            targets.append(there[close])
            there = there + 1
            inside = there < n
            here, there = here[inside], there[inside]
    source = np.concatenate(sources)
    graph = csr_array((np.ones(len(source), np.int8), (source, np.concatenate(targets))), shape=(n, n))
    count, component = connected_components(graph, directed=False)
    label = np.empty(n, np.intp)
    label[order] = component
    return label, count


def _first(label: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """The first hit of each cluster, (count,)."""
    first = np.empty(count, np.intp)
    first[label[::-1]] = np.arange(len(label) - 1, -1, -1)  # the last one written is the first hit
    return first


def _sum_by(label: NDArray[np.intp], values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Sums of the values (N,) by label, (count,)."""
    sums: NDArray[np.float64] = np.bincount(label, values, count).astype(np.float64, copy=False)
    return sums
