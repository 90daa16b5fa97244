"""The simulated ordinary detector of a drone: from sources in view and the ground to counts by channel.

Its response is computed by transport with other random numbers than the agent's tables, and may differ from them on purpose.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import ConfigError
from radron.sim.radiation.concrete import concrete_attenuation_per_m
from radron.sim.radiation.crystal.detectors import DETECTORS, STEP_KEV, detector, effective_areas
from radron.sim.radiation.crystal.table import smeared
from radron.sim.radiation.ground.area import AreaPose, AreaSource, flux_by_angle
from radron.sim.radiation.ground.bank import group_energies_kev
from radron.sim.radiation.ground.field import natural_flux, point_field
from radron.sim.radiation.ground.photons import AROUND, GROUPS, TOWARDS
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.store import kept
from radron.sim.radiation.truth import GroundTruth

if TYPE_CHECKING:
    from radron.sim.radiation.camera import SourceView

FloatArray = NDArray[np.float64]
Factor = Annotated[float, Meta(gt=0.0, le=10.0)]

DEVICE_CHANNELS, DEVICE_STEP_KEV = 256, 12.0  # of the simulated device
ANGLES_DEG: FloatArray = np.array((0.0, 22.5, 45.0, 67.5, 90.0))
MIN_DISTANCE_M = 0.05
_HISTORIES, _MIN_HISTORIES, _MAX_HISTORIES = 150_000, 4_000, 40_000  # of all energies in a direction; of one energy
_SEED = 20_261_129  # other than that of the agent's tables
_MADE_BY = ("body", "detectors", "emulated", "matter", "photons", "table", "tube")


class OrdinaryTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The true ordinary detector of a drone.

    detector: its name. efficiency, gain, resolution: factors on its counts, on its energies and on the width of its lines, of
    which the agents know nothing. dead_time_us: dead time after each count, not extended by counts in it.
    """

    detector: str
    efficiency: Factor = 1.0
    gain: Factor = 1.0
    resolution: Factor = 1.0
    dead_time_us: Annotated[float, Meta(ge=0.0, le=10_000.0)] = 0.0

    def check(self, where: str) -> None:
        """Raise ConfigError, whose text begins with ``where``, for an unknown detector."""
        if self.detector not in DETECTORS:
            raise ConfigError(f"{where}.detector: unknown {self.detector!r}; known: {', '.join(DETECTORS)}")


class _Areas(NamedTuple):
    """Effective areas, m2, by device channel: (A, K, R) for ``ANGLES_DEG`` and K energies."""

    by_angle: FloatArray

    def at(self, angle_deg: float) -> FloatArray:
        """Areas (K, R) in a direction; the same from above as from below."""
        angle = min(angle_deg, 180.0 - angle_deg) / float(ANGLES_DEG[1])
        low = min(int(angle), len(ANGLES_DEG) - 2)
        share = angle - low
        return np.asarray((1.0 - share) * self.by_angle[low] + share * self.by_angle[low + 1])

    def mean(self) -> FloatArray:
        """Areas (K, R) as a mean over all directions."""
        cosine = np.cos(np.radians(ANGLES_DEG))
        weights = np.zeros(len(cosine))
        weights[:-1] += 0.5 * (cosine[:-1] - cosine[1:])
        weights[1:] += 0.5 * (cosine[:-1] - cosine[1:])
        return np.asarray(np.tensordot(weights, self.by_angle, 1))


class Ordinary:
    """A simulated ordinary detector, exposed to sources over ground.

    Args:
        truth: the true detector.
        nuclides: nuclides of the sources, each once.
        rng: the detector's own random numbers.
        clock_ns: UTC time of the start of the simulation.
        ground: the ground below the drone.
        areas: contaminated parts of the ground, of some of these nuclides.
    """

    def __init__(
        self,
        truth: OrdinaryTruth,
        nuclides: Sequence[str],
        rng: np.random.Generator,
        clock_ns: int,
        ground: GroundTruth,
        areas: Sequence[AreaSource] = (),
    ) -> None:
        self._truth, self._rng, self._clock_ns, self._ground = truth, rng, clock_ns, ground
        groups = tuple(group_energies_kev().tolist())
        self._groups = areas_m2(truth, groups)
        self._around = self._groups.mean()
        self._concrete = np.array([concrete_attenuation_per_m(energy) for energy in groups])
        self._first = nuclides[0]
        self._lines = {name: nuclide(name).lines for name in nuclides}
        self._contaminated = areas
        self._direct = {name: areas_m2(truth, tuple(energy for energy, _ in lines)) for name, lines in self._lines.items()}

    def expose(
        self, start_ns: int, end_ns: int, views: Sequence[SourceView], height_m: float, pose: AreaPose | None = None
    ) -> Readout:
        """Return the counts from ``start_ns`` until before ``end_ns`` (UTC), Poisson distributed, with the live time.

        ``views``: the sources, which do not move relative to the detector meanwhile. ``height_m``: above the ground below it.
        ``pose``: of the detector, whose place counts for contaminated ground; without it none is seen.
        """
        flux = self._ground.natural * natural_flux(self._ground.kind, height_m)
        rates = np.zeros(DEVICE_CHANNELS)
        for view in views:
            rates += self._from_source(view, flux)
        if pose is not None:
            for area in self._contaminated:
                rates += self._from_area(area, pose, flux)
        rates = self._truth.efficiency * (rates + flux @ self._around)
        span_s = (end_ns - start_ns) * 1e-9
        live_s = span_s / (1.0 + float(rates.sum()) * 1e-6 * self._truth.dead_time_us)
        counts = self._rng.poisson(rates * live_s)
        return Readout(start_ns, end_ns, self._clock_ns, live_s, PixelHits.none(), counts=counts)

    def _from_source(self, view: SourceView, around: FloatArray) -> FloatArray:
        """Rates (R,) of photons straight from a source and from near its direction; its others are added to ``around``."""
        name = view.nuclide or self._first
        distance_m = max(view.distance_m, MIN_DISTANCE_M)
        rise_m = view.camera_m - view.source_m
        angle_deg = math.degrees(math.acos(max(-1.0, min(1.0, rise_m / distance_m))))
        per_m2 = view.activity_bq / (4.0 * math.pi * distance_m**2)
        depths = [
            air_attenuation_per_m(energy) * distance_m + concrete_attenuation_per_m(energy) * view.concrete_m
            for energy, _ in self._lines[name]
        ]
        lines = np.array([share * math.exp(-depth) for (_, share), depth in zip(self._lines[name], depths, strict=True)])
        horizontal_m = math.sqrt(max(distance_m**2 - rise_m**2, 0.0))
        place_m = view.source_m if view.source_m > 0.0 else -self._ground.depth_m
        scattered = per_m2 * point_field(name, self._ground.kind, place_m).times_square(view.camera_m, horizontal_m)[:, :GROUPS]
        around += scattered[AROUND]
        towards = scattered[TOWARDS] * np.exp(-self._concrete * view.concrete_m)
        return np.asarray(per_m2 * lines @ self._direct[name].at(angle_deg) + towards @ self._groups.at(angle_deg))

    def _from_area(self, area: AreaSource, pose: AreaPose, around: FloatArray) -> FloatArray:
        """Rates (R,) of photons from the side of a contaminated area; its others are added to ``around``."""
        offset = (self._rng.random(), self._rng.random())
        straight, towards, others = flux_by_angle(area, self._ground, pose.position_m, offset, ANGLES_DEG)
        around += others
        direct, groups = self._direct[area.nuclide].by_angle, self._groups.by_angle
        return np.asarray(np.einsum("al,alr->r", straight, direct) + np.einsum("ag,agr->r", towards, groups))


@cache
def areas_m2(truth: OrdinaryTruth, energies_kev: tuple[float, ...]) -> _Areas:
    """Return the effective areas of a true detector at some energies, with its own gain and resolution, by device channel."""
    found = detector(truth.detector)
    edges: FloatArray = DEVICE_STEP_KEV / truth.gain * np.arange(DEVICE_CHANNELS + 1, dtype=np.float64)
    full, rest = _deposits(truth.detector, energies_kev)
    areas = np.zeros((*full.shape, DEVICE_CHANNELS))
    for angle in range(len(ANGLES_DEG)):
        for place, energy in enumerate(energies_kev):
            if found.kind == "counts":
                areas[angle, place, 0] = rest[angle, place].sum()
                continue
            at_kev = np.array([energy, *(STEP_KEV * (np.arange(rest.shape[2]) + 0.5))])
            deposits = np.array([full[angle, place], *rest[angle, place]])
            areas[angle, place] = smeared(found, at_kev, deposits, edges, truth.resolution)
    return _Areas(1e-4 * areas)


def _deposits(name: str, energies_kev: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Effective areas, cm2, of the full energy (A, K), and of all else by deposited energy (A, K, bins); kept in the user's
    cache.
    """
    code = hashlib.blake2b(repr((name, energies_kev)).encode(), digest_size=8)
    for module in _MADE_BY:
        code.update(Path(__file__).with_name(f"{module}.py").read_bytes())

    def build() -> dict[str, FloatArray]:
        rng = np.random.default_rng(_SEED)
        bins = math.ceil(max(energies_kev) / STEP_KEV)
        histories = max(_MIN_HISTORIES, min(_MAX_HISTORIES, _HISTORIES // len(energies_kev)))
        full = np.zeros((len(ANGLES_DEG), len(energies_kev)))
        rest = np.zeros((*full.shape, bins))
        for angle, angle_deg in enumerate(ANGLES_DEG.tolist()):
            for place, energy in enumerate(energies_kev):
                full[angle, place], others = effective_areas(name, energy, angle_deg, histories, rng)
                rest[angle, place, : len(others)] = others
        return {"full": full, "rest": rest}

    arrays = kept(f"ordinary-{name}-{code.hexdigest()}", build)
    return np.asarray(arrays["full"]), np.asarray(arrays["rest"])
