"""Gain stabilisation, as in spectrometers: the lines of the mission's nuclide are a reference for the camera's energy scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agent.detector.spectroscopy.recognition import Recogniser, prepare_readings
from agent.detector.spectroscopy.shapes import Reading
from agent.geometry import Array

MOVED_EVIDENCE = 20.0  # that the peaks are elsewhere: of many places, and looked at every few seconds
# Ways in which a camera of this nuclide may read energies: 1 % apart within the range of a drift, 2 % beyond.
_NEAR, _FAR = 0.10, 0.6
_READINGS = tuple(
    Reading(float(gain))
    for gain in (*np.arange(1.0 - _NEAR, 1.0 + _NEAR + 0.005, 0.01), *np.geomspace(_FAR, 0.88, 20), *np.geomspace(1.12, 1.7, 21))
)
_IN_PLACE = 0.035  # relative: a scale that is off by more, read to 1 %, is corrected, and told
_SAME_SCALE = 0.025  # relative: a corrected scale stays while it is off by no more
_DISTANT = 0.06  # relative: further off, another nuclide may be taken for it
# Between two looks: enough to tell the scale to 1 %, and mostly from before or after it has moved.
_LOOK_NS, _LOOK_EVENTS = 2_000_000_000, 400


class EnergyScale:
    """A camera that has seen the lines of its nuclide where they are, and later finds them elsewhere, has a scale that has moved.

    ``factor``: by which the energies of the calibration are to be multiplied.
    """

    def __init__(self, nuclide: str) -> None:
        """``nuclide``: the mission's, of which the one source is."""
        self.factor = 1.0
        self._nuclide = nuclide
        self._recent, self._since_ns = Recogniser(), 0  # since the last look: energies by the calibration
        self._is_seen = False  # the nuclide, with its lines in place
        prepare_readings(nuclide, _READINGS)

    def add(self, energies_kev: Sequence[float] | Array) -> None:
        """Add the energies (keV) of events, by the present scale."""
        self._recent.add(np.asarray(energies_kev, dtype=np.float64) / self.factor)

    def look(self, now_ns: int) -> bool:
        """Evaluate again, if it is time. Returns whether the scale has moved since the look before."""
        if 0 <= now_ns - self._since_ns < _LOOK_NS or self._recent.events < _LOOK_EVENTS:  # negative: the clock was set back
            return False
        recent, self._recent, self._since_ns = self._recent, Recogniser(), now_ns
        gain = _gain(recent.counts, self._nuclide)
        if gain is None:
            return False
        is_in_place = abs(gain - 1.0) <= _IN_PLACE
        self._is_seen = self._is_seen or is_in_place
        before = self.factor
        if self._is_seen and abs(gain * before - 1.0) > (_IN_PLACE if before == 1.0 else _SAME_SCALE):
            self.factor = 1.0 if is_in_place else 1.0 / gain
        return self.factor != before

    @property
    def problems(self) -> tuple[str, ...]:
        """By how much the gain is off, where it is corrected."""
        if self.factor == 1.0:
            return ()
        percent = 100.0 * (1.0 / self.factor - 1.0)
        way = "high" if percent > 0.0 else "low"
        return (f"camera: gain {abs(percent):.0f} % {way}, by the lines of its nuclide; corrected",)


def _gain(counts: Array, nuclide: str) -> float | None:
    """Energies that a camera reads over true ones, by its counts (B,) of a nuclide; None: not known, or another nuclide is
    recognised.
    """
    found = Recogniser((nuclide,), _READINGS, counts).best()
    if found is None:
        return None
    off = abs(found.gain - 1.0)
    unsure = off > _IN_PLACE and found.evidence < MOVED_EVIDENCE
    return None if unsure or (off > _DISTANT and Recogniser(counts=counts).best() is not None) else found.gain
