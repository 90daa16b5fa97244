"""Results of the detection chain for the pilot: counts, and cones in the camera frame."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from radron.protocol.spectrum import SpectrumBin


class ConeEvent(Struct, frozen=True):
    """One coincidence (two clusters of one photon) as a Compton cone of possible directions, in both orders of the two
    interactions.

    Which cluster was the recoil electron is not measured: row 0 of each array takes cluster 1 as the electron, row 1 cluster 2.
    Camera frame, z is the sensor's outward normal. axis: (2, 3) unit vectors from the absorbed photon to the electron; the source
    lies at angle theta from this axis. theta_rad, sigma_rad, probability: (2,) opening angle, its 1 sigma, and probability of
    each order; the probabilities add up to 1. An order beyond the Compton edge has the theta of an order just below it, and the
    probability, seldom 0, that resolution and Doppler broadening put it there. energies_kev, energy_sigmas_kev: (2,) of clusters
    1 and 2.
    """

    stamp_ns: int
    axis: NDArray[np.float64]
    theta_rad: NDArray[np.float64]
    sigma_rad: NDArray[np.float64]
    probability: NDArray[np.float64]
    energies_kev: tuple[float, float]
    energy_sigmas_kev: tuple[float, float]
    separation_mm: float


class Detections(Struct, frozen=True):
    """Counts and cones of one camera in the interval [start_ns, end_ns); the intervals of one detector are contiguous.

    ``bins``: only of an ordinary detector, the counts in each channel of its table of response; their sum is ``hits``.
    """

    start_ns: int
    end_ns: int
    live_time_s: float
    hits: int = 0  # clusters above the threshold
    photopeak: int = 0  # single clusters and coincidences with the line's full energy
    coincidences: int = 0  # two clusters within the window
    cones: tuple[ConeEvent, ...] = ()
    spectrum: tuple[SpectrumBin, ...] = ()
    bins: tuple[int, ...] | None = None
