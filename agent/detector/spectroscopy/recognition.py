"""Nuclide recognition: the spectrum of a camera's events against the lines of the known nuclides.

The spectrum is modelled as a sum of components (``shapes``) with free, non-negative strengths. Components of a nuclide are its
full-energy peaks, with relative strengths from photons per decay and the sensor's efficiency, and its Compton continuum. The
others are peaks of the natural background, and broad humps for scattered photons and the background's continuum. For each
nuclide, and each of a few energy responses of a camera, the components are fitted by maximum likelihood (Poisson), with its peaks
and without. A nuclide is recognised if its peaks are significant, and every other nuclide explains the spectrum much worse. Also,
the spectrum must have neither a peak more than the nuclide nor one less. Only shapes enter, so neither activity nor distance need
be known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from radron.agent.detector.lines import CANDIDATES, GAMMAS
from radron.agent.detector.spectroscopy.residuals import contradiction, line_energies, single_lines
from radron.agent.detector.spectroscopy.shapes import EDGES_KEV, MIDDLES_KEV, Reading, of_nuclide, surroundings
from radron.agent.geometry import Array

MIN_LINE_EVIDENCE = 10.0  # natural logarithm of a likelihood ratio: 4.5 standard deviations
MIN_PEAK_SHARE = 0.01  # of the events in the peaks: below it, small calibration errors would be taken for peaks
MIN_EVENTS = 50
_READINGS = (*map(Reading, (0.97, 0.985, 1.0, 1.015, 1.03)), Reading(loss_kev=8.0))  # of possible cameras
_ROUNDS = (80, 40)  # iterations of the first fit, and of later fits, which start from the previous one
_MIN_STRENGTH = 1e-5  # initial strength of a component that had vanished


@dataclass(frozen=True, slots=True)
class Recognition:
    """The nuclide that explains a spectrum of event energies best, with its evidence.

    ``evidence``: natural logarithm of the likelihood ratio of the spectrum with the nuclide's peaks to the spectrum without them,
    or to the spectrum with the next best nuclide, whichever is less. ``peak_events``: events in the nuclide's peaks. ``events``:
    events in the spectrum. ``against``: a feature of the spectrum that contradicts the nuclide, in words, or None. ``gain``:
    estimated gain of the camera relative to its calibration.
    """

    nuclide: str
    evidence: float
    peak_events: float
    events: int
    against: str | None = None
    gain: float = 1.0

    @property
    def certain(self) -> bool:
        """Whether the nuclide is recognised with certainty: enough evidence, enough events in its peaks, and nothing
        against it.
        """
        return self.against is None and self.evidence >= MIN_LINE_EVIDENCE and self.peak_events >= MIN_PEAK_SHARE * self.events


class Recogniser:
    """Collects event energies in a spectrum, and finds the nuclide that explains it."""

    def __init__(
        self,
        candidates: Sequence[str] = CANDIDATES,
        readings: tuple[Reading, ...] = _READINGS,
        counts: Array | None = None,
    ) -> None:
        """Set up an empty spectrum, or one that begins with given counts.

        ``candidates``: the nuclides that can be recognised; ``readings``: the ways in which the camera may read energies (gain
        and charge loss); ``counts``: (B,) events in each of the B energy bins, to begin with.
        """
        self._candidates, self._readings = tuple(candidates), readings
        self._counts: Array = np.zeros(len(MIDDLES_KEV)) if counts is None else counts
        self._peaks: Array | None = None  # component shares (C G, K) of the last fit
        self._plain: dict[int, Array] = {}  # by candidate, (G, K - 1) of its last fit without peaks

    def add(self, energies_kev: Sequence[float] | Array) -> None:
        """Add the energies (keV) of events to the spectrum: of single clusters, and the sums over the clusters of one photon."""
        place = np.searchsorted(EDGES_KEV, energies_kev)  # 0 and the last are outside of the spectrum
        self._counts = self._counts + np.bincount(place, minlength=len(EDGES_KEV) + 1)[1:-1]

    @property
    def counts(self) -> Array:
        """The spectrum: events in each energy bin, (B,)."""
        return self._counts

    @property
    def events(self) -> int:
        """Number of events in the spectrum, which reaches from 45 to 1600 keV."""
        return int(self._counts.sum())

    def best(self) -> Recognition | None:
        """Return the recognised nuclide; None if no nuclide stands out, or none explains the spectrum."""
        found = self.look()
        return found if found is not None and found.certain else None

    def look(self) -> Recognition | None:
        """Evaluate the spectrum, and return the nuclide that fits best, however badly; None with fewer than MIN_EVENTS."""
        if self.events < MIN_EVENTS:
            return None
        parts = _parts(self._candidates, self._readings)
        likelihood, peaks = self._fitted(parts, self._peaks)
        self._peaks = peaks
        by_nuclide = likelihood.reshape(len(self._candidates), len(self._readings))
        first = int(by_nuclide.max(axis=1).argmax())
        reading = int(by_nuclide[first].argmax())
        others = np.delete(by_nuclide, first, axis=0).max(initial=-np.inf)
        begin = first * len(self._readings)
        place = begin + reading
        without, self._plain[first] = self._fitted(parts[begin : begin + len(self._readings), 1:], self._plain.get(first))
        evidence = likelihood[place] - max(without.max(), others)
        expected = peaks[place] @ parts[place] * self._counts.sum()
        nuclide = self._candidates[first]
        read = self._readings[reading].gain
        against = contradiction(self._counts, expected, [energy * read for energy, _ in GAMMAS[nuclide]])
        weights = np.exp(by_nuclide[first] - by_nuclide[first, reading])
        gain = float(np.average([each.gain for each in self._readings], weights=weights))
        return Recognition(nuclide, float(evidence), float(peaks[place, 0]) * self.events, self.events, against, gain)

    def _fitted(self, parts: Array, before: Array | None) -> tuple[Array, Array]:
        """As ``fitted``, going on from the shares of the fit before; None: this is the first one."""
        return fitted(self._counts, parts, before, _ROUNDS[0 if before is None else 1])

    def unknown_lines_kev(self, found: Recognition | None) -> tuple[int, ...]:
        """Return the energies (keV) of the peaks in a spectrum that no known nuclide explains.

        found: the result of the last ``look``; if the spectrum does not contradict it, there are no such peaks.
        """
        if found is None or found.against is None:
            return ()
        return line_energies(self._counts, surroundings(), fitted)

    def foreign_lines_kev(self, nuclides: Sequence[str]) -> tuple[int, ...]:
        """Return the energies (keV) of the peaks in the spectrum that no mixture of these nuclides explains."""
        if self.events < MIN_EVENTS:
            return ()
        parts = mixtures(tuple(nuclides), _READINGS)
        likelihood, _ = fitted(self._counts, parts, None, _ROUNDS[0])
        return line_energies(self._counts, parts[int(likelihood.argmax())], fitted)

    def present(self, nuclides: Sequence[str]) -> tuple[str, ...]:
        """Return those of the given nuclides without which their mixture does not explain the spectrum; weak ones are left out
        first.
        """
        if self.events < MIN_EVENTS:
            return ()
        every = mixtures(tuple(nuclides), _READINGS)
        likelihood, shares = fitted(self._counts, every, None, _ROUNDS[0])
        best = int(likelihood.argmax())
        most, parts, peaks = likelihood[best], every[best], shares[best, : 2 * len(nuclides) : 2]
        left = list(nuclides)
        for place in peaks.argsort().tolist():
            own = 2 * left.index(nuclides[place])
            without = np.delete(parts, (own, own + 1), axis=0)
            least = fitted(self._counts, without[None], None, _ROUNDS[0])[0][0]
            if peaks[place] < MIN_PEAK_SHARE or most - least < MIN_LINE_EVIDENCE:
                left.remove(nuclides[place])
                most, parts = least, without
        return tuple(left)


def fitted(counts: Array, parts: Array, share: Array | None, rounds: int) -> tuple[Array, Array]:
    """Fit a spectrum as a mixture of component spectra, for several candidate sets of components at once.

    Return the largest log likelihood of each of the C candidates (C,), and the share of each of its K components in the events
    (C, K). Expectation maximisation: the shares stay positive and add up to 1.

    counts: (B,) events in B energy bins. parts: (C, K, B) spectra of the K components of each candidate, each with sum 1. share:
    (C, K) shares to start from; None: equal shares. rounds: number of iterations.
    """
    share = _even(parts) if share is None else share
    present = counts > 0
    counts, parts = counts[present], parts[:, :, present]
    total = counts.sum()
    share = np.maximum(share, _MIN_STRENGTH)
    for _ in range(rounds):
        ratio = counts / np.maximum(share[:, None, :] @ parts, 1e-12)
        share = share * (parts @ ratio.transpose(0, 2, 1))[:, :, 0] / total
    mixed = np.maximum(share[:, None, :] @ parts, 1e-12)[:, 0]
    return (counts * np.log(mixed)).sum(axis=1), share


def prepare(expected: Sequence[str]) -> None:
    """Compute tables for recognition now, before the flight: at the first evaluation they would take longer than a control step.

    expected: the nuclides that the mission expects.
    """
    _parts(CANDIDATES, _READINGS)
    single_lines()
    if len(expected) > 1:
        mixtures(tuple(expected), _READINGS)


@cache
def mixtures(nuclides: tuple[str, ...], readings: tuple[Reading, ...]) -> Array:
    """Return G sets of K component spectra (G, K, B) over B energy bins, one set for each way in which the camera may read
    energies.

    Each set has peaks and continuum of each nuclide, then the components common to all nuclides (background and scattered
    photons).
    """
    return np.concatenate((*(_read(name, readings) for name in nuclides), _common(readings)), axis=1)


@cache
def _read(nuclide: str, readings: tuple[Reading, ...]) -> Array:
    """(G, 2, B): peaks and continuum of a nuclide by reading."""
    return np.array([of_nuclide(GAMMAS[nuclide], reading) for reading in readings])


@cache
def _common(readings: tuple[Reading, ...]) -> Array:
    """(G, K, B): the components common to all nuclides, by reading."""
    return np.array([surroundings(reading) for reading in readings])


def _even(parts: Array) -> Array:
    return np.full(parts.shape[:2], 1.0 / parts.shape[1])


@cache
def _parts(candidates: tuple[str, ...], readings: tuple[Reading, ...]) -> Array:
    """(C G, K, B): for each candidate and reading its peaks and continuum, then the components common to all."""
    return np.concatenate([mixtures((name,), readings) for name in candidates])
