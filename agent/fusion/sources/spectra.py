"""Counts of a camera beside a source, by energy, nuclide and distance: in the 32 bins of the exposures' coarse spectra.

Of nuclide n with activity A at the distance d, per second in energy bin e,

    S_ne = w (N_ne + mu_n d F_ne + (f - ``MEAN_FACING``) G_ne),    w = A exp(-mu_n d) / (4 pi d^2),
    N = P_s + b Q_s,    F = a Q_s - L,    b = (1 + c) ``NEAR``,    a = (1 + c) ``AIR``,    P_s = P exp(s P' / P), and so Q_s,

and over soil, h the sine of the source's depression below the horizon and q_e a fitted factor (``soil.factor``),

    w q_e [H_ne + h I_ne + h (f - ``MEAN_FACING``) J_ne]    more, with    b = (1 + c) ``NEAR`` ``BODY_SHARE``,    F = a R_s - L.

P are photons straight from the source (``direct``: full-energy peaks with the charge that is lost, and the Compton continuum). Q
are photons scattered once by ground, mount and air. A prime (') stands for the derivative by the logarithm of the energy scale, s
for the scale's error, c for the scatter beyond the assumed one. The attenuation mu_n is that of the most penetrating line, and L
("softer") the additional loss of the other lines, to first order. The facing f is the cosine of the angle between the source and
the normal of the sensor, which is flat. A camera that faces the source counts 6 % more photons of 662 keV than in the mean over
all headings, but 45 % more of 80 keV. Edge on it counts 60 % less of these. Front and back are assumed alike; from the front a
tenth of the softest photons is in the bin below. H, I and J are photons scattered by soil once or more, mostly near the source. R
are photons scattered by the air above soil. For an unknown nuclide, N (over soil N + H + ``MEAN_STEEPNESS`` I) is the measured
spectrum; Q, G, H, I, J and R are the same shares of it as in the mean over the known nuclides, and L is 0. All are effective
areas times photons per decay, mm2, of this project's own photon transport and detector chain (benchmarks/spectral_response.py).
For H, I, J and R another transport code's fluxes meet the same detector (benchmarks/soil_spectra.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct

from radron.agent.detector.lines import GAMMAS
from radron.agent.errors import ConfigError
from radron.agent.fusion.bayes.response import REFERENCE_BQ
from radron.agent.fusion.bayes.soil import BODY_SHARE, OTHER_SHARE
from radron.agent.fusion.facing import MEAN_FACING, MEAN_STEEPNESS
from radron.agent.fusion.sources.bins import LEAST_MM2, overlap, pooled, scaled
from radron.agent.fusion.sources.soil import AS_TABULATED, NO_SOIL, Sight, Soil, factor
from radron.agent.fusion.sources.soiltables import SOIL
from radron.agent.fusion.sources.tables import TABLES
from radron.agent.geometry import Array

NEAREST_M = 0.3  # least distance of a camera from a source in the model
NEAR, AIR = 0.2, 0.8  # hits of scattered photons, as a share of the direct ones: by ground and mount, and by air for each mu d
PER_MM2 = REFERENCE_BQ / (4e6 * np.pi)  # w at 1 m without attenuation, per mm2 and second
KNOWN = tuple(name for name in TABLES if name != "background")
_LEAST_PS = 1e-6  # of background in a bin, so that an event there is never impossible
UNKNOWN_AIR_PER_M = 0.0093  # of unknown nuclides: the value at 662 keV
_UNKNOWN_MM2 = 16.0  # sum of the bins of an unknown nuclide, at any emission: about that of Cs-137
_SHOWN = 0.02  # of a nuclide's greatest bin
_KEPT = 8  # tables with spectra of unknown nuclides


class UnknownSpectrum(Struct, frozen=True, eq=False):
    """The measured spectrum of an unknown nuclide. area: (BINS,) N, mm2, with the sum ``_UNKNOWN_MM2``: the emission per decay is
    not known. lines_kev: energies of its peaks, ascending.
    """

    area: Array
    lines_kev: tuple[int, ...]

    @classmethod
    def measured(cls, seen: Array, sight: Sight, lines_kev: tuple[int, ...], soil: Array = NO_SOIL) -> UnknownSpectrum:
        """Return the spectrum of areas (BINS,) measured with this view. ``soil``: as of ``Solution``."""
        shares = _shares_of_known("soil" if len(soil) else "none")
        relative = 1.0 + sight.depth * AIR * shares.air + sight.facing * shares.by_facing
        if len(soil):
            seen_soil = shares.near + sight.steepness * (shares.steep + sight.facing * shares.turned)
            relative += factor(soil) * seen_soil - (shares.near + MEAN_STEEPNESS * shares.steep)
        area = np.maximum(seen / relative, LEAST_MM2)
        return cls(area * _UNKNOWN_MM2 / area.sum(), lines_kev)


@dataclass(frozen=True, eq=False)
class Spectra:
    """The tables of N nuclides and U unknown ones, (N + U, BINS) each but for ``air_per_m``, (N + U,); and of the background,
    (BINS,) per second. nuclides: names of the N. unknown: the measured U. air: R; over nothing, Q. nearby: b at c = 0. soil: H, I
    and J; None over nothing.
    """

    nuclides: tuple[str, ...]
    air_per_m: Array
    direct: Array
    softer: Array
    direct_by_scale: Array
    by_facing: Array
    scattered: Array
    scattered_by_scale: Array
    air: Array
    air_by_scale: Array
    nearby: float
    soil: Soil | None
    complete: Array
    partial: Array
    background: Array
    background_by_scale: Array
    background_pairs: Array
    unknown: tuple[UnknownSpectrum, ...] = ()

    @classmethod
    def of(cls, nuclides: Sequence[str], ground: str = "none") -> Spectra:
        """Return the tables of these nuclides, over that ground.

        Raises:
            ConfigError: a nuclide that is not in the table.
        """
        for name in nuclides:
            if name not in KNOWN:
                raise ConfigError(
                    f"nuclide {name!r}: estimator 'sources' does not know what a camera counts of it; it knows {', '.join(KNOWN)}"
                )
        return _spectra(tuple(nuclides), ground)

    @property
    def ground(self) -> str:
        """The ground of these tables, as in the mission: ``soil`` or ``none``."""
        return "none" if self.soil is None else "soil"

    def plus(self, unknown: Sequence[UnknownSpectrum]) -> Spectra:
        """Return the tables with further unknown nuclides."""
        return _extended(self, tuple(unknown)) if unknown else self

    def name_of(self, nuclide: int) -> str | None:
        """Return the name of a nuclide; None for an unknown nuclide."""
        return self.nuclides[nuclide] if nuclide < len(self.nuclides) else None

    def lines_of(self, nuclide: int) -> tuple[int, ...] | None:
        """Return the energies (keV) of the peaks of an unknown nuclide; None for a known nuclide."""
        return None if nuclide < len(self.nuclides) else self.unknown[nuclide - len(self.nuclides)].lines_kev

    def templates(self, scale: float, scatter: float, soil: Array = AS_TABULATED) -> Array:
        """Return (N, Q, BINS) N, F, G and, over soil, q H, q I and q J, at the energy scale's error s and excess of scatter c.

        ``soil``: as of ``Solution``; over nothing it is not used.
        """
        result = self.direct_templates(scale, soil)
        result[:, 0] += self.nearby * ((1.0 + scatter) * scaled(self.scattered, self.scattered_by_scale, scale))
        result[:, 1] += AIR * ((1.0 + scatter) * scaled(self.air, self.air_by_scale, scale))
        return result

    def direct_templates(self, scale: float, soil: Array = AS_TABULATED) -> Array:
        """Return the (N, Q, BINS) parts of ``templates`` from the source's side, where a wall may be: P_s to q J."""
        direct = scaled(self.direct, self.direct_by_scale, scale), -self.softer, self.facing(scale)
        straight = np.stack(direct, axis=1)
        return straight if self.soil is None else np.concatenate((straight, self.soil.templates(scale, soil)), axis=1)

    def strengths(self, sight: Sight) -> tuple[Array | float, ...]:
        """Return the strengths of the Q templates, relative to w."""
        depth, facing, steepness = sight
        bare = 1.0, depth, facing
        return bare if self.soil is None else (*bare, 1.0, steepness, steepness * facing)

    @property
    def level(self) -> list[int]:
        """Indices of the templates that contribute to the mean over all headings."""
        return [0, 1] if self.soil is None else [0, 1, 3, 4]

    def areas(self, scale: float, scatter: float, sight: Sight, soil: Array = AS_TABULATED) -> Array:
        """Return (N, BINS) S_ne / w. sight: of numbers or (N, 1). soil: as of ``templates``."""
        shapes = self.templates(scale, scatter, soil).swapaxes(0, 1)
        result: Array = sum(strength * shape for strength, shape in zip(self.strengths(sight), shapes, strict=True))
        return result

    def facing(self, scale: float) -> Array:
        """Return G, (N, BINS), at the energy scale's error, limited so that no count is negative."""
        share = np.clip(self.by_facing / np.maximum(self.direct, LEAST_MM2), -1.0 / (1.0 - MEAN_FACING), 1.0 / MEAN_FACING)
        result: Array = share * scaled(self.direct, self.direct_by_scale, scale)
        return result

    def background_ps(self, scale: float, soil: Array = AS_TABULATED) -> Array:
        """Return B (BINS,) per second. soil: as of ``templates``."""
        result: Array = np.maximum(scaled(self.background, self.background_by_scale, scale), _LEAST_PS)
        return result if self.soil is None else result * self.soil.background(soil)[0]

    def cones(self, line_kev: float, reach_kev: tuple[float, float], unsure_kev: float) -> tuple[Array, Array, float]:
        """Return areas (N,) of one line's cones that point to the source, areas of the other cones, and the background's rate per
        second.

        A coincidence of a photon's whole energy points to its source if the source has a line within ``unsure_kev``. A
        coincidence of less energy, with a sum within reach by chance, does not. ``reach_kev``: least and greatest sum that the
        detector assigns to the line.
        """
        share = overlap(*reach_kev)
        own = [any(abs(kev - line_kev) < unsure_kev for kev, _ in GAMMAS[name]) for name in self.nuclides]
        own += [False] * len(self.unknown)
        whole, part = self.complete @ share, self.partial @ share
        pointing = np.where(own, whole, 0.0)
        return pointing, whole - pointing + part, float(self.background_pairs @ share)


@lru_cache(_KEPT)
def _extended(spectra: Spectra, unknown: tuple[UnknownSpectrum, ...]) -> Spectra:
    area, none = np.array([one.area for one in unknown]), np.zeros((len(unknown), len(spectra.background)))
    shares = _shares_of_known(spectra.ground)
    straight = 1.0 - spectra.nearby * shares.scattered
    if spectra.soil is not None:
        straight = np.maximum(straight - shares.near - MEAN_STEEPNESS * shares.steep, 0.0)
    more = {
        "air_per_m": np.full(len(unknown), UNKNOWN_AIR_PER_M),
        "direct": straight * area,
        "by_facing": shares.by_facing * area,
        "scattered": shares.scattered * area,
        "air": shares.air * area,
        "partial": shares.pairs * area,
    }
    rows = ("air_per_m", "direct", "softer", "direct_by_scale", "by_facing", "scattered", "scattered_by_scale")
    tables: dict[str, Any] = {
        key: np.concatenate((getattr(spectra, key), more.get(key, none)))
        for key in (*rows, "air", "air_by_scale", "complete", "partial")
    }
    if spectra.soil is not None:
        by_soil = {"near": shares.near * area, "steep": shares.steep * area, "turned": shares.turned * area}
        keys = (*by_soil, "near_by_scale", "steep_by_scale")
        more = {key: np.concatenate((getattr(spectra.soil, key), by_soil.get(key, none))) for key in keys}
        tables["soil"] = replace(spectra.soil, **more)
    return replace(spectra, **tables, unknown=(*spectra.unknown, *unknown))


class _Shares(NamedTuple):
    """(BINS,) shares of the areas N, over soil of N + H + ``MEAN_STEEPNESS`` I: scattered photons, by air, the derivative by f,
    coincidences; and soil's scatter H, I and J, 0 over nothing.
    """

    scattered: Array
    air: Array
    by_facing: Array
    pairs: Array
    near: Array
    steep: Array
    turned: Array


@cache
def _shares_of_known(ground: str) -> _Shares:
    """Return medians over the known nuclides with a signal in a bin; 0 without any."""
    known = _spectra(KNOWN, ground)
    near = known.direct + known.nearby * known.scattered
    none = np.zeros_like(near)
    soil = known.soil or Soil(none, none, none, none, none, none[0])
    near = near + soil.near + MEAN_STEEPNESS * soil.steep
    shown = near > _SHOWN * near.max(axis=1, keepdims=True)

    def share(part: Array) -> Array:
        return np.array([np.median(part[own, e] / near[own, e]) if own.any() else 0.0 for e, own in enumerate(shown.T)])

    parts = known.scattered, known.air, known.by_facing, known.complete + known.partial, soil.near, soil.steep, soil.turned
    return _Shares(*map(share, parts))


@cache
def _spectra(nuclides: tuple[str, ...], ground: str) -> Spectra:
    bare = _over_nothing(nuclides)
    if ground == "none":
        return bare

    def of(key: str) -> Array:
        return np.array([SOIL[name][key] for name in nuclides])

    background, nearby = SOIL["background"], BODY_SHARE * NEAR
    own_ps = pooled(np.array(background["every"]))
    whole_ps = own_ps + OTHER_SHARE * bare.background
    scattered_pairs = np.array([TABLES[name]["scattered_pairs"] for name in nuclides])
    return replace(
        bare,
        air=pooled(of("air")) / AIR,
        air_by_scale=pooled(of("air_by_scale")) / AIR,
        nearby=nearby,
        soil=Soil.of(nuclides, own_ps / np.maximum(whole_ps, _LEAST_PS)),
        partial=bare.partial + (nearby - NEAR) * scattered_pairs + of("pairs"),
        background=whole_ps,
        background_by_scale=pooled(np.array(background["by_scale"])) + OTHER_SHARE * bare.background_by_scale,
        background_pairs=np.array(background["pairs"]) + OTHER_SHARE * bare.background_pairs,
    )


def _over_nothing(nuclides: tuple[str, ...]) -> Spectra:
    def of(key: str) -> Array:
        return np.array([TABLES[name][key] for name in nuclides])

    def areas(key: str) -> Array:
        return pooled(of(key))

    background, scattered, by_scale = TABLES["background"], areas("scattered"), areas("scattered_by_scale")
    return Spectra(
        nuclides=nuclides,
        air_per_m=of("air_per_m")[:, 0],
        direct=areas("direct"),
        softer=areas("softer"),
        direct_by_scale=areas("direct_by_scale"),
        by_facing=areas("by_facing"),
        scattered=scattered,
        scattered_by_scale=by_scale,
        air=scattered,
        air_by_scale=by_scale,
        nearby=NEAR,
        soil=None,
        complete=of("complete"),
        partial=of("partial") + NEAR * of("scattered_pairs"),
        background=pooled(np.array(background["every"])),
        background_by_scale=pooled(np.array(background["by_scale"])),
        background_pairs=np.array(background["pairs"]),
    )
