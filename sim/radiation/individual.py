"""Deviations of one simulated camera from the assumed one: sensitivity, anisotropy, background drift, shadow, clock."""

from __future__ import annotations

import math

import numpy as np

from radron.sim.geometry import Array
from radron.sim.radiation.truth import CameraTruth


class Individual:
    """Deviations of one simulated camera from the camera that the agents assume, drawn at random.

    They are drawn from a separate random stream: enabling them leaves all other random numbers of a flight unchanged.
    sensitivity: factor on all counts. clock_offset_ns: time of the camera's clock minus the vehicle's.
    """

    def __init__(self, truth: CameraTruth, rng: np.random.Generator) -> None:
        """``rng``: random numbers of the camera; a stream is split off, and the state of ``rng`` is unchanged."""
        self._truth = truth
        self._rng = rng.spawn(1)[0]
        self.sensitivity = math.exp(truth.sensitivity_spread * self._rng.standard_normal())
        self.clock_offset_ns = round(self._rng.uniform(-1.0, 1.0) * truth.clock_offset_s * 1e9)
        self._log_background = truth.background_drift * self._rng.standard_normal()
        self._dipole, self._quadrupole = _anisotropy(self._rng.spawn(1)[0])
        self._least_cosine = math.cos(math.radians(truth.shadow_half_angle_deg))

    def background(self, span_s: float) -> float:
        """Return the factor of the background's rate after a further time ``span_s`` has passed.

        The logarithm of the factor is a first-order Gauss-Markov process.
        """
        truth = self._truth
        if truth.background_drift == 0.0:
            return 1.0
        keep = math.exp(-span_s / truth.background_drift_s)
        kick = truth.background_drift * math.sqrt(1.0 - keep * keep)
        self._log_background = keep * self._log_background + kick * self._rng.standard_normal()
        return math.exp(self._log_background)

    def transmission(self, direction: tuple[float, float, float]) -> float:
        """Return the share of direct photons from a direction (unit vector, camera frame) that this camera counts.

        It covers the shadow of the vehicle's body and the camera's anisotropy; 1 is the response of the assumed camera.
        """
        factor = self._body_transmission(direction)
        if self._truth.anisotropy == 0.0:
            return factor
        unit = np.array(direction)
        return factor * math.exp(self._truth.anisotropy * float(self._dipole @ unit + unit @ self._quadrupole @ unit))

    def _body_transmission(self, direction: tuple[float, float, float]) -> float:
        """Transmission of the vehicle's body for photons from a direction (unit vector, camera frame).

        The body is a ball, so the path through it at an angle a from its centre is sqrt(1 - (sin a / sin A)^2) of that through
        the centre, with A its angular radius.
        """
        cosine = -direction[2]
        if self._truth.shadow == 0.0 or cosine <= self._least_cosine:
            return 1.0
        way = math.sqrt(max(0.0, 1.0 - (1.0 - cosine * cosine) / (1.0 - self._least_cosine**2)))
        return float((1.0 - self._truth.shadow) ** way)


def _anisotropy(rng: np.random.Generator) -> tuple[Array, Array]:
    """A dipole (3,) and a quadrupole (3, 3), symmetric and without trace, whose sum over directions has the mean square 1.

    Each has half of it: of a dipole p it is |p|^2 / 3, of a quadrupole Q it is 2 tr(Q^2) / 15, here on average 1 and 2/3.
    """
    dipole, random = rng.standard_normal(3), rng.standard_normal((3, 3))
    quadrupole = (random + random.T) / 2.0
    quadrupole -= np.eye(3) * np.trace(quadrupole) / 3.0
    return dipole * math.sqrt(0.5), quadrupole * math.sqrt(0.75)
