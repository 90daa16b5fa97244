"""The joint Gaussian over all drones' poses (x, y, z, yaw): predicted by their own tracks, corrected by relative observations and
fixes.

Cooperative localisation with the full joint covariance (Roumeliotis and Bekey 2002), so that errors that two drones share after a
sighting are not counted as independent at the next one. Each correction is one robust batch (``residuals``), relinearised until
it converges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radron.agent.frames.residuals import (
    Fixes,
    Ints,
    Sightings,
    fix_evidence,
    fix_residuals,
    inlier_probability,
    sighting_evidence,
    sighting_residuals,
    turned,
    turned_per_yaw,
)
from radron.agent.geometry import Array

# Most iterations, and the number of full steps; later steps are halved, as they may oscillate. Three are usual, and 15 for drones
# in one row with directions only: bearings hardly determine distances, but seem to during the iteration.
_ROUNDS, _WHOLE = 40, 10
_STILL = 0.02  # convergence: the step in units of sigma
_WIDE_M = 1.5  # sigma of a place beyond which several optima are possible: drones start 5 to 10 m apart
_FALSE, _FEWEST_FALSE = 0.35, 3  # likewise the share and number of rejected sightings: one in ten is false
_WIDTHS = (25.0, 5.0)  # factors on all variances in the first iterations towards another optimum


@dataclass(frozen=True, slots=True)
class Joint:
    """The joint Gaussian estimate of the poses of n drones at a reference time, with their correlations.

    drones: (n,) indices in the mission, ascending. pose: (n, 4) x, y, z (m) and yaw (rad) of each drone in the mission frame; the
    yaw is the heading of its local frame. covariance: (4n, 4n). at: (N, 3) position of each of the mission's N drones by its own
    localisation, made continuous over jumps, at the reference time (zeros if unknown). far: (N,) metres flown until then.
    """

    drones: Ints
    pose: Array
    covariance: Array
    at: Array
    far: Array

    def slots(self) -> Ints:
        """Return the row in ``pose`` of each of the mission's N drones, (N,); -1 for a drone that is not in the estimate."""
        rows = np.full(len(self.at), -1, dtype=np.int64)
        rows[self.drones] = np.arange(len(self.drones))
        return rows

    def block(self, row: int) -> Array:
        """Return the covariance (4, 4) of one drone's pose, by its row in ``pose``."""
        return self.covariance[4 * row : 4 * row + 4, 4 * row : 4 * row + 4]

    def moved(self, at: Array, far: Array, noise: Array) -> Joint:
        """Return the estimate predicted to a later time: each drone moves as its own localisation says.

        at: (N, 3) position of each drone by its own localisation. far: (N,) metres flown. noise: (n, 4) variances that are added.
        """
        count = len(self.drones)
        if not count:
            return Joint(self.drones, self.pose, self.covariance, at, far)
        arm = turned(self.pose[:, 3], at[self.drones] - self.at[self.drones])
        pose = self.pose.copy()
        pose[:, :3] += arm
        onward = np.eye(4 * count)
        rows = np.arange(count) * 4
        for axis, slope in enumerate(turned_per_yaw(arm)[:, :2].T):
            onward[rows + axis, rows + 3] = slope
        covariance = onward @ self.covariance @ onward.T
        covariance[np.diag_indices(4 * count)] += noise.ravel()
        return Joint(self.drones, pose, covariance, at, far)

    def with_drone(self, drone: int, pose: Array, covariance: Array) -> Joint:
        """Return a copy of the estimate with one more drone, whose errors are independent of all errors in the estimate.

        pose: (4,) x, y, z, yaw of the drone. covariance: (4, 4).
        """
        row = int(np.searchsorted(self.drones, drone))
        count = len(self.drones)
        wider = np.zeros((4 * count + 4, 4 * count + 4))
        others = np.delete(np.arange(4 * count + 4), np.arange(4 * row, 4 * row + 4))
        wider[np.ix_(others, others)] = self.covariance
        wider[4 * row : 4 * row + 4, 4 * row : 4 * row + 4] = covariance
        return Joint(np.insert(self.drones, row, drone), np.insert(self.pose, row, pose, axis=0), wider, self.at, self.far)

    def without(self, drone: int) -> Joint:
        """Return a copy of the estimate without one drone (marginalised out); the remaining poses and covariances do not
        change.
        """
        row = int(np.searchsorted(self.drones, drone))
        kept = np.delete(np.arange(len(self.covariance)), np.arange(4 * row, 4 * row + 4))
        return Joint(
            np.delete(self.drones, row), np.delete(self.pose, row, axis=0), self.covariance[np.ix_(kept, kept)], self.at, self.far
        )

    def widened(self, drone: int, variances: Array) -> Joint:
        """Return a copy in which the pose of one drone is less certain: variances (4,) are added to x, y, z (m^2) and yaw
        (rad^2).
        """
        covariance = self.covariance.copy()
        row = 4 * int(np.searchsorted(self.drones, drone))
        covariance[np.arange(row, row + 4), np.arange(row, row + 4)] += variances
        return Joint(self.drones, self.pose, covariance, self.at, self.far)

    def displaceable(self, variances: Array) -> Joint:
        """Return a copy in which the swarm as a whole may lie elsewhere, with the drones' relative poses as certain as before.

        variances: (4,) of a common shift of all drones (m^2), and of a common rotation around their middle (rad^2).
        """
        count = len(self.drones)
        modes = np.tile(np.eye(4), (count, 1))
        modes.reshape(count, 4, 4)[:, :3, 3] = turned_per_yaw(self.pose[:, :3] - self.pose[:, :3].mean(0))
        return Joint(self.drones, self.pose, self.covariance + (modes * variances) @ modes.T, self.at, self.far)

    def fits(self, fixes: Fixes) -> Array:
        """Return the probability (F,) that each of F satellite positions, of drones in the estimate, is correct and not an
        outlier.
        """
        rows = self.slots()[fixes.drone]
        residual, _ = fix_residuals(self.pose[rows], fixes.at - self.at[fixes.drone], fixes.place)
        var = self.covariance.diagonal().reshape(-1, 4)[rows, :3]
        return inlier_probability(*fix_evidence(residual**2, fixes.var + var))


@dataclass(frozen=True, slots=True)
class Corrected:
    """The estimate after a correction by measurements, with the probabilities that each sighting (M,) and each satellite position
    (F,) was correct.
    """

    joint: Joint
    sightings: Array
    fixes: Array


@dataclass(frozen=True, slots=True)
class Headings:
    """H compass measurements of the headings of local frames: drone index (H,), yaw_rad (H,), variance (H,) in rad^2."""

    drone: Ints
    yaw_rad: Array
    var: Array


NO_HEADINGS = Headings(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))


def corrected(
    prior: Joint,
    sightings: Sightings,
    older_var: Array,
    fixes: Fixes,
    headings: Headings = NO_HEADINGS,
    doubt: Array | None = None,
) -> Corrected:
    """Correct the drones' poses by sightings (relative observations between drones), satellite positions and compass headings.

    prior: the estimate before. sightings: between drones in the estimate. older_var: (M,) m^2 added to the uncertainty of the
    distance vector between the two drones of each of M sightings (drift since the sighting). doubt: covariance for weighting the
    first iteration, instead of the prior's, if the prior's mean is better than its covariance states.

    With uncertain places, as at the launch, nearly all sightings count in the first step, also false ones, and their result may
    decide which sightings are accepted from then on. A second run begins with larger variances, and therefore smaller steps; the
    better of the two optima counts. The second run is also made if many sightings are rejected. The first sighting of a pair may
    have been false but accepted, with all true sightings since then too far from it.
    """
    if not len(sightings) and not len(fixes) and not len(headings.drone):
        return Corrected(prior, np.zeros(0), np.zeros(0))
    batch = _Batch(prior, sightings, older_var, fixes, headings)
    found = batch.iterated(prior.covariance if doubt is None else doubt)
    is_wide = prior.covariance.diagonal().reshape(-1, 4)[:, :2].max() > _WIDE_M**2
    not_believed = int((found.sightings < 0.5).sum())
    if doubt is None and len(sightings) and (is_wide or not_believed >= max(_FEWEST_FALSE, _FALSE * len(sightings))):
        other = batch.iterated(prior.covariance, _WIDTHS)
        found = max(found, other, key=lambda one: batch.evidence(one.joint.pose))
    found.joint.pose[:, 3] = np.arctan2(np.sin(found.joint.pose[:, 3]), np.cos(found.joint.pose[:, 3]))
    return found


class _Batch:
    """Data shared by the iterations of a correction."""

    def __init__(self, prior: Joint, sightings: Sightings, older_var: Array, fixes: Fixes, headings: Headings) -> None:
        slots = prior.slots()
        self.prior, self.sightings, self.older_var, self.fixes, self.headings = prior, sightings, older_var, fixes, headings
        self.observer, self.target = slots[sightings.observer], slots[sightings.target]
        self.fixed, self.headed = slots[fixes.drone], slots[headings.drone]
        self.moved_observer = sightings.at_observer - prior.at[sightings.observer]
        self.moved_target = sightings.at_target - prior.at[sightings.target]
        self.moved_fixed = fixes.at - prior.at[fixes.drone]
        scale = 1.0 / np.sqrt(np.maximum(prior.covariance.diagonal(), 1e-18))
        self.stiffness = scale[:, None] * np.linalg.inv(scale[:, None] * prior.covariance * scale) * scale

    def iterated(self, covariance: Array, widths: Sequence[float] = ()) -> Corrected:
        """An optimum near the prior. ``covariance``: for the weights of the first iteration; ``widths``: factors on all variances
        in the first iterations.
        """
        prior, pose = self.prior, self.prior.pose
        for count in range(len(widths) + _ROUNDS):
            width = widths[count] if count < len(widths) else 1.0
            information, pull, weights = self._linearised(pose, covariance, width)
            information += self.stiffness
            pull += self.stiffness @ _pose_difference(prior.pose, pose).ravel()
            covariance = _inverse(information)
            step = (covariance @ pull).reshape(-1, 4)
            pose = pose + (step if count < len(widths) + _WHOLE else 0.5 * step)
            if count >= len(widths) and (np.abs(step).ravel() < _STILL * np.sqrt(covariance.diagonal())).all():
                break
        seen, fixed = weights
        return Corrected(Joint(prior.drones, pose, covariance, prior.at, prior.far), seen, fixed)

    def evidence(self, pose: Array) -> float:
        """Log posterior density at ``pose`` (n, 4), up to a constant."""
        off = _pose_difference(self.prior.pose, pose).ravel()
        total = -0.5 * float(off @ self.stiffness @ off)
        if len(self.sightings):
            residual, _, _ = self._sighted(pose)
            squared = residual**2
            direction_var, range_var = self._sighting_vars(residual)
            true, false = sighting_evidence(squared[:, :3].sum(1), direction_var, squared[:, 3], range_var)
            total += float(np.logaddexp(true, false).sum())
        if len(self.fixes):
            residual, _ = fix_residuals(pose[self.fixed], self.moved_fixed, self.fixes.place)
            total += float(np.logaddexp(*fix_evidence(residual**2, self.fixes.var)).sum())
        turned_by = self._turned_by(pose)
        return total - 0.5 * float((turned_by**2 / self.headings.var).sum())

    def _linearised(self, pose: Array, covariance: Array, width: float) -> tuple[Array, Array, tuple[Array, Array]]:
        """Information matrix and gradient at ``pose`` (n, 4), and the weights of sightings and fixes, with their variances
        multiplied by ``width``.

        The innovation covariance of a datum is its own error plus its prediction's share by ``covariance``.
        """
        count = len(pose)
        information, pull = np.zeros((4 * count, 4 * count)), np.zeros(4 * count)
        seen = self._add_sightings(pose, covariance, width, information, pull)
        fixed = self._add_fixes(pose, covariance, width, information, pull)
        rows = 4 * self.headed + 3
        np.add.at(information, (rows, rows), 1.0 / self.headings.var)
        np.add.at(pull, rows, self._turned_by(pose) / self.headings.var)
        return information, pull, (seen, fixed)

    def _turned_by(self, pose: Array) -> Array:
        off = self.headings.yaw_rad - pose[self.headed, 3]
        wrapped: Array = np.arctan2(np.sin(off), np.cos(off))
        return wrapped

    def _sighted(self, pose: Array) -> tuple[Array, Array, Array]:
        data = self.sightings
        return sighting_residuals(
            pose[self.observer], pose[self.target], self.moved_observer, self.moved_target, data.direction, data.range_m
        )

    def _sighting_vars(self, residual: Array) -> tuple[Array, Array]:
        """Variances (M,) of directions and ranges, with the drift since older sightings."""
        data = self.sightings
        distance = np.maximum(residual[:, 3] + data.range_m, 1.0)
        return data.direction_var + self.older_var / distance**2, data.range_var + self.older_var

    def _add_sightings(self, pose: Array, covariance: Array, width: float, information: Array, pull: Array) -> Array:
        data = self.sightings
        if not len(data):
            return np.zeros(0)
        residual, by_observer, by_target = self._sighted(pose)
        each = np.arange(len(data))
        slopes = np.zeros((len(data), 4, len(pose), 4))
        slopes[each, :, self.observer] = by_observer
        slopes[each, :, self.target] = by_target
        flat = slopes.reshape(4 * len(data), -1)
        spread = np.maximum(((flat @ covariance) * flat).sum(1), 0.0).reshape(-1, 4)
        direction_var, range_var = (width * var for var in self._sighting_vars(residual))
        squared = residual**2
        weight = inlier_probability(
            *sighting_evidence(
                squared[:, :3].sum(1), direction_var + 0.5 * spread[:, :3].sum(1), squared[:, 3], range_var + spread[:, 3]
            )
        )
        weights = np.empty((len(data), 4))
        weights[:, :3] = (weight / direction_var)[:, None]
        weights[:, 3] = weight / range_var
        weighted = flat * weights.reshape(-1, 1)
        information += weighted.T @ flat
        pull -= weighted.T @ residual.ravel()
        return weight

    def _add_fixes(self, pose: Array, covariance: Array, width: float, information: Array, pull: Array) -> Array:
        data = self.fixes
        if not len(data):
            return np.zeros(0)
        residual, by_pose = fix_residuals(pose[self.fixed], self.moved_fixed, data.place)
        slopes = np.zeros((len(data), 3, len(pose), 4))
        slopes[np.arange(len(data)), :, self.fixed] = by_pose
        flat = slopes.reshape(3 * len(data), -1)
        spread = np.maximum(((flat @ covariance) * flat).sum(1), 0.0).reshape(-1, 3)
        var = width * data.var
        weight = inlier_probability(*fix_evidence(residual**2, var + spread))
        weighted = flat * (weight[:, None] / (var * data.inflation[:, None])).reshape(-1, 1)
        information += weighted.T @ flat
        pull -= weighted.T @ residual.ravel()
        return weight


def _pose_difference(a: Array, b: Array) -> Array:
    """Difference a - b of poses, with headings wrapped to half a turn."""
    off = a - b
    off[:, 3] = np.arctan2(np.sin(off[:, 3]), np.cos(off[:, 3]))
    return off


def _inverse(matrix: Array) -> Array:
    """Inverse of a positive definite matrix with widely different scales."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    inverse = scale[:, None] * np.linalg.inv(scale[:, None] * matrix * scale) * scale
    symmetric: Array = 0.5 * (inverse + inverse.T)
    return symmetric
