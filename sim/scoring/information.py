"""Fisher information per second of a camera's counts and cones about the place and the activity of a source.

Counts: two independent Poisson channels c, full-energy events and others, of rates S_c + B_c, so that for parameters p, q

    I_pq = sum_c S_c^2 / (S_c + B_c) (d ln S_c / dp) (d ln S_c / dq).

With phi = activity / (4 pi D^2) exp(-mu D), and F_f = ``full_mm2``, F_o = ``other_mm2``, effective areas times photons per decay:

    S_full = F_f phi,                              d ln S_full / dD = -2 / D - mu
    S_other = (F_o + b (F_f + F_o)) phi,  b = ``scatter_near`` + ``scatter_air`` mu D   (build-up by scattered photons)
        d ln S_other / dD = -2 / D - mu + scatter_air mu (F_f + F_o) / (F_o + b (F_f + F_o))
    d ln S / d ln(activity) = 1.

Areas, attenuation, scatter and background are the simulation's own; nothing here is taken from the agent.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from radron.sim.geometry import Array
from radron.sim.radiation.bank import BACKGROUND_BIN, DIRECTION_BINS, EventBank, bin_centres
from radron.sim.radiation.events import COMPLETE
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.nuclides import nuclide as nuclide_of
from radron.sim.radiation.store import load_bank
from radron.sim.radiation.timepix3 import energies_kev
from radron.sim.radiation.truth import CameraTruth
from radron.sim.scoring.coneinformation import cone_information

WINDOW = 0.1  # relative to the line: a nearer event has all of the photon's energy
# Of the two-cluster events of full energy that have enough pixels: 0.53 mm2 of usable cones of 15 pixels (reference, table) of
# the bank's 1.05 mm2, of which 72 % have so many.
USABLE = 0.7
CONE_BACKGROUND_PS = 0.005  # coincidences in the energy window (reference, "Detector")
ASTRAY = 0.12  # share of the source's cones that do not point to it (reference, "Beyond")
_ASTRAY = (ASTRAY, 0.2, 0.4, 0.6, 0.8, 0.95)  # with the cones of the background


@dataclass(frozen=True, slots=True)
class Camera:
    """Response of a camera to one nuclide, averaged over all directions, for the theoretical bound.

    The names in capitals are those of the module's equations. full_mm2, other_mm2: F_f, F_o, effective areas for full-energy and
    for other events. cones_mm2: the part of F_f whose events make usable cones. full_ps, other_ps: B_full, B_other, background
    rates. scatter_near, scatter_air: of b, the build-up by scattered photons. air_per_m: mu, attenuation of air. astray,
    information: Fisher information (rad^-2) of one cone about the angle between its axis and the source, tabulated over the share
    of cones that do not point to the source.
    """

    full_mm2: float
    other_mm2: float
    cones_mm2: float
    full_ps: float
    other_ps: float
    scatter_near: float
    scatter_air: float
    air_per_m: float
    astray: Array
    information: Array

    def counts(self, activity_bq: float, distance_m: Array) -> tuple[Array, Array, Array]:
        """Return the Fisher information per second that the photon counts give about the distance and the activity of a source.

        The parameters are D in metres and a = ln activity. Returns I_DD, I_Da, I_aa, each with the shape of ``distance_m``.
        """
        direct = _fluence(activity_bq, distance_m) * np.exp(-self.air_per_m * distance_m)
        fall = -2.0 / distance_m - self.air_per_m
        depth = self.air_per_m * distance_m
        scatter = self.scatter_near + self.scatter_air * depth
        area = self.full_mm2 + self.other_mm2
        other = self.other_mm2 + scatter * area
        full_signal, other_signal = self.full_mm2 * direct, other * direct
        other_fall = fall + self.scatter_air * self.air_per_m * area / other
        full = full_signal**2 / (full_signal + self.full_ps)
        rest = other_signal**2 / (other_signal + self.other_ps)
        return full * fall**2 + rest * other_fall**2, full * fall + rest * other_fall, full + rest

    def cones(self, activity_bq: float, distance_m: Array) -> Array:
        """Return the Fisher information per second that the cones give about the direction to a source.

        In rad^-2, for each of the two angles of the direction:

            R i(eps) / 2,  R = S + B,  eps = (``ASTRAY`` S + B) / R,

        i = ``information`` of one cone, S and B the rates of cones from the source and from the background.
        """
        signal = self.cones_mm2 * _fluence(activity_bq, distance_m) * np.exp(-self.air_per_m * distance_m)
        rate = signal + CONE_BACKGROUND_PS
        astray = (ASTRAY * signal + CONE_BACKGROUND_PS) / rate
        # The azimuth of a cone's axis around the line of sight is uniform: half of the information goes to each angle.
        result: Array = 0.5 * rate * np.interp(astray, self.astray, self.information)
        return result


def camera_of(truth: CameraTruth, nuclide: str, minimum_pixels: int) -> Camera:
    """Return the response of a camera to a nuclide for the theoretical bound, with cones of at least ``minimum_pixels`` pixels.

    Results are cached.
    """
    return _camera(truth, nuclide, minimum_pixels)


@cache
def _camera(truth: CameraTruth, name: str, minimum_pixels: int) -> Camera:
    lines = np.array([energy for energy, _ in nuclide_of(name).lines])
    bank = load_bank(name, truth)
    areas = _mean_area(bank)
    source, background = _full_shares(bank, lines)
    full = float(areas @ source)
    return Camera(
        full_mm2=full,
        other_mm2=float(areas.sum()) - full,
        cones_mm2=USABLE * _share_so_large(bank, minimum_pixels) * float(areas[COMPLETE]),
        full_ps=truth.background_hits_per_s * background,
        other_ps=truth.background_hits_per_s * (1.0 - background),
        scatter_near=truth.scatter_near,
        scatter_air=truth.scatter_air,
        air_per_m=min(air_attenuation_per_m(energy) for energy in lines.tolist()),
        astray=np.array([*_ASTRAY, 1.0]),
        information=np.array([*cone_information(float(lines[0]), _ASTRAY), 0.0]),
    )


def _fluence(activity_bq: float, distance_m: Array) -> Array:
    """Return activity / (4 pi D^2), per mm2 and second."""
    result: Array = activity_bq / (4e6 * np.pi * distance_m**2)
    return result


def _mean_area(bank: EventBank) -> Array:
    """Return effective areas times photons per decay, (KINDS,), mm2, as a mean over all directions."""
    weight = _solid_angle()
    result: Array = weight @ bank.area_mm2[:DIRECTION_BINS] / weight.sum()
    return result


def _solid_angle() -> Array:
    """Return the solid angles of the bins, (DIRECTION_BINS,), in proportion."""
    z = bin_centres()[:, 2]
    _, row, columns = np.unique(z.round(9), return_inverse=True, return_counts=True)
    result: Array = np.sqrt(1.0 - z * z) / columns[row]
    return result


def _shares(bank: EventBank, holds: NDArray[np.bool_]) -> Array:
    """Return the share of the events of each bin and kind that satisfy ``holds`` ((E,)), (B, KINDS); 0 without events."""
    until = np.concatenate(([0], np.cumsum(holds)))
    result: Array = (until[bank.start + bank.count] - until[bank.start]) / np.maximum(bank.count, 1)
    return result


def _mean_share(bank: EventBank, shares: Array) -> Array:
    """Return the mean of the shares (B, KINDS) over all directions, weighted by the numbers of events, (KINDS,)."""
    weight = _solid_angle()[:, None] * bank.area_mm2[:DIRECTION_BINS]
    result: Array = (weight * shares[:DIRECTION_BINS]).sum(axis=0) / np.maximum(weight.sum(axis=0), np.finfo(float).tiny)
    return result


def _share_so_large(bank: EventBank, pixels: int) -> float:
    """Return the share of the complete events, over all directions, with at least this number of pixels."""
    return float(_mean_share(bank, _shares(bank, np.diff(bank.first) >= pixels))[COMPLETE])


def _full_shares(bank: EventBank, lines_kev: Array) -> tuple[Array, float]:
    """Return the share of the events with a photon's full energy: (KINDS,) of the source's, and of the background's."""
    until = np.concatenate(([0.0], np.cumsum(energies_kev(bank.pixels))))
    energy = until[bank.first[1:]] - until[bank.first[:-1]]
    full = np.any(np.abs(energy[:, None] / lines_kev - 1.0) <= WINDOW, axis=1)
    shares = _shares(bank, full)
    area = bank.area_mm2[BACKGROUND_BIN]
    return _mean_share(bank, shares), float(area @ shares[BACKGROUND_BIN] / area.sum())
