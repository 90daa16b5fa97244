"""Faulty cameras in a simulated flight: dead, stuck, noisy, or with a wrong calibration.

The fault is in the readout, as the camera delivers it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from radron.agent.detector.readout import SENSOR_PIXELS, TICK_NS, PixelHits, Readout
from radron.sim.faults.machines import CameraDead, CameraGain, CameraNoisy, CameraStuck
from radron.sim.faults.schedule import Active, Schedule
from radron.sim.radiation.calibration import MAX_TOT, PixelCalibration
from radron.sim.radiation.truth import CameraTruth

_HALF = SENSOR_PIXELS // 2
_MARGIN = 1.5  # noise is drawn for this multiple of the readout's capacity


class CameraFaults:
    """Plays the faults of all cameras of a simulated flight."""

    def __init__(self, schedule: Schedule, truth: CameraTruth, calibrations: Mapping[int, PixelCalibration]) -> None:
        """``calibrations``: the true calibration of each drone's camera; an ordinary detector has none, and can only be dead."""
        self._schedule, self._truth, self._calibrations = schedule, truth, calibrations
        self._first: dict[tuple[Active, int], Readout] = {}  # of stuck cameras
        self._pixels: dict[tuple[Active, int], NDArray[np.int64]] = {}  # of noisy cameras

    def spoil(self, drone: int, readout: Readout) -> Readout | None:
        """Return a readout as the faulty camera of a drone delivers it; None if the camera delivers nothing."""
        schedule = self._schedule
        for dead, _ in schedule.active(CameraDead, drone):
            counts = None if readout.counts is None else np.zeros_like(readout.counts)
            return replace(readout, hits=PixelHits.none(), counts=counts) if dead.blind else None
        if readout.counts is not None:
            return readout
        for gain, _ in schedule.active(CameraGain, drone):
            readout = replace(readout, hits=amplified(readout.hits, gain.factor_at(schedule.time_s), self._calibrations[drone]))
        for noisy, one in schedule.active(CameraNoisy, drone):
            if (one, drone) not in self._pixels:
                self._pixels[one, drone] = noisy_pixels(noisy, one.rng)
            readout = self._with_noise(readout, noisy, self._pixels[one, drone], self._calibrations[drone], one.rng)
        for _, one in schedule.active(CameraStuck, drone):  # includes the noise in the repeated readout
            readout = repeated(self._first.setdefault((one, drone), readout), readout)
        return readout

    def _with_noise(
        self,
        readout: Readout,
        noisy: CameraNoisy,
        pixels: NDArray[np.int64],
        calibration: PixelCalibration,
        rng: np.random.Generator,
    ) -> Readout:
        """Add the hits of noisy pixels. Hits beyond the readout's bandwidth are lost, and the live time ends with the last
        hit that was read out.
        """
        span_s = (readout.end_ns - readout.start_ns) * 1e-9
        capacity = int(self._truth.max_hits_per_s * span_s)
        tot = time_over_threshold(np.full(len(pixels), noisy.energy_kev), pixels, calibration)
        # A pixel is blind during its pulse and the dead time after it.
        busy_s: NDArray[np.float64] = (25.0 * tot.astype(np.float64) + self._truth.dead_time_ns) * 1e-9
        expected = span_s * float((1.0 / (1.0 / noisy.rate_hz + busy_s)).sum())
        drawn_s = span_s * min(1.0, _MARGIN * capacity / max(expected, 1.0))
        since_s, which = _pulses(drawn_s, noisy.rate_hz, busy_s, rng)
        first_tick = -((readout.clock_ns - readout.start_ns) * 16 // 25)
        tick = first_tick + (since_s * (1e9 / TICK_NS)).astype(np.int64)
        noise = PixelHits(tick, pixels[which].astype(np.uint16), tot[which].astype(np.uint16))
        seen = tot[which] > 0
        hits = delivered(PixelHits.joined((readout.hits, noise if seen.all() else noise.take(seen))))
        total = len(hits) + round(expected * (1.0 - drawn_s / span_s))
        if total <= capacity:
            return replace(readout, hits=hits)
        live_s = readout.live_time_s * capacity / total
        return replace(
            readout, hits=hits.take(slice(capacity)), live_time_s=live_s, lost_hits=readout.lost_hits + total - capacity
        )


def noisy_pixels(noisy: CameraNoisy, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return the matrix indices (K,) of the noisy pixels: at random places, or the lower or upper half of one column."""
    if not noisy.column:
        return rng.choice(SENSOR_PIXELS**2, size=noisy.pixels, replace=False)
    column, lowest = int(rng.integers(SENSOR_PIXELS)), _HALF * int(rng.integers(2))
    rows: NDArray[np.int64] = np.arange(lowest, lowest + _HALF)
    return SENSOR_PIXELS * rows + column


def time_over_threshold(
    energy_kev: NDArray[np.float64], index: NDArray[np.int64], calibration: PixelCalibration
) -> NDArray[np.int64]:
    """Convert energies (keV) to the time-over-threshold counts (N,) of these pixels, as the electronics do.

    The count is 0 below the threshold.
    """
    a, b, c, t = (values[index] for values in (calibration.true_a, calibration.b, calibration.c, calibration.t))
    counts = a * energy_kev + b - c / np.maximum(energy_kev - t, 1e-3) + 0.5
    return np.clip(counts, 0.0, MAX_TOT).astype(np.int64)


def amplified(hits: PixelHits, factor: float, calibration: PixelCalibration) -> PixelHits:
    """Return the hits of a camera that collects ``factor`` times the usual charge in each pixel.

    Hits below the threshold are dropped; longer pulses are delivered later.
    """
    index = hits.index.astype(np.int64)
    a, b, c, t = (values[index] for values in (calibration.true_a, calibration.b, calibration.c, calibration.t))
    above = hits.tot - b - a * t  # with E - t = x: a x^2 - above x - c = 0
    energy_kev = t + (above + np.sqrt(above**2 + 4.0 * a * c)) / (2.0 * a)
    tot = time_over_threshold(factor * energy_kev, index, calibration)
    changed = PixelHits(hits.tick, hits.index, tot.astype(np.uint16))
    return delivered(changed.take(tot > 0))


def repeated(first: Readout, present: Readout) -> Readout:
    """Return the content of the first readout with the times of the present readout, as a stuck camera delivers it."""
    later = (present.start_ns - present.clock_ns) - (first.start_ns - first.clock_ns)
    hits = replace(first.hits, tick=first.hits.tick + later * 16 // 25)
    return replace(present, hits=hits, live_time_s=first.live_time_s, lost_hits=first.lost_hits)


def delivered(hits: PixelHits) -> PixelHits:
    """Sort hits in the order in which a camera delivers them: a pixel is read out at the end of its pulse."""
    return hits.take(np.argsort(hits.tick + 16 * hits.tot.astype(np.int64), kind="stable"))


def _pulses(
    span_s: float, rate_hz: float, busy_s: NDArray[np.float64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Draw the starts of pulses (M,) within the span, s, and the index of each pulse's pixel (of K). A pixel fires at this
    rate while it is not busy.
    """
    mean = span_s * rate_hz
    most = int(mean + 6.0 * mean**0.5) + 10
    gaps = rng.exponential(1.0 / rate_hz, size=(len(busy_s), most))
    gaps[:, 1:] += busy_s[:, None]
    starts = gaps.cumsum(axis=1)
    which, column = np.nonzero(starts < span_s)
    return starts[which, column], which
