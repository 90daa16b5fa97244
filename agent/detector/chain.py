"""The whole chain on a stream of readouts: pixel hits -> clusters -> coincidences -> cones and counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agent.config import DetectionConfig
from agent.detector.calibration import Calibration
from agent.detector.clustering import cluster
from agent.detector.coincidence import Events, group
from agent.detector.cones import Line, cone_event
from agent.detector.detection import ConeEvent, Detections
from agent.detector.lines import lines_of
from agent.detector.readout import SENSOR_THICKNESS_MM, TICK_NS, PixelHits, Readout
from agent.detector.response import MM_PER_TICK

_HOLD_NS = 1_000_000  # at most so much of a readout is held back, however dense the hits are


@dataclass(frozen=True, slots=True)
class _Result:
    """Counts and cones of finished hits."""

    hits: int = 0
    photopeak: int = 0
    coincidences: int = 0
    cones: tuple[ConeEvent, ...] = ()


class DetectorChain:
    """One detector's chain. Feed it readouts in order; what comes out does not depend on how the stream was cut into readouts.

    Hits whose event may go on beyond the end of a readout are held back and come out with the next one.
    ``lost_hits`` counts what the detector reported as lost.
    """

    def __init__(
        self,
        config: DetectionConfig,
        nuclide: str,
        calibration: Calibration,
        on_events: Callable[[Events], None] | None = None,
    ) -> None:
        """``on_events`` is shown all events, e.g. for a spectrum. Raises ConfigError where the nuclide is not known."""
        self._config = config
        self._calibration = calibration
        self._on_events = on_events
        self._lines = tuple(
            Line.of(energy, config.maximum_electron_kev, config.minimum_photon_kev) for energy in lines_of(nuclide)
        )
        self._line_kev = np.array([line.energy_kev for line in self._lines])
        self._gap = config.cluster_gap_ns / TICK_NS
        self._window = config.coincidence_window_ns / TICK_NS
        self._reach = max(self._gap, self._window)
        self._held = PixelHits(np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.uint16))
        self._start_ns: int | None = None
        self._end_ns = 0
        self._clock_ns = 0
        self._held_live_s = 0.0
        self.lost_hits = 0

    def process(self, readout: Readout) -> Detections:
        """Counts and cones of the next stretch of time.

        The stretch starts where the one before ended. It ends with the readout or, where an event is held back, just before that
        event's first hit. Hits that arrive later than their own stretch are counted in the present one.
        """
        if self._start_ns is None:
            self._start_ns = readout.start_ns
        self._clock_ns = readout.clock_ns
        self._end_ns = readout.end_ns
        self.lost_hits += readout.lost_hits
        hits = readout.hits
        if len(self._held):
            hits = _join(self._held, hits)
        if len(hits) == 0:
            return self._detections(readout.end_ns, readout.live_time_s, _Result())
        if (hits.tick[1:] < hits.tick[:-1]).any():
            hits = _take(hits, np.argsort(hits.tick, kind="stable"))

        watermark = ((readout.end_ns - readout.clock_ns) * 16 + 24) // 25  # the first tick not before the end
        inside = int(np.searchsorted(hits.tick, watermark))
        done = self._finished(hits.tick, inside, watermark)
        end_ns = readout.end_ns
        if done < inside:
            end_ns = min(max(_stamp_ns(readout.clock_ns, int(hits.tick[done])), self._start_ns), end_ns)
        self._held = _take(hits, slice(done, None))
        return self._detections(end_ns, readout.live_time_s, self._evaluate(_take(hits, slice(0, done))))

    def flush(self) -> Detections:
        """What is still held back, at the end of the stream."""
        held, self._held = self._held, _take(self._held, slice(0, 0))
        if self._start_ns is None:
            self._start_ns = self._end_ns
        return self._detections(self._end_ns, 0.0, self._evaluate(held))

    def _finished(self, tick: NDArray[np.int64], inside: int, watermark: int) -> int:
        """How many of the sorted hits no later hit can join: all up to the last pause before the watermark."""
        earliest = int(np.searchsorted(tick, watermark - int(_HOLD_NS / TICK_NS)))
        done = inside
        following = watermark
        while done > earliest and following - int(tick[done - 1]) <= self._reach:
            done -= 1
            following = int(tick[done])
        return done

    def _detections(self, end_ns: int, live_time_s: float, result: _Result) -> Detections:
        """Close the stretch; the live time is shared between it and what is held back by their lengths."""
        assert self._start_ns is not None
        start_ns, self._start_ns = self._start_ns, end_ns
        live_time_s += self._held_live_s
        length = self._end_ns - start_ns
        self._held_live_s = live_time_s * (self._end_ns - end_ns) / length if length > 0 else 0.0
        return Detections(
            start_ns,
            end_ns,
            max(live_time_s - self._held_live_s, 0.0),
            result.hits,
            result.photopeak,
            result.coincidences,
            result.cones,
        )

    def _evaluate(self, hits: PixelHits) -> _Result:
        if len(hits) == 0:
            return _Result()
        clusters = cluster(hits.tick, hits.index, self._calibration.energy_kev(hits.index, hits.tot), self._gap)
        strong = clusters.energy_kev >= self._config.cluster_threshold_kev
        if not strong.all():
            clusters = clusters.take(strong)
        events = group(clusters, self._window)
        if self._on_events is not None:
            self._on_events(events)
        line, full = self._match_lines(events.energy_kev)
        pairs = events.multiplicity == 2
        return _Result(
            hits=len(events.clusters),
            photopeak=int(np.count_nonzero(full)),
            coincidences=int(np.count_nonzero(pairs)),
            cones=self._cones(events, (pairs & full).nonzero()[0], line),
        )

    def _match_lines(self, energy_kev: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """The nearest line (its number) to each event's energy, and whether that lies within the window."""
        difference = np.abs(energy_kev[:, None] - self._line_kev)
        line = difference.argmin(axis=1)
        full = (difference <= self._config.energy_window * self._line_kev).any(axis=1)
        return line, full

    def _cones(self, events: Events, which: NDArray[np.intp], line: NDArray[np.intp]) -> tuple[ConeEvent, ...]:
        """Cones of the coincidences whose sizes and energies allow one."""
        clusters = events.clusters
        first = events.first[which]
        second = first + 1
        enough = clusters.pixels[first] + clusters.pixels[second] >= self._config.minimum_pixels
        which, first, second = which[enough], first[enough], second[enough]
        if len(which) == 0:
            return ()
        tick = clusters.tick[first]
        drift = clusters.delay[first] - clusters.delay[second] - (clusters.tick[second] - tick)
        dz = np.clip(drift * MM_PER_TICK, -SENSOR_THICKNESS_MM, SENSOR_THICKNESS_MM)
        columns = (
            tick,
            clusters.energy_kev[first],
            clusters.energy_kev[second],
            clusters.x_mm[first] - clusters.x_mm[second],
            clusters.y_mm[first] - clusters.y_mm[second],
            dz,
            line[which],
        )
        cones = []
        for at, energy_1, energy_2, x, y, z, number in zip(*(column.tolist() for column in columns), strict=True):
            of = self._lines[number]
            if of.allows(energy_1, energy_2) or of.allows(energy_2, energy_1):
                cones.append(cone_event(_stamp_ns(self._clock_ns, at), (energy_1, energy_2), (x, y, z), of))
        return tuple(cones)


def _stamp_ns(clock_ns: int, tick: int) -> int:
    return clock_ns + tick * 25 // 16


def _join(a: PixelHits, b: PixelHits) -> PixelHits:
    return PixelHits(np.concatenate((a.tick, b.tick)), np.concatenate((a.index, b.index)), np.concatenate((a.tot, b.tot)))


def _take(hits: PixelHits, which: NDArray[np.intp] | slice) -> PixelHits:
    return PixelHits(hits.tick[which], hits.index[which], hits.tot[which])
