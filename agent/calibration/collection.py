"""Measurements of a known source by a camera: pixels, energies by block, coincidences, and cones by facing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.clustering import Clusters, cluster_many
from radron.agent.detector.detection import ConeEvent
from radron.agent.detector.files.calibration import PIXELS, Calibration
from radron.agent.detector.readout import PIXEL_PITCH_MM, SENSOR_PIXELS, TICK_NS, PixelHits, Readout
from radron.agent.detector.spectroscopy.recognition import MIN_LINE_EVIDENCE, Recogniser
from radron.agent.detector.spectroscopy.shapes import Reading

BLOCKS = 4  # along each side of the sensor
MIN_COARSE_EVENTS = 1000  # singles that show the line's place to 2 %
MAX_COARSE_READOUTS = 3000  # that are held back for it
MIN_PAIR_KEV = 60.0  # energy of each cluster of a pair: above fluorescence
_GAINS = tuple(Reading(float(gain)) for gain in np.geomspace(0.6, 1.7, 53))
_HALF_LINE = 0.12  # relative width to each side within which a pair adds up to the line
WEAK_KEV, STRONG_KEV = (5.0, 12.0), 40.0  # energies of pixels compared for the time walk
FloatArray = NDArray[np.float64]


class Collection:
    """Collects what a camera measures of a known source in several directions: hits by pixel, energies, coincidences (two
    clusters of one photon), cones.

    The directions are measured one after the other. ``coarse_gain``: energies read by the given calibration over true ones, to 2
    %; None until the source's line has been seen. energies_kev: of single clusters, by the calibration with this gain; blocks:
    the part of the sensor of each, 0 .. 15, row by row. walk_ns: delay of weak pixels after strong ones of one cluster.
    """

    def __init__(self, calibration: Calibration, nuclide: str, line_kev: float, config: DetectionConfig) -> None:
        """Start without measurements. ``line_kev``: the nuclide's strongest line in the sensor."""
        self._calibration, self._nuclide, self._line_kev, self._config = calibration, nuclide, line_kev, config
        self.coarse_gain: float | None = None
        self.pixels = np.zeros(PIXELS, np.int64)
        self.live_s = 0.0
        self.events = self.hits = 0
        self.cones: list[list[ConeEvent]] = []
        self._energies: list[FloatArray] = []
        self._blocks: list[NDArray[np.intp]] = []
        self._apart: list[FloatArray] = []
        self._walk: list[FloatArray] = []
        self._recogniser = Recogniser((nuclide,), _GAINS)
        self._pending: list[Readout] = []
        self._chain = self._new_chain()

    def begin_facing(self) -> None:
        """Begin with the next direction of the calibration source; the detector's clock may have been reset."""
        self.end_facing()
        self.cones.append([])
        self._chain = self._new_chain()

    def end_facing(self) -> None:
        """Finish one direction of the calibration source: evaluate the pixel hits that are still held back."""
        if self._pending:
            self._look()
        if self.cones:
            self.cones[-1] += self._chain.flush().cones

    def add(self, readout: Readout) -> None:
        """Add the pixel hits of a readout; the first readouts are held back until the source's line shows the camera's gain."""
        if self.coarse_gain is not None:
            self._evaluate(readout)
            return
        self._pending.append(readout)
        alone = self._alone(self._clusters(readout.hits))
        self._recogniser.add(alone.energy_kev)
        if self._recogniser.events >= MIN_COARSE_EVENTS or len(self._pending) >= MAX_COARSE_READOUTS:
            self._look()

    @property
    def energies_kev(self) -> FloatArray:
        """Energies (N,) in keV of N events with a single cluster."""
        return np.concatenate((np.empty(0), *self._energies))

    @property
    def blocks(self) -> NDArray[np.intp]:
        """Part of the sensor (N,), 0 .. 15, in which each of N events with a single cluster lies; see ``energies_kev``."""
        return np.concatenate((np.empty(0, np.intp), *self._blocks))

    @property
    def apart_ns(self) -> FloatArray:
        """Time differences (N,) in ns between the two clusters of N coincidences (scattered photons) whose energies add up to the
        line.
        """
        return np.concatenate((np.empty(0), *self._apart))

    @property
    def pairs(self) -> int:
        """Number of coincidences (two clusters of one scattered photon) whose energies add up to the line."""
        return sum(map(len, self._apart))

    @property
    def walk_ns(self) -> FloatArray:
        """Delays (N,) in ns of weak pixels after strong ones, in N clusters that have both."""
        return np.concatenate((np.empty(0), *self._walk))

    def _look(self) -> None:
        found = self._recogniser.look()
        self.coarse_gain = found.gain if found is not None and found.evidence >= MIN_LINE_EVIDENCE else 1.0
        self._calibration = self._calibration.with_gain(self.coarse_gain)
        self._chain = self._new_chain()
        pending, self._pending = self._pending, []
        for readout in pending:
            self._evaluate(readout)

    def _new_chain(self) -> DetectorChain:
        return DetectorChain(self._config, self._nuclide, self._calibration)

    def _evaluate(self, readout: Readout) -> None:
        found = self._chain.process(readout)
        self.live_s += found.live_time_s
        self.events += found.hits
        self.hits += len(readout.hits)
        self.cones[-1] += found.cones
        self.pixels += np.bincount(readout.hits.index, minlength=PIXELS)
        clusters = self._clusters(readout.hits)
        alone = self._alone(clusters)
        self._energies.append(alone.energy_kev)
        self._blocks.append(block_of(alone.x_mm, alone.y_mm))
        self._apart.append(self._pairs_apart_ns(clusters))
        self._walk.append(self._walks_ns(readout.hits))

    def _clusters(self, hits: PixelHits) -> Clusters:
        hits = hits.take(np.argsort(hits.tick, kind="stable"))
        energy = self._calibration.energy_kev(hits.index, hits.tot)
        known = energy > 0.0
        found = cluster_many(hits.take(known), energy[known], self._config.cluster_gap_ns / TICK_NS)
        return found.take((found.energy_kev >= self._config.cluster_threshold_kev) & ~found.saturated)

    def _starts(self, clusters: Clusters) -> NDArray[np.bool_]:
        """Which clusters begin an event, with one more at the end (N + 1,)."""
        starts = np.ones(len(clusters) + 1, np.bool_)
        starts[1:-1] = np.diff(clusters.tick) > self._config.coincidence_window_ns / TICK_NS
        return starts

    def _alone(self, clusters: Clusters) -> Clusters:
        starts = self._starts(clusters)
        return clusters.take(starts[:-1] & starts[1:])

    def _pairs_apart_ns(self, clusters: Clusters) -> FloatArray:
        """Differences of the clusters' times (ns), of events of two that add up to the line."""
        starts = self._starts(clusters)
        first = np.flatnonzero(starts[:-2] & ~starts[1:-1] & starts[2:])
        energies = clusters.energy_kev[first], clusters.energy_kev[first + 1]
        whole = np.abs(energies[0] + energies[1] - self._line_kev) <= _HALF_LINE * self._line_kev
        chosen = first[whole & (np.minimum(*energies) >= MIN_PAIR_KEV)]
        time = clusters.tick + clusters.delay
        return TICK_NS * (time[chosen + 1] - time[chosen])

    def _walks_ns(self, hits: PixelHits) -> FloatArray:
        """Return the delays of the weak pixels beside a strong one, ns (N,)."""
        hits = hits.take(np.argsort(hits.tick, kind="stable"))
        energy = self._calibration.energy_kev(hits.index, hits.tot)
        strong = np.flatnonzero(energy >= STRONG_KEV)
        weak = np.flatnonzero((energy >= WEAK_KEV[0]) & (energy <= WEAK_KEV[1]))
        if not len(strong) or not len(weak):
            return np.empty(0)
        place = np.searchsorted(strong, weak)
        later = np.full(len(weak), np.nan)
        for step in (place - 1, place):
            near = strong[np.clip(step, 0, len(strong) - 1)]
            column = np.abs((hits.index[near] & 255).astype(np.int64) - (hits.index[weak] & 255))
            row = np.abs((hits.index[near] >> 8).astype(np.int64) - (hits.index[weak] >> 8))
            apart = (hits.tick[weak] - hits.tick[near]) * TICK_NS
            beside = (np.maximum(column, row) == 1) & (np.abs(apart) <= self._config.cluster_gap_ns)
            later = np.where(beside & np.isnan(later), apart, later)
        found: FloatArray = later[~np.isnan(later)]
        return found


def block_of(x_mm: FloatArray, y_mm: FloatArray) -> NDArray[np.intp]:
    """Return the part (block) 0 .. 15 of the sensor of N places (N,) on it, row by row from the lower left."""
    column, row = (
        np.clip((place / PIXEL_PITCH_MM + SENSOR_PIXELS / 2.0) * BLOCKS // SENSOR_PIXELS, 0, BLOCKS - 1).astype(np.intp)
        for place in (x_mm, y_mm)
    )
    return row * BLOCKS + column


def block_of_pixels() -> NDArray[np.intp]:
    """Return the part (block) 0 .. 15 of the sensor of each pixel, by matrix index: (65536,)."""
    index = np.arange(PIXELS)
    place = np.arange(0.5 - SENSOR_PIXELS / 2.0, SENSOR_PIXELS / 2.0, dtype=np.float64) * PIXEL_PITCH_MM
    return block_of(place[index % SENSOR_PIXELS], place[index // SENSOR_PIXELS])
