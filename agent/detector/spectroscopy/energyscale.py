"""Gain stabilisation, as in spectrometers: the lines of the nuclides in view are a reference for the camera's energy scale.

A Kalman filter has two states. State g is the natural logarithm of the gain over that of the calibration, a random walk. State e
is the constant error of reading the place of the lines. A reading is z = g + e + noise, its noise from the likelihood of the
spectrum by gain. So the scale follows every change from its first evidence on, as far as the readings show it. The scale leaves
the calibration only as far as the lines are read more exactly than a camera is calibrated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from radron.agent.detector.lines import CANDIDATES, GAMMAS
from radron.agent.detector.spectroscopy.recognition import MIN_LINE_EVIDENCE, MIN_PEAK_SHARE, Recogniser, fitted, mixtures
from radron.agent.detector.spectroscopy.residuals import contradiction
from radron.agent.detector.spectroscopy.shapes import Reading, strongest_line_kev
from radron.agent.geometry import Array
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

CALIBRATION_SIGMA = 0.02  # relative, of the gain at the start
# Of the places of the lines as they are modelled: relative, and charge that pixels lose below their thresholds. Spectra of 6,000
# transported events of 11 nuclides are read 0.1 to 0.7 % high; that of Am-241, 0.8 keV low.
LINE_SIGMA, LOSS_SIGMA_KEV = 0.005, 1.0
DRIFT_SIGMA = 0.001  # of the random walk of the gain, in a second: follows 1 % a minute to 0.1 %
_READING_SIGMA = 0.001  # least error of a reading: the bins are 2.6 % wide
MOVED_EVIDENCE = 20.0  # of a jump: the peaks are looked for in many places, and every few seconds
_NEAR = 0.06  # relative: further off, another nuclide may be taken for that of the reference
_STEP = 0.01  # between two readings; a peak's resolution is 2 to 3 times as wide
NEAR_READINGS = tuple(Reading(math.exp(_STEP * step)) for step in range(-round(_NEAR / _STEP) - 1, round(_NEAR / _STEP) + 2))
FAR = tuple(Reading(math.exp(_STEP * step)) for step in range(-54, 56))
MIN_TOLD, MAX_UNTOLD = 0.035, 0.025  # relative error of the gain: a report to operators begins above, and ends below
# Between two looks: enough for a reading, and mostly from before or after the scale has jumped.
_LOOK_NS, _LOOK_EVENTS = 2_000_000_000, 400
_ROUNDS = 80


class EnergyScale:
    """Follows the drifting gain of one camera in flight by the gamma lines of the nuclides in view.

    ``factor``: factor by which the energies of the calibration must be multiplied. A jump of the gain by more than 6 % is
    followed if the nuclide is named by the mission, and its lines have been seen without the jump.
    """

    def __init__(self, named: str | None) -> None:
        """Start with the calibration's gain. ``named``: the nuclide of the one source that the mission names; None: see
        ``follow``.
        """
        self.factor = 1.0
        self._is_read = False  # whether the lines have been seen where the scale has them
        self._named, self._nuclides = named, tuple[str, ...]()
        self._state, self._covariance = np.zeros(2), np.zeros((2, 2))  # g and e
        self._recent = Recogniser()  # energies since the last look
        self._since_ns: int | None = None
        self._is_told = False  # that the gain is off
        for nuclide in CANDIDATES:  # the slow part in advance, for each nuclide that may be followed in flight
            mixtures((nuclide,), NEAR_READINGS)
        if named is not None:
            self.follow((named,))
            mixtures((named,), FAR)

    def follow(self, nuclides: tuple[str, ...]) -> None:
        """Set the nuclides that give the reference lines of the gain; no nuclides keep the present reference.

        The lines of new nuclides get an uncertainty of their own. If all nuclides are new, the gain was found by wrong lines, and
        the calibration holds again.
        """
        if not nuclides or nuclides == self._nuclides:
            return
        if set(nuclides).isdisjoint(self._nuclides):
            self._state[0], self._covariance[0, 0], self._is_read = 0.0, CALIBRATION_SIGMA**2, False
            self._tell()
        self._nuclides = nuclides
        self._state[1] = self._covariance[0, 1] = self._covariance[1, 0] = 0.0
        self._covariance[1, 1] = LINE_SIGMA**2 + (LOSS_SIGMA_KEV / max(map(strongest_line_kev, nuclides))) ** 2

    def add(self, energies_kev: Sequence[float] | Array) -> None:
        """Add the energies (keV) of events, already multiplied with the present factor, to the spectrum of the next update."""
        self._recent.add(energies_kev)

    def look(self, now_ns: int) -> bool:
        """Update the gain if enough time has passed and enough events have come. Return whether the gain has jumped since the
        last update.
        """
        if self._since_ns is None:
            self._since_ns = now_ns
        elapsed_ns = now_ns - self._since_ns
        if elapsed_ns < _LOOK_NS or self._recent.events < _LOOK_EVENTS:
            return False
        counts, self._recent, self._since_ns = self._recent.counts, Recogniser(), now_ns
        self._covariance[0, 0] += DRIFT_SIGMA**2 * 1e-9 * elapsed_ns
        if not self._nuclides:
            return False
        near = read(counts, self._nuclides, NEAR_READINGS, MIN_LINE_EVIDENCE)
        if near is not None:
            self._is_read = True
            self._correct(*near)
            return False
        return self._is_read and self._jumped(counts)

    def _correct(self, moved: float, sigma: float) -> None:
        """Update by a reading: logarithm of the gain over that of the present scale, and its error."""
        spread = self._covariance.sum(axis=1)
        share = spread / (spread.sum() + sigma**2 + _READING_SIGMA**2)
        self._state += share * (moved - self._state[1])  # expected: e alone, as g is corrected
        self._covariance -= np.outer(share, spread)
        self._tell()

    def _jumped(self, counts: Array) -> bool:
        """Whether the named nuclide's lines, and no other nuclide's, are far from their places: the scale begins anew there."""
        far = read(counts, self._nuclides, FAR, MOVED_EVIDENCE) if self._nuclides == (self._named,) else None
        if far is None or Recogniser(counts=counts).best() is not None:
            return False
        moved, sigma = far
        self._state[0] += moved - self._state[1]
        self._covariance[0, 0] += sigma**2
        self._tell()
        return True

    def _tell(self) -> None:
        """Derive what follows from the state."""
        self.factor = math.exp(-float(self._state[0]))
        self._is_told = abs(1.0 / self.factor - 1.0) > (MAX_UNTOLD if self._is_told else MIN_TOLD)

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """A line for the operator while the camera's gain deviates by more than is usual for a calibrated camera; empty
        otherwise.
        """
        if not self._is_told:
            return ()
        off = 1.0 / self.factor - 1.0
        way = "high" if off > 0.0 else "low"
        text = f"camera: gain {100.0 * abs(off):.0f} % {way}, by the lines of its nuclide; corrected"
        return (CodedText(Code.CAMERA_GAIN, text),)


def read(counts: Array, nuclides: tuple[str, ...], readings: tuple[Reading, ...], evidence: float) -> tuple[float, float] | None:
    """Estimate the gain of a camera from a spectrum of known nuclides. Return the logarithm of the gain, and its 1 sigma.

    The gain has the maximum of the likelihood, sigma follows from the curvature. Return None if the maximum is the first or the
    last gain tried; if the spectrum can be explained without the nuclides' peaks (log likelihood ratio below ``evidence``); if it
    has other peaks, or lacks some.

    counts: (B,) events in B energy bins. readings: the gains to try, equally spaced in the logarithm.
    """
    if counts.sum() < 1.0:
        return None
    parts, peaks = mixtures(nuclides, readings), 2 * len(nuclides)
    likelihood, shares = fitted(counts, parts, None, _ROUNDS)
    best = int(likelihood.argmax())
    if not 0 < best < len(readings) - 1 or shares[best, :peaks:2].sum() < MIN_PEAK_SHARE:
        return None
    without = np.delete(parts[best], range(0, peaks, 2), axis=0)
    if likelihood[best] - fitted(counts, without[None], None, _ROUNDS)[0][0] < evidence:
        return None
    lines = [energy * readings[best].gain for nuclide in nuclides for energy, _ in GAMMAS[nuclide]]
    if contradiction(counts, shares[best] @ parts[best] * counts.sum(), lines) is not None:
        return None
    below, at, above = likelihood[best - 1 : best + 2].tolist()
    curvature = max(2.0 * at - below - above, 1e-3)
    place = math.log(readings[best].gain) + 0.5 * _STEP * (above - below) / curvature
    return place, _STEP / math.sqrt(curvature)
