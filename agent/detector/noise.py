"""Masking of noisy pixels: pixels that fire far more often than the mean are left out of the counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.readout import SENSOR_PIXELS, PixelHits
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

BEAT_NS = 100_000_000  # a burst falls within one beat, or two
MAX_RATE_RATIO = 400  # rate limit of a pixel, in multiples of the mean of all pixels
NOISY_EXCESS = 9.0  # sum of excess beats at which a pixel is masked
QUIET = 1.0  # most beats per period in which a masked pixel may fire and still count as quiet
PERIOD_BEATS = 200
MASK_PERIODS = 3  # consecutive quiet periods until a pixel is unmasked; doubled after each relapse
MAX_MASK_READOUTS = 192  # an hour
_PIXELS = SENSOR_PIXELS**2


class NoiseMask:
    """Finds the noisy pixels of one camera, which fire far more often than the mean, and leaves out their hits.

    ``masked_hits`` counts the hits left out so far, ``pixels`` the pixels masked now.

    Time is divided into beats of 0.1 s. With m the mean number of hits of a healthy pixel in a beat, a pixel with c hits gains
    min(c, 1 + MAX_RATE_RATIO m) - MAX_RATE_RATIO m. The gain is about 1 at most, however many hits a burst has, and negative
    while the pixel fires no more than MAX_RATE_RATIO times as often as the mean. The sum is kept at 0 or above (Page's CUSUM
    test, Biometrika 41, 1954). A pixel whose sum exceeds NOISY_EXCESS is masked. With background only, a pixel that fires 30
    times a second is masked after a second, a pixel that fires once a second after ten. A pixel that adds less than
    MAX_RATE_RATIO / 65536 = 0.6 % to the hits of all pixels is never masked. Consequently more than 160 equally noisy pixels,
    such as a column or a row, raise the mean so far that none is masked. Noise of that kind is not detected.

    A healthy pixel is not masked. At a mean of 0.0001 hits a second (the natural background) it would have to be hit ten times
    within minutes, and in any field 400 times as often as the other pixels. The border of a sensor irradiated from the side is
    hit only a few times as often.

    A noisy pixel is unmasked after a minute in which it was quiet, and after twice as long whenever that was too soon. Each
    masked pixel removes 1.5e-5 of the sensor's area from the counts, which is not corrected for.
    """

    def __init__(self) -> None:
        self.masked_hits = 0
        self.pixels = 0
        self._beat = 0
        self._fired: list[NDArray[np.uint16]] = []  # in this beat
        self._expected = 0.0  # MAX_RATE_RATIO m, summed over all beats so far
        self._mark = np.zeros(_PIXELS)  # a pixel's sum when it last fired, plus _expected at that time
        self._fired_in_period = np.zeros(_PIXELS, np.bool_)  # fired in this period
        self._masked_periods = np.zeros(_PIXELS, np.int16)  # periods until it is unmasked; 0: not masked
        self._term = np.zeros(_PIXELS, np.int16)  # length of its latest mask, periods

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """A line for the operator while noisy pixels are masked; empty otherwise."""
        if self.pixels == 0:
            return ()
        text = f"camera: {self.pixels} noisy {'pixel' if self.pixels == 1 else 'pixels'} masked"
        return (CodedText(Code.CAMERA_NOISY, text),)

    def without_noise(self, hits: PixelHits, clock_ns: int, since_ns: int) -> PixelHits:
        """Return the hits, sorted by time, without the hits of noisy pixels.

        clock_ns: time of tick 0. since_ns: time before which hits are late (or have a wrong stamp); they count at that
        time.

        A time interval of 0.1 s (beat) is evaluated when the next one begins, so that the result does not depend on how the hits
        are divided into calls.
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
                kept[first:end] = self._masked_periods[index] == 0
            first = end
        if kept is None or kept.all():
            return hits
        self.masked_hits += count - int(np.count_nonzero(kept))
        return hits.take(kept)

    def _advance(self, beat: int) -> None:
        """Advance to the beat, evaluating the beats before it."""
        if self._beat - PERIOD_BEATS < beat <= self._beat:  # further back: the clock was set
            return
        if self._fired:
            self._judge(np.concatenate(self._fired))
            self._fired.clear()
        if beat // PERIOD_BEATS != self._beat // PERIOD_BEATS:
            self._end_period()
        self._beat = beat

    def _judge(self, fired: NDArray[np.uint16]) -> None:
        """Evaluate a beat in which the pixels (N,) fired, each as often as listed, and mask the noisy ones."""
        healthy = np.count_nonzero(self._masked_periods[fired] == 0) if self.pixels else len(fired)
        expected = MAX_RATE_RATIO * healthy / _PIXELS
        most = 1 + round(expected)
        times: int | NDArray[np.intp] = 1  # where a pixel is listed twice, the assignment below would count it once
        if most > 1:
            fired, counts = np.unique(fired, return_counts=True)
            times = np.minimum(counts, most)
        mark = np.maximum(self._mark[fired], self._expected) + times
        self._mark[fired] = mark
        self._expected += expected
        if self.pixels:
            self._fired_in_period[fired[mark > self._expected + QUIET]] = True
        if mark.max() > self._expected + NOISY_EXCESS:
            self._mask_pixels(fired[mark > self._expected + NOISY_EXCESS])

    def _mask_pixels(self, noisy: NDArray[np.uint16]) -> None:
        """Mask the pixels among them that are not masked yet."""
        new = noisy[self._masked_periods[noisy] == 0]
        if len(new) == 0:
            return
        new = np.unique(new)
        self._term[new] = np.clip(2 * self._term[new], MASK_PERIODS, MAX_MASK_READOUTS)
        self._masked_periods[new] = self._term[new] + 1  # the rest of this period does not count
        self._mark[new] = 0.0
        self.pixels += len(new)

    def _end_period(self) -> None:
        """Count the period for each masked pixel that was quiet, and restart the count of the others."""
        if self.pixels == 0:
            return
        out = self._masked_periods.nonzero()[0]
        self._masked_periods[out] = np.where(self._fired_in_period[out], self._term[out], self._masked_periods[out] - 1)
        self._mark[out] = 0.0  # excess of one period does not count in the next
        self.pixels = int(np.count_nonzero(self._masked_periods))
        self._fired_in_period.fill(False)
