"""Noisy pixels: those that fire far more often than their fellows are left out of what the camera counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agent.detector.readout import SENSOR_PIXELS, PixelHits

BEAT_NS = 100_000_000  # a burst is within one of them, or two
SHARE = 400  # times the mean of all pixels is too often
NOISY = 9.0  # beats in which a pixel fires too often, until it is left out
QUIET = 1.0  # beats in a period, up to which a noisy pixel was quiet in it
PERIOD_BEATS = 200
TERM_PERIODS = 3  # for so many in a row it has to be quiet to be let in again; twice as many after each relapse
LONGEST_TERM = 192  # an hour
_PIXELS = SENSOR_PIXELS**2


class NoiseMask:
    """Which pixels of one camera are noisy. ``masked_hits`` counts the hits left out so far, ``pixels`` who is out now.

    Time is cut into beats of 0.1 s. With m the mean number of hits of a healthy pixel in a beat, one with c hits gains
    min(c, 1 + SHARE m) - SHARE m: about 1 at most, however many hits a burst has, and less than nothing while it fires no more
    than SHARE times as often as the mean; below nothing it does not fall (Page's test, Biometrika 41, 1954). Who has gained more
    than NOISY is left out. So where there is only background a pixel that fires 30 times a second is left out after a second,
    one that fires once a second after ten, and nowhere one that adds less than SHARE / 65536 = 0.6 % to the hits of all pixels.
    So more than 160 pixels that are equally noisy, a column or a row, hide each other; noise of that kind is not looked for.

    A healthy pixel is not touched. At a mean of 0.0001 hits a second (the natural background) it would have to be hit ten times
    within minutes, in any field 400 times as often as the others: the border of a sensor that a source shines on from the side
    is hit a few times as often.

    A noisy pixel is let in again after a minute in which it was quiet, and after twice as long whenever that was too soon. Each
    takes 1.5e-5 of the sensor's area from the counts, for which nothing is corrected.
    """

    def __init__(self) -> None:
        self.masked_hits = 0
        self.pixels = 0
        self._beat = 0
        self._fired: list[NDArray[np.uint16]] = []  # in this beat
        self._expected = 0.0  # SHARE m, summed over all beats so far
        self._mark = np.zeros(_PIXELS)  # what a pixel had gained when it last fired, plus _expected then
        self._restless = np.zeros(_PIXELS, np.bool_)  # in this period
        self._sentence = np.zeros(_PIXELS, np.int16)  # periods until it is let in; 0: is not left out
        self._term = np.zeros(_PIXELS, np.int16)  # its latest sentence

    @property
    def problems(self) -> tuple[str, ...]:
        """What the operator has to know, a line or none."""
        if self.pixels == 0:
            return ()
        return (f"camera: {self.pixels} noisy {'pixel' if self.pixels == 1 else 'pixels'} masked",)

    def without_noise(self, hits: PixelHits, clock_ns: int, since_ns: int) -> PixelHits:
        """The hits, sorted by time, less those of noisy pixels. ``clock_ns``: UTC time of tick 0.

        A beat is judged when the next one begins, so that the result does not depend on how many hits are given at a time. Hits
        from before ``since_ns``, UTC, come late (or have a wrong stamp) and belong to that time's beat.
        """
        count = len(hits)
        kept: NDArray[np.bool_] | None = None
        first = 0
        while first < count:
            beat = max(clock_ns + int(hits.tick[first]) * 25 // 16, since_ns) // BEAT_NS
            following = -((clock_ns - (beat + 1) * BEAT_NS) * 16 // 25)  # the first tick of the next beat
            end = count if hits.tick[-1] < following else int(hits.tick.searchsorted(following))
            self._advance(beat)
            index = hits.index[first:end]
            self._fired.append(index)
            if self.pixels:
                if kept is None:
                    kept = np.ones(count, np.bool_)
                kept[first:end] = self._sentence[index] == 0
            first = end
        if kept is None or kept.all():
            return hits
        self.masked_hits += count - int(np.count_nonzero(kept))
        return hits.take(kept)

    def _advance(self, beat: int) -> None:
        """Go on to the beat, judging what came before it."""
        if self._beat - PERIOD_BEATS < beat <= self._beat:  # further back is a clock that was set
            return
        if self._fired:
            self._judge(np.concatenate(self._fired))
            self._fired.clear()
        if beat // PERIOD_BEATS != self._beat // PERIOD_BEATS:
            self._close_period()
        self._beat = beat

    def _judge(self, fired: NDArray[np.uint16]) -> None:
        """Reckon a beat in which the pixels fired, each as often as it stands in (N,), and leave out whoever is noisy now."""
        healthy = np.count_nonzero(self._sentence[fired] == 0) if self.pixels else len(fired)
        expected = SHARE * healthy / _PIXELS
        most = 1 + round(expected)
        times: int | NDArray[np.intp] = 1  # where a pixel stands there twice the assignment below does it once
        if most > 1:
            fired, counts = np.unique(fired, return_counts=True)
            times = np.minimum(counts, most)
        mark = np.maximum(self._mark[fired], self._expected) + times
        self._mark[fired] = mark
        self._expected += expected
        if self.pixels:
            self._restless[fired[mark > self._expected + QUIET]] = True
        if mark.max() > self._expected + NOISY:
            self._leave_out(fired[mark > self._expected + NOISY])

    def _leave_out(self, noisy: NDArray[np.uint16]) -> None:
        """Who is among them and not left out yet begins its sentence."""
        new = noisy[self._sentence[noisy] == 0]
        if len(new) == 0:
            return
        new = np.unique(new)
        self._term[new] = np.clip(2 * self._term[new], TERM_PERIODS, LONGEST_TERM)
        self._sentence[new] = self._term[new] + 1  # the rest of this period does not count
        self._mark[new] = 0.0
        self.pixels += len(new)

    def _close_period(self) -> None:
        """Each pixel left out has a period less before it if it was quiet, and its whole term again if it was not."""
        if self.pixels == 0:
            return
        out = self._sentence.nonzero()[0]
        self._sentence[out] = np.where(self._restless[out], self._term[out], self._sentence[out] - 1)
        self._mark[out] = 0.0  # what it gained in one period does not count in the next
        self.pixels = int(np.count_nonzero(self._sentence))
        self._restless.fill(False)
