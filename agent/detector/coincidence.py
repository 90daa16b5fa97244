"""Coincidence grouping: fluorescence satellites are merged with their parents, and the clusters of one photon are grouped."""

from __future__ import annotations

from collections.abc import Iterable

from radron.agent.detector.clustering import Cluster

# K fluorescence of Cd (23.0-26.1 keV) and Te (27.2-31.0 keV), widened by the resolution and by charge lost below the threshold.
# Its attenuation length in CdTe is 0.07-0.12 mm, so that hardly any travels further than ten of them.
SATELLITE_KEV = (14.0, 38.0)
SATELLITE_REACH_MM = 1.2
SATELLITE_PIXELS = 8
_MAX_CLUSTERS = 10  # one photon makes fewer; a longer event is a pile-up and is left unchanged


def events_of(clusters: Iterable[Cluster], window_ticks: float) -> list[list[Cluster]]:
    """Group clusters that may come from one photon.

    clusters: sorted by tick. A group continues while each cluster follows the previous one within ``window_ticks``.
    """
    events: list[list[Cluster]] = []
    last = -(1 << 62)
    for cluster in clusters:
        if cluster.tick - last > window_ticks:
            events.append([])
        events[-1].append(cluster)
        last = cluster.tick
    return events


def merge_satellites(event: list[Cluster]) -> list[Cluster]:
    """Merge small clusters made by fluorescence with the clusters from which they came. Return the result in order of time.

    A photoelectric absorption in CdTe mostly emits a K photon of 23-31 keV. The photon is absorbed about 0.1 mm away, and often
    makes a small cluster of its own. Taken for a recoil electron it would yield a wrong cone; as a third cluster it would spoil a
    correct one. A cluster is a satellite when its energy is in that band, it is small, and a cluster of the event with at least
    its energy lies within 1.2 mm. Its energy, hits and earliest time are added to that parent (the largest, of several), whose
    position is kept. True recoil electrons of this kind are lost with them; they are rare, since Compton scattering by so small
    an angle is.
    """
    if not 2 <= len(event) <= _MAX_CLUSTERS or not any(map(_may_be_satellite, event)):
        return event
    event = sorted(event, key=lambda cluster: cluster.energy_kev)
    merged = event.copy()
    kept: list[Cluster] = []
    for place, cluster in enumerate(event):
        parent = _parent(event, place) if _may_be_satellite(cluster) else None
        if parent is None:
            kept.append(merged[place])
        else:
            merged[parent] = _joined(merged[parent], merged[place])
    return sorted(kept, key=lambda cluster: cluster.tick)


def _may_be_satellite(cluster: Cluster) -> bool:
    return SATELLITE_KEV[0] <= cluster.energy_kev <= SATELLITE_KEV[1] and cluster.pixels <= SATELLITE_PIXELS


def _parent(by_energy: list[Cluster], of: int) -> int | None:
    """Index of the largest cluster within reach of a cluster, among the larger ones."""
    small = by_energy[of]
    for place in range(len(by_energy) - 1, of, -1):
        x, y = by_energy[place].x_mm - small.x_mm, by_energy[place].y_mm - small.y_mm
        if x * x + y * y <= SATELLITE_REACH_MM * SATELLITE_REACH_MM:
            return place
    return None


def _joined(parent: Cluster, satellite: Cluster) -> Cluster:
    tick = min(parent.tick, satellite.tick)
    return parent._replace(
        tick=tick,
        energy_kev=parent.energy_kev + satellite.energy_kev,
        pixels=parent.pixels + satellite.pixels,
        delay=parent.delay + (parent.tick - tick),
        saturated=parent.saturated or satellite.saturated,
    )
