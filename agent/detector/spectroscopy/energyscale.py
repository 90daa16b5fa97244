"""Gain stabilisation, as in spectrometers: the lines of the mission's nuclide are a reference for the camera's energy scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agent.detector.spectroscopy.recognition import Recogniser, prepare_readings
from agent.detector.spectroscopy.shapes import Reading
from agent.geometry import Array

MOVED_EVIDENCE = 20.0  # that the peaks are elsewhere: of many places, and looked at every few seconds
# In which one may read whose energy scale has moved: 2 % apart, and more than 5 % off.
_MOVED = tuple(Reading(float(gain)) for gain in np.geomspace(0.6, 1.7, 53) if abs(gain - 1.0) > 0.05)
_SAME_SCALE = 0.03  # relative: scales are told apart by steps of 2 %
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
        self._in_place = Recogniser((nuclide,))
        self._is_seen = False  # the nuclide, with its lines in place
        prepare_readings(nuclide, _MOVED)

    def add(self, energies_kev: Sequence[float] | Array) -> None:
        """Add the energies (keV) of events, by the present scale."""
        self._recent.add(np.asarray(energies_kev, dtype=np.float64) / self.factor)

    def look(self, now_ns: int) -> bool:
        """Evaluate again, if it is time. Returns whether the scale has moved since the look before."""
        if 0 <= now_ns - self._since_ns < _LOOK_NS or self._recent.events < _LOOK_EVENTS:  # negative: the clock was set back
            return False
        recent, self._recent, self._since_ns = self._recent, Recogniser(), now_ns
        self._in_place.restart(recent.counts)
        is_in_place = self._in_place.best() is not None
        self._is_seen = self._is_seen or is_in_place
        if not self._is_seen:
            return False
        gain = 1.0 if is_in_place else _moved_gain(recent.counts, self._nuclide)
        if gain is None or abs(gain * self.factor - 1.0) <= _SAME_SCALE:
            return False
        self.factor = 1.0 / gain
        return True

    @property
    def problems(self) -> tuple[str, ...]:
        """That it is corrected."""
        if self.factor == 1.0:
            return ()
        return (f"camera: it reads {1.0 / self.factor:.2f} of all energies, by the lines of its nuclide; corrected",)


def _moved_gain(counts: Array, nuclide: str) -> float | None:
    """Which part of its energies a camera reads that sees a nuclide with its lines elsewhere, by its counts (B,); None: not
    known, or another nuclide is recognised.
    """
    found = Recogniser((nuclide,), _MOVED, counts).best()
    if found is None or found.evidence < MOVED_EVIDENCE or Recogniser(counts=counts).best() is not None:
        return None
    return found.gain
