"""Electronics of the simulated camera: they turn the pixels of events into hits, in the readout's order of delivery."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.readout import SENSOR_PIXELS, TICK_NS, PixelHits, Readout
from radron.sim.radiation._jit import jit
from radron.sim.radiation.calibration import MAX_TOT, PixelCalibration
from radron.sim.radiation.timepix3 import ENERGY_STEP_KEV
from radron.sim.radiation.truth import CameraTruth

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

# Symmetries of the square sensor, as bits; applied in this order, they map an event from (x, y, z) to another direction.
SWAP, FLIP_COLUMN, FLIP_ROW = 4, 1, 2


class Electronics:
    """Simulates the pixels of one camera after the deposit of energy: true calibration, dead time and the readout's bandwidth."""

    def __init__(self, truth: CameraTruth, rng: np.random.Generator, clock_ns: int) -> None:
        self._clock_ns = clock_ns
        self._dead_ticks = round(truth.dead_time_ns / TICK_NS)
        self._capacity_per_s = truth.max_hits_per_s
        self._busy = np.full(SENSOR_PIXELS**2, np.iinfo(np.int64).min // 2)
        self._dead_side = round(SENSOR_PIXELS * truth.dead_block**0.5)
        self.calibration = PixelCalibration.draw(truth, rng)

    def ticks(self, start_ns: int, end_ns: int) -> tuple[int, int]:
        """Return the first clock tick at or after the start, and the first at or after the end (both nanoseconds UTC)."""
        return -((self._clock_ns - start_ns) * 16 // 25), -((self._clock_ns - end_ns) * 16 // 25)

    def empty(self, start_ns: int, end_ns: int) -> Readout:
        """Return a readout of this interval without hits."""
        return Readout(start_ns, end_ns, self._clock_ns, (end_ns - start_ns) * 1e-9, PixelHits.none())

    def read_out(
        self,
        start_ns: int,
        end_ns: int,
        pixels: NDArray[np.void],
        first: IntArray,
        event: IntArray,
        symmetry: IntArray,
        tick: IntArray,
    ) -> Readout:
        """Convert events to the hits that the readout delivers. N events are read out.

        Hits beyond the bandwidth are lost, like with a full buffer; the live time ends with the last hit that was read out.

        Args:
            start_ns: begin of the interval, nanoseconds UTC.
            end_ns: end of the interval.
            pixels: pixels of all known events, one after the other.
            first: index of each known event's first pixel.
            event: (N,) index into ``first`` of each event that is read out.
            symmetry: (N,) symmetry of the sensor (flips and swap of rows and columns) applied to each event.
            tick: (N,) clock tick of each event.
        """
        cal = self.calibration
        ticks, index, tot = _deliver(
            pixels, first, event, symmetry, tick, cal.true_a, cal.b, cal.c, cal.t, self._busy, self._dead_ticks
        )
        if self._dead_side > 0:
            alive = (index % SENSOR_PIXELS >= self._dead_side) | (index // SENSOR_PIXELS >= self._dead_side)
            ticks, index, tot = ticks[alive], index[alive], tot[alive]
        span_s = (end_ns - start_ns) * 1e-9
        capacity = int(self._capacity_per_s * span_s)
        count = len(ticks)
        if count <= capacity:
            return Readout(start_ns, end_ns, self._clock_ns, span_s, PixelHits(ticks, index, tot))
        kept = PixelHits(ticks, index, tot).take(slice(capacity))
        return Readout(start_ns, end_ns, self._clock_ns, span_s * capacity / count, kept, count - capacity)


@jit
def _deliver(
    pixels: NDArray[np.void],
    first: IntArray,
    event: IntArray,
    symmetry: IntArray,
    tick: IntArray,
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    t: FloatArray,
    busy: IntArray,
    dead_ticks: int,
) -> tuple[IntArray, NDArray[np.uint16], NDArray[np.uint16]]:
    """Ticks, matrix indices and ToT of the events' hits, ordered by the end of their pulses: a pixel is read when its pulse is
    over.
    """
    size = 0
    for k in range(len(event)):
        size += first[event[k] + 1] - first[event[k]]
    ticks = np.empty(size, np.int64)
    index = np.empty(size, np.uint16)
    tot = np.empty(size, np.uint16)
    size = 0
    for k in range(len(event)):
        for p in range(first[event[k]], first[event[k] + 1]):
            column, row = np.int64(pixels[p]["column"]), np.int64(pixels[p]["row"])
            if symmetry[k] & SWAP:
                column, row = row, column
            if symmetry[k] & FLIP_COLUMN:
                column = SENSOR_PIXELS - 1 - column
            if symmetry[k] & FLIP_ROW:
                row = SENSOR_PIXELS - 1 - row
            i = SENSOR_PIXELS * row + column
            energy = ENERGY_STEP_KEV * pixels[p]["energy"]
            counts = int(a[i] * energy + b[i] - c[i] / max(energy - t[i], 1e-3) + 0.5)
            if counts < 1:
                continue
            ticks[size] = tick[k] + pixels[p]["tick"]
            index[size] = i
            tot[size] = min(counts, MAX_TOT)
            size += 1
    end = np.empty(size, np.int64)
    order = np.argsort(ticks[:size])
    alive = 0
    for k in range(size):  # in time order: a busy pixel records nothing
        p = order[k]
        if ticks[p] < busy[index[p]]:
            continue
        over = ticks[p] + 16 * np.int64(tot[p])
        busy[index[p]] = over + dead_ticks
        end[alive] = over
        order[alive] = p
        alive += 1
    order = order[:alive][np.argsort(end[:alive])]
    return ticks[order], index[order], tot[order]
