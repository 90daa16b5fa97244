"""The simulated camera in a fixed beam of photons, each of which is fully transported.

It is slower than ``Camera``, but needs no stored events.
"""

from __future__ import annotations

import math

import numpy as np

from radron.agent.detector.readout import Readout
from radron.sim.radiation.calibration import PixelCalibration
from radron.sim.radiation.camera import GUARD_TICKS, SourceView
from radron.sim.radiation.electronics import Electronics
from radron.sim.radiation.events import Events, simulate
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.nuclides import nuclide as nuclide_of
from radron.sim.radiation.surroundings import Lines, background_lines, scattered_lines
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.truth import CameraTruth

_AREA_INTERACTIONS = 30_000  # the effective area to 0.6 % or better


class BeamCamera:
    """A simulated camera with one source at a fixed direction, for recordings and tests. Every photon is fully transported.

    ``truth``: the camera's true parameters. ``nuclide``: the source's nuclide. ``view``: the source as the camera sees it.
    ``rng``: the camera's own random numbers. ``clock_ns``: UTC time of tick 0. Of the differences between cameras only the energy
    gain is simulated: no sensitivity, drift, shadow or clock. Raises ConfigError for an unknown nuclide.
    """

    def __init__(self, truth: CameraTruth, nuclide: str, view: SourceView, rng: np.random.Generator, clock_ns: int) -> None:
        source = nuclide_of(nuclide)
        self._truth = truth
        self._rng = rng
        self._view = view
        self._response = response(truth)
        attenuation = [air_attenuation_per_m(energy) for energy, _ in source.lines]
        self._arriving: Lines = tuple(
            (energy, intensity * math.exp(-mu * view.distance_m))
            for (energy, intensity), mu in zip(source.lines, attenuation, strict=True)
        )
        self._scattered = scattered_lines(source)
        self._background = background_lines()
        pilot = simulate(self._arriving, _AREA_INTERACTIONS, self._response, rng, direction=view.direction, quota=(0, 0, 0))
        # Of photons that deposit energy in the sensor; a few per cent of these stay below every pixel's threshold.
        self.direct_per_s = view.activity_bq * float(pilot.area_mm2.sum()) / (4e6 * math.pi * view.distance_m**2)
        self.scattered_per_s = self.direct_per_s * (truth.scatter_near + truth.scatter_air * min(attenuation) * view.distance_m)
        self._electronics = Electronics(truth, rng, clock_ns)

    @property
    def photons_per_s(self) -> float:
        """Mean number of photons per second that interact in the sensor, background included."""
        return self.direct_per_s + self.scattered_per_s + self._truth.background_hits_per_s

    @property
    def calibration(self) -> PixelCalibration:
        """The camera's energy calibration, with ``write(folder)`` for the agent's files."""
        return self._electronics.calibration

    def expose(self, start_ns: int, end_ns: int) -> Readout:
        """Return all pixel hits from ``start_ns`` until before ``end_ns`` (UTC); the number of photons is Poisson distributed."""
        span_s = (end_ns - start_ns) * 1e-9
        rates = (self.direct_per_s, self.scattered_per_s, self._truth.background_hits_per_s)
        parts = [
            self._events(lines, int(self._rng.poisson(rate * span_s)), direction)
            for lines, rate, direction in zip(
                (self._arriving, self._scattered, self._background), rates, (self._view.direction, None, None), strict=True
            )
        ]
        first = np.concatenate(([0], np.cumsum(np.concatenate([np.diff(part.first) for part in parts]))))
        count = len(first) - 1
        low, high = self._electronics.ticks(start_ns, end_ns)
        tick = self._rng.integers(low, max(low + 1, high - GUARD_TICKS), count)
        pixels = np.concatenate([part.pixels for part in parts])
        return self._electronics.read_out(start_ns, end_ns, pixels, first, np.arange(count), np.zeros(count, np.int64), tick)

    def _events(self, lines: Lines, count: int, direction: tuple[float, float, float] | None) -> Events:
        return simulate(lines, count, self._response, self._rng, direction=direction)
