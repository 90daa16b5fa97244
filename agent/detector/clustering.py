"""Pixel hits -> clusters: hits that touch (8 neighbours) and follow each other within a time gap.

Two implementations of the same relation: a union-find over a dictionary for the few hits of one readout, which costs no NumPy
call, and sorting with a sparse graph for many. The tests hold them equal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from agent.detector.readout import PIXEL_PITCH_MM, SENSOR_PIXELS

_FEW = 150  # hits, up to which the dictionary is faster
_STRIDE = SENSOR_PIXELS + 2  # of a row in the padded matrix, so that no neighbour lies across an edge
_CELLS = _STRIDE * (SENSOR_PIXELS + 2)
_CENTRE = (SENSOR_PIXELS - 1) / 2.0


@dataclass(frozen=True, slots=True)
class Clusters:
    """Clusters in the order of their earliest hit. Camera frame, mm; ticks are steps of 25/16 ns.

    tick: (N,) int64, the earliest hit; energy_kev: (N,); pixels: (N,) int64, hits in it;
    x_mm, y_mm: (N,) energy-weighted; delay: (N,) ticks from the earliest hit to the energy-weighted mean time of arrival.
    """

    tick: NDArray[np.int64]
    energy_kev: NDArray[np.float64]
    pixels: NDArray[np.int64]
    x_mm: NDArray[np.float64]
    y_mm: NDArray[np.float64]
    delay: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.tick)

    def take(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Clusters:
        """Some of the clusters."""
        return Clusters(
            self.tick[which], self.energy_kev[which], self.pixels[which], self.x_mm[which], self.y_mm[which], self.delay[which]
        )


def cluster(tick: NDArray[np.int64], index: NDArray[np.uint16], energy_kev: NDArray[np.float64], gap_ticks: float) -> Clusters:
    """Clusters of the hits, whose arrays (N,) are sorted by tick. Hits that touch join when at most ``gap_ticks`` apart."""
    label, count = (labels_of_few if len(tick) <= _FEW else labels_of_many)(tick, index, gap_ticks)
    row = index >> 8
    column = index & 255
    energy = sum_by(label, energy_kev, count)
    first = np.empty(count, np.intp)
    first[label[::-1]] = np.arange(len(tick) - 1, -1, -1)  # the last one written is the earliest
    earliest = tick[first]
    return Clusters(
        tick=earliest,
        energy_kev=energy,
        pixels=np.bincount(label, minlength=count),
        x_mm=(sum_by(label, energy_kev * column, count) / energy - _CENTRE) * PIXEL_PITCH_MM,
        y_mm=(sum_by(label, energy_kev * row, count) / energy - _CENTRE) * PIXEL_PITCH_MM,
        delay=sum_by(label, energy_kev * (tick - earliest[label]), count) / energy,
    )


def sum_by(label: NDArray[np.intp], values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Sums of the values (N,) that carry each label, (count,)."""
    sums: NDArray[np.float64] = np.bincount(label, values, count).astype(np.float64, copy=False)
    return sums


def labels_of_few(tick: NDArray[np.int64], index: NDArray[np.uint16], gap_ticks: float) -> tuple[NDArray[np.intp], int]:
    """Cluster number of each hit, numbered by earliest hit, and their count: union-find in time order.

    Per cell of the matrix only the latest hit is kept: an earlier one within the gap is already joined to it.
    """
    latest: dict[int, int] = {}
    parent: list[int] = []
    times: list[int] = tick.tolist()
    for i, pixel in enumerate(index.tolist()):
        cell = pixel + 2 * (pixel >> 8)
        since = times[i] - gap_ticks
        root = i
        parent.append(i)
        for neighbour in (
            cell, cell - 1, cell + 1,
            cell - _STRIDE, cell - _STRIDE - 1, cell - _STRIDE + 1,
            cell + _STRIDE, cell + _STRIDE - 1, cell + _STRIDE + 1,
        ):  # fmt: skip
            j = latest.get(neighbour)
            if j is not None and times[j] >= since:
                while parent[j] != j:
                    parent[j] = parent[parent[j]]
                    j = parent[j]
                if j < root:  # the earliest hit stays the root
                    parent[root] = root = j
                else:
                    parent[j] = root
        latest[cell] = i
    label: list[int] = []
    count = 0
    for i, above in enumerate(parent):  # a parent precedes its children
        if above == i:
            label.append(count)
            count += 1
        else:
            label.append(label[above])
    return np.array(label, np.intp), count


def labels_of_many(tick: NDArray[np.int64], index: NDArray[np.uint16], gap_ticks: float) -> tuple[NDArray[np.intp], int]:
    """The same by sorting: a key (burst, row, column), where hits further apart than the gap fall into different bursts.

    Neighbours then lie next to each other in the order of the keys, or from one place on that a binary search finds.
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
    above = np.searchsorted(key, key + (_STRIDE - 1))
    for start, reach in ((np.arange(1, n + 1), 1), (above, _STRIDE + 1)):
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
    first = np.empty(count, np.intp)
    first[label[::-1]] = np.arange(n - 1, -1, -1)
    rank = np.empty(count, np.intp)
    rank[np.argsort(first)] = np.arange(count)
    return rank[label], count
