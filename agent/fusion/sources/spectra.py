"""What a camera counts beside a source, by energy, nuclide and distance: in the 32 bins of the exposures' coarse spectra.

Of nuclide n with activity A at the distance d, per second in energy bin e,

    S_ne = w (N_ne + mu_n d F_ne + (f - ``MEAN_FACING``) G_ne),    w = A exp(-mu_n d) / (4 pi d^2),
    N = P_s + b Q_s,    F = a Q_s - L,    b = (1 + c) ``NEAR``,    a = (1 + c) ``AIR``,    P_s = P exp(s P' / P), and so Q_s

P are photons straight from the source (``direct``: full-energy peaks with the charge that is lost, and the Compton continuum),
Q photons that ground, mount and air have scattered once; ' the derivative by the logarithm of the energy scale, s the scale's
error, c the scatter beyond what is assumed. mu_n is the attenuation of the most penetrating line, and L ("softer") what the
others lose more, to first order. f is the cosine of the angle between the source and the normal of the sensor, which is flat: a
camera that faces the source counts 6 % more photons of 662 keV than in the mean over all headings, but 45 % more of 80 keV, and
edge on it counts 60 % less of these. Front and back are taken for alike; from the front a tenth of the softest photons is seen
in the bin below. Of an unknown nuclide N is what was measured; Q and G are the same shares of it as in the mean over the known
nuclides, and L is 0. All are effective areas times photons per decay, mm2, of this project's own photon transport and detector
chain (benchmarks/spectral_response.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct

from agent.detector.lines import GAMMAS
from agent.errors import ConfigError
from agent.fusion.sources.tables import TABLES
from agent.geometry import Array
from protocol.spectrum import EDGES_KEV

REFERENCE_BQ = 1e9  # unit of the activities
NEAREST_M = 0.3  # least distance of a camera from a source in the model
MEAN_FACING = 0.565  # over all headings, 5 to 45 degrees above the source
NEAR, AIR = 0.2, 0.8  # hits of scattered photons, as a share of the direct ones: by ground and mount, and by air for each mu d
PER_MM2 = REFERENCE_BQ / (4e6 * np.pi)  # w at 1 m without attenuation, per mm2 and second
KNOWN = tuple(name for name in TABLES if name != "background")
_LEAST_PS = 1e-6  # of background in a bin, so that an event there is never impossible
_LEAST_MM2 = 1e-9
UNKNOWN_AIR_PER_M = 0.0093  # of unknown nuclides: that of 662 keV
_UNKNOWN_MM2 = 16.0  # sum of the bins of an unknown nuclide: about that of Cs-137, whatever it sends out
_POOLED = 2  # bins, up to 69 keV
_SHOWN = 0.02  # of a nuclide's greatest bin
_KEPT = 8  # tables with spectra of unknown nuclides
_MOST_CHANGE = 2.5  # of the logarithm of a bin


class UnknownSpectrum(Struct, frozen=True, eq=False):
    """Of a nuclide that nobody knows, as it was measured. area: (BINS,) N, mm2, whose sum is ``_UNKNOWN_MM2``: what it sends out
    per decay is not known. lines_kev: of its peaks, ascending.
    """

    area: Array
    lines_kev: tuple[int, ...]

    @classmethod
    def measured(cls, seen: Array, depth: float, facing: float, lines_kev: tuple[int, ...]) -> UnknownSpectrum:
        """From areas (BINS,) that were seen, at these means of mu d and f - ``MEAN_FACING``."""
        shares = _shares_of_known()
        area = np.maximum(seen / (1.0 + depth * AIR * shares.scattered + facing * shares.by_facing), _LEAST_MM2)
        return cls(area * _UNKNOWN_MM2 / area.sum(), lines_kev)


@dataclass(frozen=True, eq=False)
class Spectra:
    """The tables of N nuclides and U unknown ones, (N + U, BINS) each but for ``air_per_m``, (N + U,); and of the background,
    (BINS,) per second. nuclides: names of the N. unknown: the U, as they were measured.
    """

    nuclides: tuple[str, ...]
    air_per_m: Array
    direct: Array
    softer: Array
    direct_by_scale: Array
    by_facing: Array
    scattered: Array
    scattered_by_scale: Array
    complete: Array
    partial: Array
    background: Array
    background_by_scale: Array
    background_pairs: Array
    unknown: tuple[UnknownSpectrum, ...] = ()

    @classmethod
    def of(cls, nuclides: Sequence[str]) -> Spectra:
        """Of these nuclides.

        Raises:
            ConfigError: one that is not in the table.
        """
        for name in nuclides:
            if name not in KNOWN:
                raise ConfigError(
                    f"nuclide {name!r}: estimator 'sources' does not know what a camera counts of it; it knows {', '.join(KNOWN)}"
                )
        return _spectra(tuple(nuclides))

    def plus(self, unknown: Sequence[UnknownSpectrum]) -> Spectra:
        """With further nuclides that nobody knows."""
        return _extended(self, tuple(unknown)) if unknown else self

    def name_of(self, nuclide: int) -> str | None:
        """None: of one that nobody knows."""
        return self.nuclides[nuclide] if nuclide < len(self.nuclides) else None

    def lines_of(self, nuclide: int) -> tuple[int, ...] | None:
        """Energies (keV) of the peaks of one that nobody knows; None: of another."""
        return None if nuclide < len(self.nuclides) else self.unknown[nuclide - len(self.nuclides)].lines_kev

    def templates(self, scale: float, scatter: float) -> tuple[Array, Array]:
        """N and F, (N, BINS) each, at the energy scale's error s and the excess of scatter c."""
        around = (1.0 + scatter) * _scaled(self.scattered, self.scattered_by_scale, scale)
        near = _scaled(self.direct, self.direct_by_scale, scale) + NEAR * around
        return near, AIR * around - self.softer

    def direct_templates(self, scale: float) -> tuple[Array, Array]:
        """The parts of N and F, (N, BINS) each, that are photons straight from the source: P_s and -L."""
        return _scaled(self.direct, self.direct_by_scale, scale), -self.softer

    def facing(self, scale: float) -> Array:
        """G, (N, BINS), at the energy scale's error: so limited that no count is negative."""
        share = np.clip(self.by_facing / np.maximum(self.direct, _LEAST_MM2), -1.0 / (1.0 - MEAN_FACING), 1.0 / MEAN_FACING)
        result: Array = share * _scaled(self.direct, self.direct_by_scale, scale)
        return result

    def background_ps(self, scale: float) -> Array:
        """B (BINS,) per second."""
        result: Array = np.maximum(_scaled(self.background, self.background_by_scale, scale), _LEAST_PS)
        return result

    def cones(self, line_kev: float, reach_kev: tuple[float, float], unsure_kev: float) -> tuple[Array, Array, float]:
        """Of cones of one line: areas (N,) of those that point to the source, and of the others; and the background's per second.

        A coincidence of a photon's whole energy points to its source if that has a line within ``unsure_kev``; one of less, whose
        sum is within reach by chance, does not. ``reach_kev``: least and greatest sum that the detector takes for the line's.
        """
        share = _overlap(*reach_kev)
        own = [any(abs(kev - line_kev) < unsure_kev for kev, _ in GAMMAS[name]) for name in self.nuclides]
        own += [False] * len(self.unknown)
        whole, part = self.complete @ share, self.partial @ share
        pointing = np.where(own, whole, 0.0)
        return pointing, whole - pointing + part, float(self.background_pairs @ share)


@lru_cache(_KEPT)
def _extended(spectra: Spectra, unknown: tuple[UnknownSpectrum, ...]) -> Spectra:
    area, none = np.array([one.area for one in unknown]), np.zeros((len(unknown), len(spectra.background)))
    shares = _shares_of_known()
    more = {
        "air_per_m": np.full(len(unknown), UNKNOWN_AIR_PER_M),
        "direct": (1.0 - NEAR * shares.scattered) * area,
        "by_facing": shares.by_facing * area,
        "scattered": shares.scattered * area,
        "partial": shares.pairs * area,
    }
    rows = ("air_per_m", "direct", "softer", "direct_by_scale", "by_facing", "scattered", "scattered_by_scale")
    tables: dict[str, Any] = {
        key: np.concatenate((getattr(spectra, key), more.get(key, none))) for key in (*rows, "complete", "partial")
    }
    return replace(spectra, **tables, unknown=(*spectra.unknown, *unknown))


def _scaled(shape: Array, by_scale: Array, scale: float) -> Array:
    """The shape at another energy scale: exponential in it, as the flanks of peaks nearly are, and so never negative."""
    change = scale * by_scale / np.maximum(shape, _LEAST_MM2)
    result: Array = shape * np.exp(np.clip(change, -_MOST_CHANGE, _MOST_CHANGE))
    return result


def pooled(by_bin: Array) -> Array:
    """(..., BINS) with the softest bins as if they were one: each is their mean, so that a Poisson likelihood is that of the sum.

    Between them lies the peak of Am-241, less the charge that is lost. From the front of the sensor that is more than in the mean
    over front and back: on a circle, where cameras face the source, half as many events again are below that edge as expected.
    """
    result = by_bin.copy()
    result[..., :_POOLED] = by_bin[..., :_POOLED].mean(axis=-1, keepdims=True)
    return result


def _overlap(low_kev: float, high_kev: float) -> Array:
    """(BINS,) share of each bin that lies between two energies."""
    edges = np.array(EDGES_KEV)
    inside = np.minimum(edges[1:], high_kev) - np.maximum(edges[:-1], low_kev)
    result: Array = np.maximum(inside, 0.0) / np.diff(edges)
    return result


class _Shares(NamedTuple):
    """(BINS,) of the areas N: what is scattered, the derivative by f, and coincidences."""

    scattered: Array
    by_facing: Array
    pairs: Array


@cache
def _shares_of_known() -> _Shares:
    """Medians over the known nuclides that show in a bin; 0 where none does."""
    known = _spectra(KNOWN)
    near = known.direct + NEAR * known.scattered
    shown = near > _SHOWN * near.max(axis=1, keepdims=True)

    def share(part: Array) -> Array:
        return np.array([np.median(part[own, e] / near[own, e]) if own.any() else 0.0 for e, own in enumerate(shown.T)])

    return _Shares(share(known.scattered), share(known.by_facing), share(known.complete + known.partial))


@cache
def _spectra(nuclides: tuple[str, ...]) -> Spectra:
    def of(key: str) -> Array:
        return np.array([TABLES[name][key] for name in nuclides])

    def areas(key: str) -> Array:
        return pooled(of(key))

    background = TABLES["background"]
    return Spectra(
        nuclides=nuclides,
        air_per_m=of("air_per_m")[:, 0],
        direct=areas("direct"),
        softer=areas("softer"),
        direct_by_scale=areas("direct_by_scale"),
        by_facing=areas("by_facing"),
        scattered=areas("scattered"),
        scattered_by_scale=areas("scattered_by_scale"),
        complete=of("complete"),
        partial=of("partial") + NEAR * of("scattered_pairs"),
        background=pooled(np.array(background["every"])),
        background_by_scale=pooled(np.array(background["by_scale"])),
        background_pairs=np.array(background["pairs"]),
    )
