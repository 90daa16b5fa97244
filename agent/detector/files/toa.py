"""Times of arrival as the camera's readout writes them: counters that wrap, and hits put into a neighbouring period.

The chip counts ToA in 14 bits, 409.6 us; the readout extends it by the number of the period. According to the manufacturer, hits
near the border of two periods may get the number of the wrong one.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radron.agent.errors import DetectorError

PERIOD_BITS = 14
PERIOD = 1 << PERIOD_BITS  # 25 ns steps
MAX_APART = 16  # 400 ns: hits of one event, with drift and time walk, are nearer to each other
MAX_DISORDER_NS = 1_000_000  # largest disorder of a hit behind a later one: its time over threshold and the readout queue
_LARGE_STEP = PERIOD // 2  # a ToA further back than this is a wrap, or a hit that the readout has delayed
_MIN_WRAPS = 3  # large steps back among the first rows that show a counter of 14 bits; a late hit is only one
_EXTENDED_BITS = 30  # of the readout's extension: wraps every 26.8 s
_STEP_S = 25e-9
_CONTEXT = 256  # hits of the call before, among which some of the same event may be


def joined_at_borders(toa: NDArray[np.int64]) -> NDArray[np.int64]:
    """Repair hits that the camera's readout put into a wrong period of its time counter.

    toa: (N,) times of arrival in 25 ns steps, in the order of the readout. Returns the times with misplaced hits moved by one
    period.

    A hit belongs to hits within ``MAX_APART`` across the border of a neighbouring period rather than to hits across its own if
    - the time falls back by that period from one to the other in the order of the readout, and none across its own border was
      read out nearer to it, or
    - neither has hits across its own border.
    """
    phase = toa & (PERIOD - 1)
    near = np.flatnonzero((phase < MAX_APART) | (phase >= PERIOD - MAX_APART))
    if len(near) < 2:
        return toa
    repaired = toa.copy()
    later = phase[near] < MAX_APART  # behind a border
    repaired[near[later]] = _moved(repaired[near], near, later)
    repaired[near[~later]] = -_moved(-repaired[near], -near, ~later)
    return repaired


class BorderRepair:
    """Applies ``joined_at_borders`` to the hits of one measurement as they arrive; ``repaired`` counts the hits that were moved.

    The last hits of the previous call are used for comparison. Misplaced hits are not moved if the rest of their event comes with
    the next call.
    """

    def __init__(self) -> None:
        self.repaired = 0
        self._before = np.empty(0, np.int64)

    def joined(self, toa: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the repaired times of arrival (N,) of the next N hits, in 25 ns steps."""
        count = len(self._before)
        joined = joined_at_borders(np.concatenate((self._before, toa)))[count:]
        self.repaired += int(np.count_nonzero(joined != toa))
        self._before = joined[-_CONTEXT:]
        return joined


def _moved(toa: NDArray[np.int64], row: NDArray[np.intp], later: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the times of the hits behind a border, (M,), moved behind the next border where they belong there.

    ``toa``, ``row``: times and rows of all hits beside a border (N,); ``later``: which of them are behind one.
    """
    order = np.argsort(toa, kind="stable")
    before, after = order[~later[order]], order[later[order]]
    times, befores = toa.tolist(), toa[before].tolist()
    rows = row.tolist()
    moved = dict(zip(after.tolist(), toa[after].tolist(), strict=True))
    afters = list(moved.values())
    for hit, time in moved.items():
        here = _nearest(befores, before, time, rows, rows[hit])
        there = _nearest(befores, before, time + PERIOD, rows, rows[hit])
        if there is None:
            continue
        fell_back = rows[there] < rows[hit] and (here is None or rows[hit] - rows[there] < abs(rows[hit] - rows[here]))
        first_after = bisect_left(afters, times[there])
        alone = first_after == len(afters) or afters[first_after] - times[there] > MAX_APART
        if fell_back or (here is None and alone):
            moved[hit] = time + PERIOD
    return np.array([moved[hit] for hit in np.flatnonzero(later).tolist()], np.int64)


def _nearest(befores: list[int], place: NDArray[np.intp], time: int, rows: list[int], row: int) -> int | None:
    """Return the hit read out nearest to ``row`` among those that precede ``time`` by at most ``MAX_APART``, or None.

    ``befores``: sorted times of the hits before a border; ``place``: which hits these are.
    """
    first, last = bisect_left(befores, time - MAX_APART), bisect_right(befores, time)
    hits = place[first:last].tolist()
    return min(hits, key=lambda hit: abs(rows[hit] - row)) if hits else None


def wraps_in_chip(toa: NDArray[np.int64]) -> bool:
    """Return whether a file's times come from the chip's own counter, which wraps every 409.6 us.

    toa: (N,) first times of arrival of a measurement, in 25 ns steps.
    """
    return bool(len(toa)) and int(toa.max()) < PERIOD and int(np.count_nonzero(np.diff(toa) < -_LARGE_STEP)) >= _MIN_WRAPS


class Unwrapper:
    """Makes the times of arrival of one measurement continuous, although their counter wraps.

    ``bits``: of the counter; None: 30 bits, recognised by a step back of more than half of that range.
    """

    def __init__(self, path: Path, bits: int | None) -> None:
        self._path = path
        self._modulus = None if bits is None else 1 << bits
        self._last: int | None = None  # the last value in the file
        self._highest = 0
        self._turns = 0

    @property
    def extended(self) -> bool:
        """Whether the readout software has extended the chip's own counter, so that hits may be in a wrong period."""
        return self._modulus != PERIOD

    def unwrapped(self, toa: NDArray[np.int64], line: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the continuous times (N,) of the next N rows of a file, in 25 ns steps.

        toa: (N,) times in the file. line: (N,) line numbers, for the errors.

        Raises:
            DetectorError: a time exceeds the counter, or a step back is neither a wrap nor disorder.
        """
        if len(toa) == 0:
            return toa
        steps = np.diff(toa, prepend=toa[0] if self._last is None else self._last)
        if self._modulus is None:
            self._recognise(toa, steps, line)
        self._last = int(toa[-1])
        self._highest = max(self._highest, int(toa.max()))
        if self._modulus is None:
            return toa
        if self._highest >= self._modulus:
            bits = self._modulus.bit_length() - 1
            raise DetectorError(f"{self._path}: line {line[toa.argmax()]}: ToA does not fit a counter of {bits} bits")
        turns = self._turns + np.cumsum((steps < -self._modulus // 2).astype(np.int64) - (steps > self._modulus // 2))
        self._turns = int(turns[-1])
        continued: NDArray[np.int64] = toa + turns * self._modulus
        return continued

    def _recognise(self, toa: NDArray[np.int64], steps: NDArray[np.int64], line: NDArray[np.int64]) -> None:
        """Take the first step back that is no disorder for a wrap of 30 bits."""
        back = int((steps * 25 < -100 * MAX_DISORDER_NS).argmax())
        step = -int(steps[back])
        if step * 25 <= 100 * MAX_DISORDER_NS:
            return
        highest = max(self._highest, int(toa[: back + 1].max()), int(toa[back]) + step)
        if highest < 1 << _EXTENDED_BITS and step > 1 << (_EXTENDED_BITS - 1):
            self._modulus = 1 << _EXTENDED_BITS
            return
        raise DetectorError(
            f"{self._path}: line {line[back]}: ToA falls back by {step * _STEP_S:.3g} s, which is no wrap of its counter; "
            "export each measurement to a file of its own"
        )
