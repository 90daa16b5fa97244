"""The apparent place of the source for each vehicle's own localisation: its place plus the vehicle's position bias."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import lru_cache

import numpy as np

from radron.agent.fusion.bayes.motion import BIAS, BIASES
from radron.agent.fusion.estimator import Sight
from radron.agent.geometry import Array
from radron.agent.terrain.ground import Ground


class Sights(Mapping[str, Sight]):
    """The apparent place of the source for each vehicle: the place relative to the vehicle's own, biased position. On the ground.

    For vehicle i: y_i = x + b_i ~ N(m_x + m_b, P_xx + P_xb + P_bx + P_bb), with x the source's place, b_i the vehicle's position
    error (bias), m and P their means and covariances. Computed when accessed. mean: (d,) and covariance: (d, d) of the track's d
    variables.
    """

    def __init__(
        self, vehicles: Mapping[str, int], mean: Array, covariance: Array, ground: Ground, height_m: float = 0.0
    ) -> None:
        """Set up the mapping. ``vehicles``: index of each vehicle's biases by name. ``height_m``: of the source above
        the ground.
        """
        self._vehicles, self._mean, self._covariance, self._ground = vehicles, mean, covariance, ground
        self._height_m = height_m
        self._known: dict[str, Sight] = {}

    def __len__(self) -> int:
        return len(self._vehicles)

    def __iter__(self) -> Iterator[str]:
        return iter(self._vehicles)

    def __getitem__(self, drone: str) -> Sight:
        known = self._known.get(drone)
        if known is None:
            known = self._known[drone] = self._sight(BIASES + BIAS * self._vehicles[drone])
        return known

    def _sight(self, b: int) -> Sight:
        mean, p = self._mean.tolist(), self._covariance
        x, y = mean[0], mean[1]
        rows = p[:2] + p[b : b + 2]
        place = np.array((x + mean[b], y + mean[b + 1], self._ground.height_m(x, y) + self._height_m))
        return Sight(place, on_ground(rows[:, :2] + rows[:, b : b + 2], self._ground.slope(x, y)))


def on_ground(covariance: Array, rise: tuple[float, float]) -> Array:
    """Return the covariance (3, 3) of a place on sloping ground from its horizontal covariance P (2, 2): J P J', J = [[1, 0], [0,
    1], rise].

    rise: slope of the ground, metres per metre east and north.
    """
    (xx, xy), (yx, yy) = covariance.tolist()
    east, north = rise
    xz, yz = xx * east + xy * north, yx * east + yy * north
    return np.array(((xx, xy, xz), (yx, yy, yz), (xz, yz, east * xz + north * yz)))


def apparent_rms_m(covariance: Array, bias_variance: Array) -> float:
    """Return the horizontal RMS error (m) of the source's apparent place, relative to the positions of the n vehicles with
    measurements.

    The apparent place is x + sum_i b_i / n, with x the source's place and b_i the vehicles' position errors. The result is
    sqrt(tr(A' P A)) with A (d, 2) of ``_apparent``; covariance: (d, d) P of the d variables of the track (posterior of a found
    source).
    """
    return math.sqrt(max(float(covariance.ravel() @ _apparent(bias_variance.tobytes(), len(covariance))), 0.0))


def shares(bias_variance: Array) -> Array:
    """Return the weight of each of V vehicles (V,) in their mean: 1 / n for each of the n vehicles with measurements, else 0."""
    heard = bias_variance.reshape(-1, BIAS).any(axis=1)
    return np.asarray(heard / max(int(heard.sum()), 1), dtype=np.float64)


@lru_cache(maxsize=256)
def _apparent(biases: bytes, d: int) -> Array:
    """Return (d d,): A A' with A (d, 2) such that A' s is the apparent place; tr(A' P A) is its product with P, summed."""
    bias_variance = np.frombuffer(biases)
    apparent, share = np.zeros((d, 2)), shares(bias_variance)
    for axis in (0, 1):
        apparent[axis, axis] = 1.0
        apparent[BIASES + axis : BIASES + len(bias_variance) : BIAS, axis] = share
    return (apparent @ apparent.T).ravel()
