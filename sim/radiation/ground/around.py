"""Photons in a simulated camera that come from the ground: scattered there or in the air, or of the ground's own activity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from radron.sim.radiation.concrete import concrete_attenuation_per_m
from radron.sim.radiation.emission import FROM_ALL_DIRECTIONS, IntArray, Pool
from radron.sim.radiation.ground.bank import DIRECTIONS, ISOTROPIC, direction_of, ground_bank, group_energies_kev
from radron.sim.radiation.ground.field import FloatArray, natural_flux, point_field, rain_flux
from radron.sim.radiation.ground.photons import AROUND, GROUPS, TOWARDS
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.truth import CameraTruth, GroundTruth

if TYPE_CHECKING:
    from radron.sim.radiation.camera import SourceView
    from radron.sim.radiation.ground.area import AreaView
    from radron.sim.radiation.individual import Individual

MIN_DISTANCE_M = 0.05


class Around(NamedTuple):
    """Origins of the photons that reach a camera from the ground, with their rates.

    Each origin has a direction bin in the bank of events (stored simulated events), a symmetry of the sensor (flips and swap of
    rows and columns), and a rate of events (1/s).
    """

    bins: IntArray
    symmetries: IntArray
    rates: FloatArray


class AroundCamera(Pool):
    """Computes the rates of photons that reach one camera from the ground, scattered there or emitted by the ground."""

    def __init__(self, ground: GroundTruth, truth: CameraTruth) -> None:
        super().__init__(ground_bank(response(truth)))
        self._ground = ground
        self._area = np.array(self.area_mm2).reshape(DIRECTIONS + 1, GROUPS)
        self._concrete = np.array([concrete_attenuation_per_m(energy) for energy in group_energies_kev().tolist()])

    def rates(
        self,
        views: Sequence[SourceView],
        areas: Sequence[AreaView],
        own: Individual,
        drift: float,
        height_m: float,
        time_s: float,
        first_nuclide: str,
    ) -> Around:
        """Return the rates of photons that the ground scatters from all sources, and of the ground's own photons.

        Args:
            views: the sources.
            areas: contaminated parts of the ground.
            own: deviations of this camera from the assumed one.
            drift: factor on the ground's own photons.
            height_m: height of the camera above the ground.
            time_s: time since the start of the simulation.
            first_nuclide: nuclide of sources that name none.
        """
        around = own.sensitivity * drift * 1e-6 * self._natural_flux(height_m, time_s)
        places, symmetries, rates = [], [], []
        for view in views:
            distance_m = max(view.distance_m, MIN_DISTANCE_M)
            rise_m = view.camera_m - view.source_m
            horizontal_m = math.sqrt(max(distance_m * distance_m - rise_m * rise_m, 0.0))
            place_m = view.source_m if view.source_m > 0.0 else -self._ground.depth_m
            field = point_field(view.nuclide or first_nuclide, self._ground.kind, place_m)
            per_m2 = own.sensitivity * view.activity_bq / (4e6 * math.pi * distance_m * distance_m)
            flux = per_m2 * field.times_square(view.camera_m, horizontal_m)[:, :GROUPS]
            around += flux[AROUND]
            place, symmetry = direction_of(view.direction)
            towards = flux[TOWARDS] * self._area[place] * own.transmission(view.direction)
            if view.concrete_m > 0.0:
                towards *= np.exp(-self._concrete * view.concrete_m)
            places.append(place)
            symmetries.append(symmetry)
            rates.append(towards)
        for area in areas:
            around += 1e-6 * area.around
            turns, sides = np.nonzero(area.towards.any(axis=2))
            places += sides.tolist()
            symmetries += turns.tolist()
            rates.append((1e-6 * area.towards[turns, sides] * self._area[sides]).ravel())
        bins = np.add.outer([*(place * GROUPS for place in places), ISOTROPIC * GROUPS], np.arange(GROUPS)).ravel()
        every = np.concatenate([*rates, around * self._area[ISOTROPIC]])
        return Around(bins, np.repeat([*symmetries, FROM_ALL_DIRECTIONS], GROUPS), every)

    def _natural_flux(self, height_m: float, time_s: float) -> FloatArray:
        """(GROUPS,) per m2 and s."""
        ground = self._ground
        flux = ground.natural * natural_flux(ground.kind, height_m)
        added = 0.0 if ground.rain is None else ground.rain.added(time_s)
        return flux if added == 0.0 else flux + added * rain_flux(ground.kind, height_m)
