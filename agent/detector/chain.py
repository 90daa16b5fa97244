"""The detection chain on a stream of readouts: pixel hits -> clusters -> coincidences -> cones and counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.clustering import FEW, cluster_few, cluster_many
from radron.agent.detector.deadblocks import DeadBlocks
from radron.agent.detector.detection import Detections
from radron.agent.detector.events import EnergySink, EventReader, Tally
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.noise import NoiseMask
from radron.agent.detector.readout import TICK_NS, PixelHits, Readout

_HOLD_NS = 1_000_000  # longest part of a readout that is held back, however dense the hits are
_AHEAD_NS = 1e9  # hits stamped further ahead of their readout have a wrong clock


class DetectorChain:
    """Turns the pixel hits of one camera into counts and Compton cones: hits, clusters, coincidences (two clusters of one
    photon), cones.

    Readouts are given in order; the results do not depend on how the stream is cut into readouts. Hits whose event may continue
    beyond the end of a readout are held back and appear with the next readout. ``lost_hits`` counts hits that the detector
    reported as lost, hits with a stamp far ahead, and hits without energy; ``repaired_hits`` the hits that the reader moved to
    the neighbouring period of the chip's counter; ``noise`` is the mask of noisy pixels with the count of masked hits;
    ``dead_blocks`` lists the blocks of pixels that see nothing. ``scale`` is multiplied with the energies of the calibration.
    """

    def __init__(
        self,
        config: DetectionConfig,
        nuclide: str | tuple[str, ...] | None,
        calibration: Calibration,
        on_energies: EnergySink | None = None,
    ) -> None:
        """Set up the chain of one camera.

        Args:
            config: coincidence window, thresholds and line windows.
            nuclide: the lines of this nuclide make cones, as in the mission; None: hits and coincidences only.
            calibration: of the camera.
            on_energies: receives the energies (keV) of all events.

        Raises:
            ConfigError: the nuclide is unknown.
        """
        self._calibration = calibration
        self._events = EventReader(config, nuclide, on_energies, calibration.thickness_mm, calibration.drift_ns)
        self._threshold_kev = config.cluster_threshold_kev
        self._gap = config.cluster_gap_ns / TICK_NS
        self._reach = max(config.cluster_gap_ns, config.coincidence_window_ns) / TICK_NS
        self._held = PixelHits.none()
        self._start_ns: int | None = None
        self._end_ns = 0
        self._clock_ns = 0
        self._held_live_s = 0.0
        self.lost_hits = self.repaired_hits = 0
        self.noise = NoiseMask()
        self.dead_blocks = DeadBlocks(calibration)
        self.scale = 1.0

    def process(self, readout: Readout) -> Detections:
        """Return counts and cones of the next time interval.

        The interval starts where the previous one ended. It ends with the readout or, if an event is held back, just before that
        event's first hit. Hits that arrive later than their own interval are counted in the present one. Pixels without a usable
        calibration reduce the sensitivity: the live time is reduced by their share.
        """
        if self._start_ns is None:
            self._start_ns = readout.start_ns
        self._clock_ns = readout.clock_ns
        self._end_ns = readout.end_ns
        self.lost_hits += readout.lost_hits
        self.repaired_hits += readout.repaired_hits
        hits = readout.hits
        if len(self._held):
            hits = PixelHits.joined((self._held, hits))
        if len(hits) == 0:
            return self._detections(readout.end_ns, readout.live_time_s, Tally())
        hits = hits.take(hits.tick.argsort(kind="stable"))

        watermark = ((readout.end_ns - readout.clock_ns) * 16 + 24) // 25  # the first tick not before the end
        inside = len(hits) if hits.tick[-1] < watermark else int(np.searchsorted(hits.tick, watermark))
        done = self._finished(hits.tick, inside, watermark)
        end_ns = readout.end_ns
        if done < inside:
            end_ns = min(max(readout.clock_ns + int(hits.tick[done]) * 25 // 16, self._start_ns), end_ns)
        self._held = PixelHits.none()
        if done < len(hits):
            believed = int(np.searchsorted(hits.tick, watermark + _AHEAD_NS / TICK_NS))
            self.lost_hits += len(hits) - believed
            self._held = hits.take(slice(done, believed))
            hits = hits.take(slice(done))
        return self._detections(end_ns, readout.live_time_s, self._evaluate(hits))

    def flush(self) -> Detections:
        """Return counts and cones of the hits that are still held back, at the end of the stream."""
        held, self._held = self._held, PixelHits.none()
        if self._start_ns is None:
            self._start_ns = self._end_ns
        return self._detections(self._end_ns, 0.0, self._evaluate(held))

    def _finished(self, tick: NDArray[np.int64], inside: int, watermark: int) -> int:
        """Number of the sorted hits that no later hit can join: all up to the last pause before the watermark."""
        oldest = watermark - int(_HOLD_NS / TICK_NS)
        following = watermark
        for done in range(inside, 0, -1):
            last = int(tick[done - 1])
            if following - last > self._reach or last < oldest:
                return done
            following = last
        return 0

    def _detections(self, end_ns: int, live_time_s: float, found: Tally) -> Detections:
        """Close the interval; the live time is divided between it and the part held back, by length."""
        assert self._start_ns is not None
        start_ns, self._start_ns = self._start_ns, end_ns
        live_time_s = live_time_s * self._calibration.good_share + self._held_live_s
        length = self._end_ns - start_ns
        self._held_live_s = live_time_s * (self._end_ns - end_ns) / length if length > 0 else 0.0
        live_time_s = max(live_time_s - self._held_live_s, 0.0)
        counts = found.hits, found.photopeak, found.coincidences
        return Detections(start_ns, end_ns, live_time_s, *counts, tuple(found.cones), found.spectrum.bins())

    def _evaluate(self, hits: PixelHits) -> Tally:
        hits = self.noise.without_noise(hits, self._clock_ns, self._start_ns or 0)
        if len(hits) == 0:
            return Tally()
        self.dead_blocks.add(hits.index)
        energy = self.scale * self._calibration.energy_kev(hits.index, hits.tot)
        known = energy > 0.0  # not of a bad pixel, nor of a few counts for which a pixel's calibration gives no energy
        if not known.all():
            self.lost_hits += int(len(hits) - known.sum())
            hits, energy = hits.take(known), energy[known]
        if len(hits) <= FEW:
            few = cluster_few(hits, energy, self._gap).each()
            return self._events.read_few([one for one in few if one.energy_kev >= self._threshold_kev], self._clock_ns)
        many = cluster_many(hits, energy, self._gap)
        return self._events.read_many(many.take(many.energy_kev >= self._threshold_kev), self._clock_ns)
