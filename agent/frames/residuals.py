"""Residuals, Jacobians and robust weights of sightings and fixes.

A pose is (x, y, z, yaw) of a drone in the mission frame at a reference time: its position, and the heading of its local frame.
Its position at another time follows from its own track: x + R(yaw) d, with the displacement d in its (continuous) local frame.

Each datum either has its stated error or, with prior probability ``OUTLIER_SHARE``, is an outlier of any value. Its weight is the
posterior probability of the former; iterating these weights converges to a maximum of the mixture's likelihood
(expectation-maximisation; Dempster et al. 1977).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from radron.agent.geometry import Array

Ints = NDArray[np.int64]

OUTLIER_SHARE = 0.1  # prior share of sightings of other objects than the target
FIX_OUTLIER_SHARE = 0.02  # prior share of wrong fixes (multipath, spoofing, a faulty drone)
_FARTHEST_M = 60.0  # outlier ranges are uniform up to here
_SPREAD_M = 100.0  # outlier fixes are uniform in a cube of this edge
NEAREST_M = 0.3  # two drones are never nearer; keeps the directions' Jacobians finite


class _Columns(ABC):
    """Rows of data as arrays, one per field of the derived dataclass."""

    __slots__: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(getattr(self, self.__slots__[0]))

    def take(self, chosen: NDArray[np.bool_] | Ints | slice) -> Self:
        """The chosen rows."""
        return type(self)(*(getattr(self, name)[chosen] for name in self.__slots__))

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """All rows of the parts, in order."""
        if not parts:
            return cls.empty()
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__))

    @classmethod
    @abstractmethod
    def empty(cls) -> Self:
        """No rows."""


@dataclass(frozen=True, slots=True)
class Sightings(_Columns):
    """M relative observations between drones (sightings), as arrays.

    Drones are given by their index in the mission; positions and directions are in the drones' local frames, made continuous over
    jumps. observer, target: (M,) drones. stamp_ns: (M,). at_observer, at_target: (M, 3) positions of the two. direction: (M, 3)
    unit vectors to the target in the observer's frame; direction_var: (M,) rad^2 of each of its two axes. range_m, range_var:
    (M,) distance (m) and its variance. An infinite variance means that there is no such measurement. clock_var: (M,) m^2 by which
    the target's position is uncertain because of the two drones' clocks.
    """

    observer: Ints
    target: Ints
    stamp_ns: Ints
    at_observer: Array
    at_target: Array
    direction: Array
    direction_var: Array
    range_m: Array
    range_var: Array
    clock_var: Array

    @classmethod
    def empty(cls) -> Sightings:
        """Return an empty set of sightings (relative observations)."""
        none, ints = np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
        return cls(ints, ints, ints, none, none, none, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, slots=True)
class Fixes(_Columns):
    """F satellite positions (fixes) of drones in the mission frame, as arrays.

    drone: (F,) indices in the mission. at: (F, 3) position by the drone's own localisation at that time. place, var: (F, 3)
    measured position (m) and variance (m^2). inflation: (F,) factor on the variance, for the correlation with the previous fix.
    """

    drone: Ints
    stamp_ns: Ints
    at: Array
    place: Array
    var: Array
    inflation: Array

    @classmethod
    def empty(cls) -> Fixes:
        """Return an empty set of fixes."""
        none, ints = np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
        return cls(ints, ints, none, none, none, np.zeros(0))


def turned(yaw_rad: Array, vectors: Array) -> Array:
    """Rotate vectors (..., 3) about the vertical by yaws (...,), rad."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.stack([c * x - s * y, s * x + c * y, z + 0.0 * c], axis=-1)


def turned_per_yaw(rotated: Array) -> Array:
    """Return the derivative of a rotated vector R(yaw) v by yaw, from R(yaw) v (..., 3)."""
    return np.stack([-rotated[..., 1], rotated[..., 0], np.zeros_like(rotated[..., 0])], axis=-1)


def sighting_residuals(
    observer: Array, target: Array, moved_observer: Array, moved_target: Array, direction: Array, range_m: Array
) -> tuple[Array, Array, Array]:
    """Return predicted minus measured direction and range of M sightings, (M, 4), and the Jacobians (M, 4, 4) by each drone's
    pose.

    The residuals are three components of a unit vector in the observer's frame, and the range (m). A direction opposite to its
    prediction has a residual of 2, not of 0 as it would in a tangent plane.

    observer, target: (M, 4) poses x, y, z, yaw of the two drones' frames. moved_observer, moved_target: (M, 3) displacements
    since the reference time, local frames. direction: (M, 3) and range_m: (M,) measured.
    """
    arm_o = turned(observer[:, 3], moved_observer)
    arm_t = turned(target[:, 3], moved_target)
    apart = target[:, :3] + arm_t - observer[:, :3] - arm_o
    distance = np.maximum(np.sqrt((apart * apart).sum(1)), NEAREST_M)
    along = apart / distance[:, None]
    seen = turned(-observer[:, 3], along)
    count = len(distance)
    across = (np.eye(3) - along[:, :, None] * along[:, None, :]) / distance[:, None, None]  # d along / d apart
    by_apart = np.empty((count, 4, 3))
    c, s = np.cos(observer[:, 3])[:, None], np.sin(observer[:, 3])[:, None]
    by_apart[:, 0] = c * across[:, 0] + s * across[:, 1]
    by_apart[:, 1] = c * across[:, 1] - s * across[:, 0]
    by_apart[:, 2] = across[:, 2]
    by_apart[:, 3] = along
    by_observer, by_target = np.empty((count, 4, 4)), np.empty((count, 4, 4))
    by_observer[:, :, :3] = -by_apart
    by_observer[:, :, 3] = -(by_apart @ turned_per_yaw(arm_o)[:, :, None])[:, :, 0]
    by_observer[:, 0, 3] += seen[:, 1]
    by_observer[:, 1, 3] -= seen[:, 0]
    by_target[:, :, :3] = by_apart
    by_target[:, :, 3] = (by_apart @ turned_per_yaw(arm_t)[:, :, None])[:, :, 0]
    residuals = np.concatenate([seen - direction, (distance - range_m)[:, None]], axis=1)
    return residuals, by_observer, by_target


def fix_residuals(pose: Array, moved: Array, place: Array) -> tuple[Array, Array]:
    """Return predicted minus measured position (F, 3) of F satellite positions, and its Jacobian (F, 3, 4) by the pose of the
    frame.

    pose: (F, 4) x, y, z, yaw of the drones' frames. moved: (F, 3) displacement since the reference time. place: (F, 3) measured.
    """
    arm = turned(pose[:, 3], moved)
    jacobian = np.zeros((len(pose), 3, 4))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, :, 3] = turned_per_yaw(arm)
    return pose[:, :3] + arm - place, jacobian


def sighting_evidence(
    squared_direction: Array, direction_var: Array, squared_range: Array, range_var: Array
) -> tuple[Array, Array]:
    """Return the log likelihoods of relative observations (sightings, arrays of any shape) as correct measurements and as
    outliers.

    An outlier is, for example, a sighting of another object. Direction and range of a sighting are correct or outliers together.
    squared_direction, squared_range: squared residuals. direction_var, range_var: variances of each of the direction's two axes
    and of the range, infinite if not measured.
    """
    has_direction, has_range = np.isfinite(direction_var), np.isfinite(range_var)
    direction_var = np.where(has_direction, direction_var, 1.0)
    range_var = np.where(has_range, range_var, 1.0)
    true = np.log(1.0 - OUTLIER_SHARE) + np.where(
        has_direction, -0.5 * squared_direction / direction_var - np.log(2.0 * np.pi * direction_var), 0.0
    )
    true = true + np.where(has_range, -0.5 * squared_range / range_var - 0.5 * np.log(2.0 * np.pi * range_var), 0.0)
    false = (
        np.log(OUTLIER_SHARE) - np.where(has_direction, np.log(4.0 * np.pi), 0.0) - np.where(has_range, np.log(_FARTHEST_M), 0.0)
    )
    return true, false


def fix_evidence(squared: Array, var: Array) -> tuple[Array, Array]:
    """Return the log likelihoods of satellite positions as correct measurements and as outliers.

    squared, var: (..., 3) squared residuals and variances (m^2).
    """
    true = np.log(1.0 - FIX_OUTLIER_SHARE) - 0.5 * (squared / var + np.log(2.0 * np.pi * var)).sum(-1)
    return true, np.full_like(true, np.log(FIX_OUTLIER_SHARE) - 3.0 * np.log(_SPREAD_M))


def inlier_probability(true: Array, false: Array) -> Array:
    """Return the posterior probability that a measurement is correct, from its log likelihoods as correct and as outlier."""
    weight: Array = 1.0 / (1.0 + np.exp(np.clip(false - true, -50.0, 50.0)))
    return weight
