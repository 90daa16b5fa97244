"""True parameters of simulated cameras, of the ground below them and of rain."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace

NonNegative = Annotated[float, Meta(ge=0.0, le=1e9)]
Positive = Annotated[float, Meta(gt=0.0, le=1e9)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class CameraTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """True parameters of a simulated camera, a MiniPIX TPX3 (pixel detector) with a 2 mm CdTe sensor.

    Each parameter may be varied to deviate from the agent's model.

    Sensor (a change of these builds another bank of simulated events):
        drift_ns: time in which a cloud of electrons drifts through the whole thickness. The pixels are on the rear (z = -1 mm).
        diffusion_mm: standard deviation of a point charge after this drift; grows with the root of the drift. Thermal diffusion
            alone, sqrt(2 kT/q thickness / field) at 465 V, would be 0.021 mm.
        gain_noise: relative standard deviation of the charge collected from one interaction.
        pixel_noise_kev: standard deviation per pixel; with the gain noise sqrt(2.5^2 + (0.02 E)^2) keV for a cluster (adjacent
            pixels hit by one particle) of ten pixels.
        threshold_kev: a pixel with less charge is silent.
        charge_scale: compensates for the charge of silent pixels, as the absolute calibration of a real camera does.
        toa_jitter_ns: standard deviation of the arrival time (ToA) per pixel.

    Electronics and surroundings:
        calibration_spread: relative standard deviation, from pixel to pixel, of the coefficients that the calibration files give.
        calibration_error: relative standard deviation of a pixel's true slope from the file's.
        dead_block: share of the pixels that are dead: a square in the corner of the lowest columns and rows.
        dead_time_ns: dead time of a pixel after the end of its pulse. max_hits_per_s: limit of the readout.
        background_hits_per_s: hits from the surroundings, without the source.
        scatter_near, scatter_air: hits by photons scattered in ground, mount and air, as a share of the direct hits:
            near + air * mu d, with mu the air's attenuation coefficient and d the distance. Where a ground is simulated
            (``GroundTruth``), only near counts, for vehicle and mount, and background_hits_per_s are hits of another origin.

    Unknown on board, drawn for each camera and flight; all off by default:
        sensitivity_spread: relative standard deviation of a camera's counts, of source and background alike.
        energy_gain_spread: relative standard deviation of the slope of its energies from the calibration files'.
        background_drift: standard deviation of the logarithm of the background's rate, which varies about the configured rate
            with the correlation time background_drift_s.
        shadow: share of the direct photons that the vehicle's body absorbs along the line through its centre. The body is a
            ball behind the camera (around -z), with the angular radius shadow_half_angle_deg.
        anisotropy: relative standard deviation, over directions and cameras, of the counts of photons straight from a source: a
            response by direction that differs smoothly from the sensor's own.
        clock_offset_s: limit of the constant offset of the camera's clock from the vehicle's, uniform between minus and plus
            this value.
    """

    drift_ns: Positive = 86.0
    diffusion_mm: NonNegative = 0.028
    gain_noise: Share = 0.017
    pixel_noise_kev: NonNegative = 0.7
    threshold_kev: Positive = 4.0
    charge_scale: Positive = 1.02
    toa_jitter_ns: NonNegative = 2.5

    calibration_spread: Annotated[float, Meta(ge=0.0, le=0.1)] = 0.0
    calibration_error: Annotated[float, Meta(ge=0.0, le=0.2)] = 0.0
    dead_block: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.0
    dead_time_ns: NonNegative = 475.0
    max_hits_per_s: Positive = 2.35e6
    background_hits_per_s: Annotated[float, Meta(ge=0.0, le=1e5)] = 1.5
    scatter_near: NonNegative = 0.2
    scatter_air: NonNegative = 0.8

    sensitivity_spread: Annotated[float, Meta(ge=0.0, le=0.3)] = 0.0
    energy_gain_spread: Annotated[float, Meta(ge=0.0, le=0.2)] = 0.0
    background_drift: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.0
    background_drift_s: Annotated[float, Meta(gt=0.0, le=1e6)] = 120.0
    shadow: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.0
    shadow_half_angle_deg: Annotated[float, Meta(gt=0.0, lt=90.0)] = 35.0
    anisotropy: Annotated[float, Meta(ge=0.0, le=0.3)] = 0.0
    clock_offset_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0


GroundKind = Literal["soil", "sand", "asphalt", "concrete", "water"]


class RainTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A rain shower that washes radioactive daughters of radon out of the air onto the ground, all at once.

    at_s: time since the start of the simulation. factor: air kerma rate 1 m above soil directly after the shower, divided by the
    rate before. half_life_s: half-life of the added rate; Pb-214 (27 min) and Bi-214 (20 min) together decay with about half an
    hour.
    """

    at_s: NonNegative = 0.0
    factor: Annotated[float, Meta(ge=1.0, le=100.0)] = 1.5
    half_life_s: Positive = 1800.0

    def added(self, time_s: float) -> float:
        """Return the air kerma rate of radon's daughters on the ground, divided by the rate of dry soil.

        ``time_s``: seconds since the start of the simulation.
        """
        since_s = time_s - self.at_s
        return 0.0 if since_s < 0.0 else (self.factor - 1.0) * 0.5 ** (since_s / self.half_life_s)


class GroundTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The ground below sources and cameras, which scatters photons and sends out its own (``radron.sim.radiation.ground``).

    kinds: one of these is drawn from the seed. depth_m: depth of all sources that are not above the ground. natural: activity of
    K-40, uranium and thorium series, relative to the usual activity of this kind of ground. rain: None: no rain.
    """

    kinds: Annotated[tuple[GroundKind, ...], Meta(min_length=1, max_length=5)] = ("soil",)
    depth_m: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0
    natural: Annotated[float, Meta(ge=0.0, le=100.0)] = 1.0
    rain: RainTruth | None = None

    @property
    def kind(self) -> GroundKind:
        """The kind of ground of this flight."""
        return self.kinds[0]

    def drawn(self, rng: np.random.Generator) -> GroundTruth:
        """Return this ground with one of its kinds, chosen at random."""
        return replace(self, kinds=(self.kinds[int(rng.integers(len(self.kinds)))],))
