"""Clusters -> events: counts by channel, and cones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.clustering import Cluster, Clusters
from radron.agent.detector.coincidence import events_of, merge_satellites
from radron.agent.detector.cones import Line, cone_event
from radron.agent.detector.detection import ConeEvent
from radron.agent.detector.readout import SENSOR_THICKNESS_MM, TICK_NS
from radron.agent.detector.sensor import DRIFT_NS
from radron.agent.detector.spectrum import CoarseSpectrum
from radron.agent.detector.windows import Windows, candidates_of

EnergySink = Callable[[Sequence[float] | NDArray[np.float64]], None]


@dataclass(slots=True)
class Tally:
    """The result for a group of events: counts (see ``Detections``), Compton cones in order of time, and the energy spectrum."""

    hits: int = 0
    photopeak: int = 0
    coincidences: int = 0
    cones: list[ConeEvent] = field(default_factory=list)
    spectrum: CoarseSpectrum = field(default_factory=CoarseSpectrum)


class EventReader:
    """Classifies the events in a camera: events with a line's full energy, and coincidences (two clusters of one photon) that
    make a cone.

    An event with a saturated hit is counted, but has no energy: it is in no spectrum, belongs to no line, and makes no cone.
    """

    def __init__(
        self,
        config: DetectionConfig,
        nuclide: str | tuple[str, ...] | None,
        on_energies: EnergySink | None = None,
        thickness_mm: float = SENSOR_THICKNESS_MM,
        drift_ns: float = DRIFT_NS,
    ) -> None:
        """Set up the energy windows of the nuclide's lines. Raises ConfigError for an unknown nuclide.

        ``nuclide``: as in the mission; None: no event counts as full energy, none makes a cone. ``drift_ns``: drift time of
        electrons across the sensor's thickness.
        """
        self._windows = Windows(() if nuclide is None else candidates_of(nuclide), config)
        self._window_ticks = config.coincidence_window_ns / TICK_NS
        self._minimum_pixels = config.minimum_pixels
        self._on_energies = on_energies
        self._thickness_mm = thickness_mm
        self._mm_per_tick = thickness_mm / drift_ns * TICK_NS

    def read_few(self, clusters: list[Cluster], clock_ns: int) -> Tally:
        """Evaluate clusters, sorted by tick, one by one, and return counts, cones and spectrum. clock_ns: time of tick 0."""
        tally = Tally()
        energies = [self._read(event, clock_ns, tally) for event in events_of(clusters, self._window_ticks)]
        if self._on_energies is not None:
            self._on_energies([energy for energy in energies if energy is not None])
        return tally

    def read_many(self, clusters: Clusters, clock_ns: int) -> Tally:
        """Evaluate many clusters with the same result as ``read_few``, faster: isolated clusters are counted as arrays."""
        gap = np.ones(len(clusters) + 1, np.bool_)
        gap[1:-1] = np.diff(clusters.tick) > self._window_ticks
        alone = gap[:-1] & gap[1:]
        tally = self.read_few(clusters.take(~alone).each(), clock_ns)
        tally.hits += int(np.count_nonzero(alone))
        energy = clusters.energy_kev[alone & ~clusters.saturated]
        full = np.zeros(len(energy), np.bool_)
        for window in self._windows.each:
            full |= np.abs(energy - window.energy_kev) <= window.half_kev
        tally.spectrum.add_singles(energy)
        tally.photopeak += int(np.count_nonzero(full))
        if self._on_energies is not None:
            self._on_energies(energy)
        return tally

    def _read(self, event: list[Cluster], clock_ns: int, tally: Tally) -> float | None:
        """Add one event to the tally; returns its energy in keV, or None where a hit is saturated."""
        if len(event) > 1:
            event = merge_satellites(event)
        tally.hits += len(event)
        if any(cluster.saturated for cluster in event):
            tally.coincidences += len(event) == 2
            return None
        energy = sum(cluster.energy_kev for cluster in event)
        line = self._windows.line_of(energy)
        tally.photopeak += line is not None
        if len(event) <= 2:
            tally.spectrum.add(energy, coincidence=len(event) == 2)
        if len(event) == 2:
            tally.coincidences += 1
            if line is not None:
                cone = self._cone(event[0], event[1], line, clock_ns)
                if cone is not None:
                    tally.cones.append(cone)
        return energy

    def _cone(self, first: Cluster, second: Cluster, line: Line, clock_ns: int) -> ConeEvent | None:
        """The cone of a coincidence; None if too small, or without an order with energies within the limits (paper)."""
        if first.pixels + second.pixels < self._minimum_pixels:
            return None
        energies = (first.energy_kev, second.energy_kev)
        if not (line.allows(*energies) or line.allows(*energies[::-1])):
            return None
        drift = first.tick - second.tick + first.delay - second.delay
        depth = drift * self._mm_per_tick  # the later, the further from the pixels at the rear
        depth = min(max(depth, -self._thickness_mm), self._thickness_mm)
        separation = (first.x_mm - second.x_mm, first.y_mm - second.y_mm, depth)
        return cone_event(clock_ns + first.tick * 25 // 16, energies, separation, line)
