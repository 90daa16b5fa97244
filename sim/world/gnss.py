"""Simulated satellite receivers (GNSS) on the vehicles: correlated errors, multipath jumps, outages, and the resulting fixes."""

from __future__ import annotations

from math import hypot, sqrt
from typing import Annotated

import numpy as np
import pymap3d
from msgspec import Meta, Struct

from radron.agent.config.mission import DatumConfig
from radron.agent.vehicle.interface import GnssFix
from radron.sim.geometry import Array

Metres = Annotated[float, Meta(ge=0.0, le=1000.0)]
Seconds = Annotated[float, Meta(gt=0.0, le=1e6)]


class GnssTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """True errors of a satellite receiver, 1 sigma of each axis. Defaults: a single-band receiver under an open sky.

    The correlated error is first-order Gauss-Markov, as ionosphere, orbits and multipath change. u-blox gives 2.5 m CEP (NEO-M8,
    data sheet UBX-15031086), most of it common to a flight of minutes; about 1 m of it changes within one.
    """

    horizontal_m: Metres = 1.0
    vertical_m: Metres = 1.5  # satellites are above the horizon only, which makes heights worse by half
    correlation_s: Seconds = 60.0
    white_m: Metres = 0.2  # of each fix
    rate_hz: Annotated[float, Meta(gt=0.0, le=20.0)] = 1.0
    available_s: Seconds | None = None  # mean time between outages; None: no outages
    outage_s: Seconds = 5.0  # mean duration
    undisturbed_s: Seconds | None = None  # mean time between multipath jumps; None: no jumps
    jump_m: Metres = 5.0  # of each horizontal axis
    jump_s: Seconds = 10.0  # mean time until the position jumps back


# Carrier phase against a base station: 0.01 m + 1 ppm CEP (u-blox ZED-F9P, data sheet UBX-17051259), heights twice as bad.
RTK = GnssTruth(horizontal_m=0.015, vertical_m=0.03, white_m=0.01)


class Receiver:
    """Simulates one vehicle's satellite receiver in fixed time steps.

    lost: without reception for good, or until its vehicle is to have it again. blocked: without reception, by a fault. shift_m:
    (3,) spoofing offset of all positions.
    """

    def __init__(self, truth: GnssTruth, datum: DatumConfig | None, step_s: float, rng: np.random.Generator) -> None:
        """``datum``: place on Earth of the world's origin; None: no fixes are needed."""
        self._truth, self._datum, self._step_s, self._rng = truth, datum, step_s, rng
        self._sigma = np.array([truth.horizontal_m, truth.horizontal_m, truth.vertical_m])
        self._keep = float(np.exp(-step_s / truth.correlation_s))
        self._kick = (1.0 - self._keep**2) ** 0.5
        self._wandering: Array = self._sigma * rng.standard_normal(3)
        self._jump: Array = np.zeros(3)
        self._jumped = False
        self._every = max(1, round(1.0 / (truth.rate_hz * step_s)))
        self._steps = int(rng.integers(self._every))  # the receivers of a swarm are not synchronised
        self.lost = self.blocked = False
        self._sky = True
        self.shift_m: Array = np.zeros(3)

    @property
    def available(self) -> bool:
        """Whether the receiver has a position now."""
        return self._sky and not self.lost and not self.blocked

    @property
    def error_m(self) -> Array:
        """(3,) position error (measured minus true) in the world frame, without the white noise of each fix."""
        error: Array = self._wandering + self._jump + self.shift_m
        return error

    @property
    def reported_horizontal_m(self) -> float:
        """Horizontal accuracy that the receiver reports, 1 sigma in metres."""
        return sqrt(2.0) * hypot(self._truth.horizontal_m, self._truth.white_m)

    def step(self) -> None:
        """Simulate the receiver for one time step."""
        truth, rng = self._truth, self._rng
        self._steps += 1
        self._wandering *= self._keep
        self._wandering += self._kick * self._sigma * rng.standard_normal(3)
        if truth.available_s is not None:
            mean_s = truth.available_s if self._sky else truth.outage_s
            self._sky ^= bool(rng.random() < self._step_s / mean_s)
        if truth.undisturbed_s is not None and rng.random() < self._step_s / (
            truth.jump_s if self._jumped else truth.undisturbed_s
        ):
            self._jumped = not self._jumped
            self._jump = np.append(truth.jump_m * rng.standard_normal(2), 0.0) if self._jumped else np.zeros(3)

    def fix(self, stamp_ns: int, position_m: Array) -> GnssFix | None:
        """Return the receiver's fix (geographic position) at a true position (3,) in the world.

        Return None if no fix is due or available.
        """
        if self._datum is None or not self.available or self._steps % self._every:
            return None
        truth, datum = self._truth, self._datum
        place = position_m + self.error_m + truth.white_m * self._rng.standard_normal(3)
        latitude, longitude, altitude = pymap3d.enu2geodetic(
            *place.tolist(), datum.latitude_deg, datum.longitude_deg, datum.altitude_m
        )
        return GnssFix(
            stamp_ns=stamp_ns,
            latitude_deg=float(latitude),
            longitude_deg=float(longitude),
            altitude_m=float(altitude),
            horizontal_sigma_m=self.reported_horizontal_m,
            vertical_sigma_m=hypot(truth.vertical_m, truth.white_m),
        )
