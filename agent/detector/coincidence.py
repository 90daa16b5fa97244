"""Clusters that belong together: fluorescence satellites, and the two clusters of a Compton coincidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agent.detector.clustering import Clusters, sum_by

# K fluorescence of Cd (23.0-26.1 keV) and Te (27.2-31.0 keV), widened by the resolution and by charge lost below the threshold.
# Its attenuation length in CdTe is 0.07-0.12 mm, so that hardly any travels further than ten of them.
SATELLITE_KEV = (14.0, 38.0)
SATELLITE_REACH_MM = 1.2
SATELLITE_PIXELS = 8


@dataclass(frozen=True, slots=True)
class Events:
    """Clusters grouped by time, chained while each follows within the window of the one before.

    first: (M,) number of each event's first cluster; multiplicity: (M,) clusters; energy_kev: (M,) their sum.
    """

    clusters: Clusters
    first: NDArray[np.intp]
    multiplicity: NDArray[np.intp]
    energy_kev: NDArray[np.float64]


def group(clusters: Clusters, window_ticks: float) -> Events:
    """Events of clusters that are sorted by tick; satellites are merged first."""
    clusters = merge_satellites(clusters, window_ticks)
    n = len(clusters)
    if n == 0:
        empty = np.empty(0, np.intp)
        return Events(clusters, empty, empty, np.empty(0))
    starts = np.ones(n, np.bool_)
    starts[1:] = clusters.tick[1:] - clusters.tick[:-1] > window_ticks
    first = starts.nonzero()[0]
    multiplicity = np.empty(len(first), np.intp)
    multiplicity[:-1] = first[1:] - first[:-1]
    multiplicity[-1] = n - first[-1]
    return Events(clusters, first, multiplicity, np.add.reduceat(clusters.energy_kev, first))


def merge_satellites(clusters: Clusters, window_ticks: float) -> Clusters:
    """Give the K fluorescence that left its parent's cluster back to it.

    A photoelectric absorption in CdTe mostly emits a K photon of 23-31 keV, which is absorbed about 0.1 mm away and often makes a
    small cluster of its own. Taken for a recoil electron it would yield a wrong cone, as a third cluster it would spoil a right
    one. A cluster is a satellite when its energy is in that band, it is small, and a cluster of no less energy lies within 1.2 mm
    and the coincidence window; energy, hits and earliest time then go to that parent, whose position stays. A true recoil
    electron of this kind is lost with them: they are rare, since Compton scattering by so small an angle is.
    """
    later, earlier = _pairs(clusters.tick, window_ticks)
    if len(later) == 0:
        return clusters
    energy = clusters.energy_kev
    swap = energy[later] > energy[earlier]
    small = np.where(swap, earlier, later)
    large = np.where(swap, later, earlier)
    reach = np.hypot(clusters.x_mm[small] - clusters.x_mm[large], clusters.y_mm[small] - clusters.y_mm[large])
    found = (
        (energy[small] >= SATELLITE_KEV[0])
        & (energy[small] <= SATELLITE_KEV[1])
        & (clusters.pixels[small] <= SATELLITE_PIXELS)
        & (reach <= SATELLITE_REACH_MM)
    )
    if not found.any():
        return clusters
    small, large = small[found], large[found]
    order = np.argsort(energy[large], kind="stable")  # of several parents the last assigned, the largest, counts
    n = len(clusters)
    parent = np.arange(n)
    parent[small[order]] = large[order]
    while True:  # a parent may itself be a satellite; energies rise along the chain, so that it ends
        above = parent[parent]
        if (above == parent).all():
            break
        parent = above
    tick = clusters.tick.copy()
    np.minimum.at(tick, parent, clusters.tick)
    merged = Clusters(
        tick=tick,
        energy_kev=sum_by(parent, energy, n),
        pixels=np.bincount(parent, clusters.pixels, n).astype(np.int64),
        x_mm=clusters.x_mm,
        y_mm=clusters.y_mm,
        delay=clusters.delay + (clusters.tick - tick),
    )
    kept = np.flatnonzero(parent == np.arange(n))
    return merged.take(kept[np.argsort(tick[kept], kind="stable")])


def _pairs(tick: NDArray[np.int64], window_ticks: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """All pairs (later, earlier) of the sorted ticks that lie within the window; (P,) each."""
    later: list[NDArray[np.intp]] = []
    earlier: list[NDArray[np.intp]] = []
    step = 1
    while step < len(tick):
        near = (tick[step:] - tick[:-step] <= window_ticks).nonzero()[0]
        if len(near) == 0:
            break
        earlier.append(near)
        later.append(near + step)
        step += 1
    if not later:
        empty = np.empty(0, np.intp)
        return empty, empty
    return np.concatenate(later), np.concatenate(earlier)
