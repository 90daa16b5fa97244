"""Noisy pixels: those that fire far more often than their fellows are left out of what the camera counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agent.detector.readout import SENSOR_PIXELS, PixelHits

BEAT_NS = 100_000_000  # one burst is within one of them
PERIOD_BEATS = 200  # after which the count begins anew
LEAST_BEATS = 9  # in which a pixel fires too often before it is left out
SHARE = 200  # times the mean of all pixels is too often
QUIET_BEATS = 1  # within a period are none of a noisy pixel any more
TERM_PERIODS = 3  # in which a pixel has to be quiet to be let in again; twice as many after each relapse
LONGEST_TERM = 192  # an hour
_PIXELS = SENSOR_PIXELS**2


class NoiseMask:
    """Which pixels of one camera are noisy. ``masked_hits`` counts the hits that they have been left out with.

    Time is cut into beats of 0.1 s. With m the mean number of hits of a pixel in a beat, one with c hits gains
    min(c, 1 + SHARE m) - SHARE m: at most 1, however many hits a burst has, and less than nothing while it fires no more than
    SHARE times as often as the mean. Who has gained more than LEAST_BEATS within a period of 20 s is noisy. So a pixel that fires
    30 times a second is left out after a second, one that fires once a second after some ten, and one that adds less
    than SHARE / 65536 = 0.3 % to the hits of all pixels never, because it does no harm.

    A healthy pixel is not touched. The background makes 8 hits a second on all pixels together, so 0.002 on each within a period:
    ten beats with a hit of the same one do not happen (0.002^10 / 10!). In any field it would have to fire 200 times as often as
    the mean; the border of the sensor facing a source that shines on its edge has some three times the mean (measured with the
    simulated camera: I-131 and Ir-192, 2.3 to 3.4).

    A noisy pixel is let in again after a minute in which it was quiet, and after twice as long whenever it was too soon. Each one
    takes 1.5e-5 of the sensor's area from the counts, for which nothing is corrected.
    """

    def __init__(self) -> None:
        self.masked_hits = 0
        self.pixels = 0  # that are left out now
        self._beat = 0
        self._fired: list[NDArray[np.uint16]] = []  # in this beat
        self._expected = 0.0  # SHARE times the mean of the beats of this period
        self._score = np.zeros(_PIXELS, np.int32)  # sum of min(c, 1 + SHARE m) over them
        self._sentence = np.zeros(_PIXELS, np.int16)  # periods until it is let in; 0: is not left out
        self._term = np.zeros(_PIXELS, np.int16)  # of its latest sentence

    @property
    def problems(self) -> tuple[str, ...]:
        """What the operator has to know, a line or none."""
        if self.pixels == 0:
            return ()
        return (f"camera: {self.pixels} noisy {'pixel' if self.pixels == 1 else 'pixels'} masked",)

    def without_noise(self, hits: PixelHits, clock_ns: int) -> PixelHits:
        """The hits, sorted by time, less those of noisy pixels. ``clock_ns``: UTC time of tick 0.

        A beat is judged when the next one begins, so that the result does not depend on how many hits are given at a time. Hits
        that come late belong to the present beat.
        """
        count = len(hits)
        kept: NDArray[np.bool_] | None = None
        first = 0
        while first < count:
            beat = (clock_ns + int(hits.tick[first]) * 25 // 16) // BEAT_NS
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
        if most > 1:
            fired.sort()
            last = np.append(fired[1:] != fired[:-1], True).nonzero()[0]  # of each pixel's hits
            fired = fired[last]
            score = self._score[fired] + np.minimum(np.diff(last, prepend=-1), most)
        else:
            score = self._score[fired] + 1  # once, also where a pixel stands there twice
        self._score[fired] = score
        self._expected += expected
        limit = LEAST_BEATS + self._expected
        if score.max() > limit:
            self._leave_out(fired[score > limit])

    def _leave_out(self, noisy: NDArray[np.uint16]) -> None:
        """Who is among them and not left out yet begins its sentence."""
        new = np.unique(noisy[self._sentence[noisy] == 0])
        self._term[new] = np.clip(2 * self._term[new], TERM_PERIODS, LONGEST_TERM)
        self._sentence[new] = self._term[new]
        self.pixels += len(new)

    def _close_period(self) -> None:
        """Each pixel left out has a period less before it if it was quiet, and its whole term again if it was not."""
        if self.pixels:
            out = self._sentence.nonzero()[0]
            quiet = self._score[out] <= QUIET_BEATS + self._expected
            self._sentence[out] = np.where(quiet, self._sentence[out] - 1, self._term[out])
            self.pixels = int(np.count_nonzero(self._sentence))
        self._score.fill(0)
        self._expected = 0.0
