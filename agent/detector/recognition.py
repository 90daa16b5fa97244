"""Nuclide recognition: the spectrum of a camera's events against the lines of the known nuclides.

The spectrum is modelled as a sum of components with free, non-negative strengths: full-energy peaks of a nuclide, with relative
strengths from photons per decay and the sensor's efficiency; its Compton continuum (Klein-Nishina); peaks of the natural
background (K, U and Th series); and broad humps for scattered photons and the background's continuum. For each nuclide the
components are fitted by maximum likelihood (Poisson), with its peaks and without. A nuclide is recognised where its peaks are
significant and every other nuclide explains the spectrum much worse. Only shapes enter, so neither activity nor distance need be
known.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import erf

from agent.detector.cones import compton_edge_kev, klein_nishina_recoil
from agent.detector.lines import GAMMAS
from agent.detector.sensor import attenuation_per_mm, energy_variance
from agent.geometry import Array
from protocol.messages import Recognised

CANDIDATES = tuple(name for name in GAMMAS if name != "K-40")  # present everywhere
LEAST_EVIDENCE = 10.0  # natural logarithm of a likelihood ratio: 4.5 standard deviations
LEAST_SHARE = 0.01  # of the events in the peaks: below it, small calibration errors would be taken for peaks
LEAST_EVENTS = 50
LOOK_NS = 10_000_000_000
_EDGES_KEV: Array = np.geomspace(45.0, 1600.0, 141)  # 2.6 % wide: one standard deviation of the resolution
_HUMPS = 9
_ROUNDS = (150, 40)  # iterations of the first fit, and of later ones, which start from the one before
_LEAST_STRENGTH = 1e-5  # initial strength of a component that had vanished

# Effective area for full-energy events, mm2, mean over all directions, by energy in keV: photons that the simulated sensor turns
# into a peak of the agent's resolution.
_PEAK_KEV = (60.0, 80.0, 120.0, 160.0, 210.0, 280.0, 365.0, 470.0, 600.0, 760.0, 960.0, 1173.0, 1400.0)
_PEAK_MM2 = (75.5, 81.3, 70.6, 50.4, 31.1, 17.0, 9.48, 5.50, 3.27, 1.97, 1.21, 0.786, 0.535)

# Strongest lines of the natural background by series, keV and photons per decay (Decay Data Evaluation Project).
_NATURAL: tuple[tuple[tuple[float, float], ...], ...] = (
    ((1460.82, 0.1055),),
    ((295.22, 0.184), (351.93, 0.356), (609.31, 0.455), (768.36, 0.049), (1120.29, 0.149), (1238.12, 0.058)),
    ((238.63, 0.436), (338.32, 0.114), (583.19, 0.306), (727.33, 0.067), (911.20, 0.262), (968.96, 0.159)),
)


@dataclass(frozen=True, slots=True)
class Recognition:
    """``evidence``: natural logarithm of the likelihood ratio of the spectrum with the nuclide's peaks to that without them, or
    to that with the next best nuclide, whichever is less. ``peak_events``: events in its peaks. ``events``: in the spectrum.
    """

    nuclide: str
    evidence: float
    peak_events: float
    events: int

    @property
    def certain(self) -> bool:
        """Whether the nuclide is recognised with certainty."""
        return self.evidence >= LEAST_EVIDENCE and self.peak_events >= LEAST_SHARE * self.events


class Recogniser:
    """Accumulates event energies; ``look`` evaluates them."""

    def __init__(self) -> None:
        self._counts: Array = np.zeros(len(_EDGES_KEV) - 1)
        self._shares: tuple[Array, Array] | None = None  # component shares of the last fit, with peaks and without

    def add(self, energies_kev: Sequence[float] | Array) -> None:
        """Add the energies (keV) of events: single clusters, and sums over the clusters of one photon."""
        place = np.searchsorted(_EDGES_KEV, energies_kev)  # 0 and the last are outside of the spectrum
        self._counts += np.bincount(place, minlength=len(_EDGES_KEV) + 1)[1:-1]

    @property
    def events(self) -> int:
        """Number of events between 45 and 1600 keV."""
        return int(self._counts.sum())

    def best(self) -> Recognition | None:
        """The recognised nuclide; None where none stands out."""
        found = self.look()
        return found if found is not None and found.certain else None

    def look(self) -> Recognition | None:
        """The nuclide that fits best, however badly; None with fewer than LEAST_EVENTS."""
        if self.events < LEAST_EVENTS:
            return None
        parts = _parts()
        first_time = self._shares is None
        peaks, plain = self._shares or (_even(parts), _even(parts[:, 1:]))
        rounds = _ROUNDS[0] if first_time else _ROUNDS[1]
        likelihood, peaks = _fitted(self._counts, parts, peaks, rounds)
        without, plain = _fitted(self._counts, parts[:, 1:], plain, rounds)
        self._shares = peaks, plain
        first, second = np.argsort(-likelihood)[:2]
        evidence = likelihood[first] - max(without[first], likelihood[second])
        return Recognition(CANDIDATES[first], float(evidence), float(peaks[first, 0]) * self.events, self.events)


class NuclideWatch:
    """Recognises the nuclide in flight, every LOOK_NS, and compares it with the mission's."""

    def __init__(self, expected: str) -> None:
        self._expected = expected
        self._recogniser = Recogniser()
        _parts()  # computed now: in flight it would take longer than a control step
        self._looked_ns: int | None = None
        self.recognised: Recognition | None = None

    def add(self, energies_kev: Sequence[float] | Array) -> None:
        """Add the energies (keV) of events."""
        self._recogniser.add(energies_kev)

    def look(self, now_ns: int) -> None:
        """Evaluate again, if it is time."""
        if self._looked_ns is None:
            self._looked_ns = now_ns
        elif now_ns - self._looked_ns >= LOOK_NS:
            self._looked_ns = now_ns
            self.recognised = self._recogniser.best()

    @property
    def message(self) -> Recognised | None:
        """The result for the status message."""
        found = self.recognised
        return None if found is None else Recognised(found.nuclide, found.evidence)

    @property
    def problems(self) -> tuple[str, ...]:
        """A line where the spectrum contradicts the mission's nuclide, or none."""
        found = self.recognised
        if found is None or found.nuclide == self._expected:
            return ()
        return (
            f"the camera's spectrum is that of {found.nuclide} (evidence {found.evidence:.0f}), the mission is after "
            f"{self._expected}; set its nuclide",
        )


def _even(parts: Array) -> Array:
    return np.full(parts.shape[:2], 1.0 / parts.shape[1])


def _fitted(counts: Array, parts: Array, share: Array, rounds: int) -> tuple[Array, Array]:
    """Largest log likelihood of each candidate (C,), and the shares (C, K) of its components (C, K, B) in the counts (B,).

    Expectation maximisation from ``share``: it keeps the strengths positive and their sum equal to that of the counts.
    """
    present = counts > 0
    counts, parts = counts[present], parts[:, :, present]
    total = counts.sum()
    share = np.maximum(share, _LEAST_STRENGTH)
    for _ in range(rounds):
        ratio = counts / np.maximum(share[:, None, :] @ parts, 1e-12)
        share = share * (parts @ ratio.transpose(0, 2, 1))[:, :, 0] / total
    mixed = np.maximum(share[:, None, :] @ parts, 1e-12)[:, 0]
    return (counts * np.log(mixed)).sum(axis=1), share


def _peaks(lines: Iterable[tuple[float, float]]) -> Array:
    """Shares (B,) of the events in the full-energy peaks of lines (keV, photons per decay)."""
    shape = np.zeros(len(_EDGES_KEV) - 1)
    for energy, photons in lines:
        area = np.exp(np.interp(np.log(energy), np.log(_PEAK_KEV), np.log(_PEAK_MM2)))
        shape += photons * area * np.diff(_normal((_EDGES_KEV - energy) / energy_variance(energy) ** 0.5))
    return _normalised(shape)


def _continuum(lines: Iterable[tuple[float, float]]) -> Array:
    """Shares (B,) of the events that are recoil electrons of photons that scattered once and escaped."""
    shape = np.zeros(len(_EDGES_KEV) - 1)
    for energy, photons in lines:
        photo, total = attenuation_per_mm(energy)
        edge = compton_edge_kev(energy)
        electron = (np.arange(200) + 0.5) * edge / 200.0
        spectrum = np.array([klein_nishina_recoil(energy, float(kev)) for kev in electron])
        spectrum *= photons * (total - photo) / spectrum.sum()
        sigma = np.array([energy_variance(float(kev)) ** 0.5 for kev in electron])
        shape += np.diff(_normal((_EDGES_KEV[:, None] - electron) / sigma), axis=0) @ spectrum
    return _normalised(shape)


def _humps() -> Array:
    """(_HUMPS, B): triangles over the logarithm of the energy, which add up to a constant."""
    middle = np.log(np.sqrt(_EDGES_KEV[1:] * _EDGES_KEV[:-1]))
    centre = np.linspace(middle[0], middle[-1], _HUMPS)
    height = np.maximum(1.0 - np.abs(middle - centre[:, None]) / (centre[1] - centre[0]), 0.0)
    return np.array([_normalised(one) for one in height])


def _normalised(shape: Array) -> Array:
    """The shape scaled to a sum of 1; zero stays zero."""
    result: Array = shape / max(float(shape.sum()), 1e-300)
    return result


def _normal(z: Array) -> Array:
    """Cumulative normal distribution."""
    result: Array = 0.5 * (1.0 + erf(z / np.sqrt(2.0)))
    return result


@cache
def _parts() -> Array:
    """(C, K, B): peaks and continuum of each candidate, then the components common to all."""
    common = np.concatenate(([_peaks(lines) for lines in _NATURAL], _humps()))
    return np.array([np.concatenate(([_peaks(GAMMAS[name]), _continuum(GAMMAS[name])], common)) for name in CANDIDATES])
