"""Pose of a drone from relative observations between it and the others, without a prior: every heading is tried.

For each of a set of headings a position is guessed: the median of the positions by single sightings with a range, or the crossing
of the bearings. With ranges alone, places around the others are tried. All these starts are refined at once by Gauss-Newton, with
variances that begin wide and shrink to their stated values (graduated non-convexity, as in Yang et al. 2020). False positives
lose their weight, and neighbouring starts converge to the same optimum. A false sighting of the only drone with a well-known
place outweighs all others at first, and would attract every start. Starts of directions with ranges are therefore also refined
from narrow variances on. The result is reliable only if every other heading explains the data clearly worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radron.agent.frames.residuals import (
    NEAREST_M,
    Fixes,
    Ints,
    Sightings,
    fix_evidence,
    inlier_probability,
    sighting_evidence,
    turned,
    turned_per_yaw,
)
from radron.agent.geometry import Array

HEADINGS = 16
_FEW_HEADINGS, _AROUND, _ABOVE_M = 8, 6, 2.0  # start positions around the others where there are only ranges
_WIDTHS = (400.0, 400.0, 100.0, 100.0, 25.0, 9.0, 4.0, 1.0, 1.0, 1.0, 1.0)  # factors on the variances, one per iteration
_NARROW = _WIDTHS[5:]
_DISTINCT_YAW = 0.35  # rad; larger differences in heading make solutions distinct
_DISTINCT_M = 1.0
_FLOOR = np.array([1e-6, 1e-6, 1e-6, 1e-6])  # prior information that keeps every fit solvable


@dataclass(frozen=True, slots=True)
class Views:
    """The measurements by which the pose of one drone is found: M sightings (relative observations) by or of it, and F satellite
    positions.

    The positions of the other drones are known. outward: (M,) 1 if the drone is the observer, else 0. moved: (M, 3) displacement
    of the drone since the reference time, in its local frame. other: (M, 3) position of the other drone, mission frame.
    direction: (M, 3) unit vectors, in the drone's local frame if it is the observer, else in the mission frame. Variances as in
    ``Sightings``. places: (F, 3) satellite positions of the drone, mission frame; moved_place: (F, 3) its displacements at those
    times; place_var: (F, 3) m^2.
    """

    outward: Ints
    moved: Array
    other: Array
    direction: Array
    direction_var: Array
    range_m: Array
    range_var: Array
    places: Array
    moved_place: Array
    place_var: Array

    @property
    def with_both(self) -> NDArray[np.bool_]:
        """Mask (M,) of the relative observations that have both a direction and a range."""
        return np.isfinite(self.direction_var) & np.isfinite(self.range_var)


@dataclass(frozen=True, slots=True)
class Alignment:
    """The best pose of a drone found from relative observations, and how certain it is.

    pose: (4,) x, y, z, yaw. covariance: (4, 4), with the other drones' poses taken as exact. evidence: log likelihood. lead: log
    likelihood ratio to the next best solution with another heading or position. share: part of the sightings that the pose
    explains.
    """

    pose: Array
    covariance: Array
    evidence: float
    lead: float
    share: float


def views_of(drone: int, data: Sightings, others: Array, others_var: Array, at: Array, fixes: Fixes, moving_var: Array) -> Views:
    """Return the M sightings by or of ``drone`` from this drone's point of view, as input of ``align``.

    others: (M, 4) poses of the other drones at the times of the sightings; others_var: (M, 2) variances of their positions (per
    axis) and headings. at: (3,) the drone's position in its continuous frame at the reference time. moving_var: (M,) m^2 of drift
    since each sighting.
    """
    outward = data.observer == drone
    own = np.where(outward[:, None], data.at_observer, data.at_target)
    direction = np.where(outward[:, None], data.direction, turned(others[:, 3], data.direction))
    apart_var = np.maximum(data.range_m, 3.0) ** 2
    place_var = others_var[:, 0] + moving_var
    return Views(
        outward.astype(np.int64),
        own - at,
        others[:, :3],
        direction,
        data.direction_var + place_var / apart_var + np.where(outward, 0.0, others_var[:, 1]),
        data.range_m,
        data.range_var + place_var,
        fixes.place,
        fixes.at - at,
        fixes.var * fixes.inflation[:, None],
    )


def align(views: Views) -> Alignment | None:
    """Find the pose of a drone that explains its measurements best, without a prior: every heading is tried. None without
    measurements.
    """
    starts = _starts(views)
    if not len(starts):
        return None
    pose = _refined(views, starts, _WIDTHS)
    if views.with_both.any():  # starts of bearings alone are too far off
        pose = np.concatenate([pose, _refined(views, starts, _NARROW)])
    information, _, evidence, share = _fit(views, pose, 1.0)
    best = int(np.argmax(evidence))
    turn = pose[:, 3] - pose[best, 3]
    apart = np.linalg.norm(pose[:, :3] - pose[best, :3], axis=1) > _DISTINCT_M
    distinct = apart | (np.abs(np.arctan2(np.sin(turn), np.cos(turn))) > _DISTINCT_YAW)
    lead = float(evidence[best] - evidence[distinct].max()) if distinct.any() else np.inf
    found = pose[best].copy()
    found[3] = np.arctan2(np.sin(found[3]), np.cos(found[3]))
    return Alignment(found, np.linalg.inv(information[best]), float(evidence[best]), lead, float(share[best]))


def _refined(views: Views, pose: Array, widths: Sequence[float]) -> Array:
    """Poses (S, 4) after a Gauss-Newton step for each of the widths."""
    for width in widths:
        information, pull, _, _ = _fit(views, pose, width)
        pose = pose + np.linalg.solve(information, pull[:, :, None])[:, :, 0]
    return pose


def evidence_of(views: Views, pose: Array) -> float:
    """Return the log likelihood of a drone's measurements (``Views``) for one pose (4,) of the drone: x, y, z, yaw."""
    return float(_fit(views, pose[None], 1.0)[2][0])


def _starts(views: Views) -> Array:
    """Initial poses (S, 4)."""
    yaws: Array = np.arange(HEADINGS, dtype=np.float64) * (2.0 * np.pi / HEADINGS)
    arm = turned(yaws[:, None], np.broadcast_to(views.moved, (HEADINGS, *views.moved.shape)))
    toward = _toward(views, yaws)
    starts = []
    both = views.with_both
    bearing = np.isfinite(views.direction_var)
    if both.any():
        places = views.other[both] - arm[:, both] - toward[:, both] * views.range_m[both, None]
        starts.append(np.concatenate([np.median(places, axis=1), yaws[:, None]], axis=1))
    elif bearing.sum() >= 2:
        across = np.eye(3) - toward[:, bearing, :, None] * toward[:, bearing, None, :]
        pull = (across @ (views.other[bearing] - arm[:, bearing])[..., None]).sum(1)
        starts.append(np.concatenate([np.linalg.solve(across.sum(1) + 1e-3 * np.eye(3), pull)[:, :, 0], yaws[:, None]], axis=1))
    elif len(views.other):
        middle, radius = views.other.mean(0), float(np.median(views.range_m))
        angle = np.arange(_AROUND) * (2.0 * np.pi / _AROUND)
        height = np.tile([-_ABOVE_M, _ABOVE_M], _AROUND)
        angle = np.repeat(angle, 2)
        ring = middle + np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
        few = yaws[:: HEADINGS // _FEW_HEADINGS]
        starts.append(np.concatenate([np.tile(ring, (len(few), 1)), np.repeat(few, len(ring))[:, None]], axis=1))
    if len(views.places):
        arms = turned(yaws[:, None], np.broadcast_to(views.moved_place, (HEADINGS, *views.moved_place.shape)))
        starts.append(np.concatenate([np.median(views.places - arms, axis=1), yaws[:, None]], axis=1))
    return np.concatenate(starts) if starts else np.zeros((0, 4))


def _toward(views: Views, yaws: Array) -> Array:
    """Measured directions (S, M, 3) from the drone to the others in the mission frame, for headings ``yaws`` (S,)."""
    outward = views.outward[:, None] == 1
    own = turned(yaws[:, None], np.broadcast_to(views.direction, (len(yaws), *views.direction.shape)))
    return np.where(outward, own, -views.direction)


def _fit(views: Views, pose: Array, width: float) -> tuple[Array, Array, Array, Array]:
    """One Gauss-Newton step's terms for poses (S, 4), with all variances multiplied by ``width``.

    Returns information (S, 4, 4), gradient (S, 4), log likelihood (S,) and the share of sightings explained (S,).
    """
    count, yaw = len(pose), pose[:, 3][:, None]
    information, pull = np.zeros((count, 4, 4)), np.zeros((count, 4))
    information += np.diag(_FLOOR)
    evidence, share = np.zeros(count), np.ones(count)
    if len(views.other):
        arm = turned(yaw, np.broadcast_to(views.moved, (count, *views.moved.shape)))
        apart = views.other - pose[:, None, :3] - arm  # from the drone to the others
        distance = np.maximum(np.sqrt((apart * apart).sum(-1)), NEAREST_M)
        along = apart / distance[..., None]
        toward = _toward(views, pose[:, 3])
        slope = np.zeros((*distance.shape, 4, 4))  # derivative of (direction, range) by (x, y, z, yaw)
        arm_slope = turned_per_yaw(arm)
        across = (np.eye(3) - along[..., :, None] * along[..., None, :]) / distance[..., None, None]
        slope[..., :3, :3] = -across
        slope[..., :3, 3] = -(across @ arm_slope[..., None])[..., 0] - views.outward[:, None] * turned_per_yaw(toward)
        slope[..., 3, :3] = -along
        slope[..., 3, 3] = -(along * arm_slope).sum(-1)
        residual = np.concatenate([along - toward, (distance - views.range_m)[..., None]], axis=-1)
        direction_var, range_var = width * views.direction_var, width * views.range_var
        squared = residual**2
        true, false = sighting_evidence(squared[..., :3].sum(-1), direction_var, squared[..., 3], range_var)
        weight = inlier_probability(true, false)
        weights = np.empty(residual.shape)
        weights[..., :3] = (weight / direction_var)[..., None]
        weights[..., 3] = weight / range_var
        weighted = (slope * weights[..., None]).reshape(count, -1, 4)
        flat = slope.reshape(count, -1, 4)
        information += np.swapaxes(weighted, 1, 2) @ flat
        pull -= (np.swapaxes(weighted, 1, 2) @ residual.reshape(count, -1, 1))[..., 0]
        evidence += np.logaddexp(true, false).sum(1)
        share = weight.mean(1)
    if len(views.places):
        _add_places(views, pose, width, information, pull, evidence)
    return information, pull, evidence, share


def _add_places(views: Views, pose: Array, width: float, information: Array, pull: Array, evidence: Array) -> None:
    count = len(pose)
    arm = turned(pose[:, 3][:, None], np.broadcast_to(views.moved_place, (count, *views.moved_place.shape)))
    residual = pose[:, None, :3] + arm - views.places
    var = np.broadcast_to(width * views.place_var, residual.shape)
    true, false = fix_evidence(residual**2, var)
    slope = np.zeros((*residual.shape, 4))
    slope[..., :3] = np.eye(3)
    slope[..., 3] = turned_per_yaw(arm)
    weighted = (slope * (inlier_probability(true, false)[..., None] / var)[..., None]).reshape(count, -1, 4)
    information += np.swapaxes(weighted, 1, 2) @ slope.reshape(count, -1, 4)
    pull -= (np.swapaxes(weighted, 1, 2) @ residual.reshape(count, -1, 1))[..., 0]
    evidence += np.logaddexp(true, false).sum(1)
