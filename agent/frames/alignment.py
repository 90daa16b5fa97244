"""One drone's pose from what it and others saw of each other, with nothing known before: every heading is tried.

For each of a fan of headings a place is guessed (the median of what single sightings with a range say; where the bearings cross;
around the others where there are ranges only), and all these starts are fitted at once by Gauss-Newton with errors that are first
taken to be wide and then shrink to what they are (graduated, as in Yang et al. 2020): false positives lose their weight, and
neighbouring starts run into the same optimum. It is to be believed only where any other heading explains the data clearly worse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agent.frames.sightings import (
    Array,
    Fixes,
    Ints,
    Sightings,
    belief,
    fix_evidence,
    sighting_evidence,
    turned,
    turned_per_yaw,
)

HEADINGS = 16
_FEW_HEADINGS, _AROUND, _ABOVE_M = 8, 6, 2.0  # and places around the others, above and below, where only ranges are known
_WIDTHS = (400.0, 400.0, 100.0, 100.0, 25.0, 9.0, 4.0, 1.0, 1.0, 1.0, 1.0)  # of the variances, round by round
_DISTINCT_YAW = 0.35  # rad; further apart two solutions are two
_DISTINCT_M = 1.0
_NEAREST_M = 0.3
_FLOOR = np.array([1e-6, 1e-6, 1e-6, 1e-6])  # information that a fit never lacks, so that it can be solved


@dataclass(frozen=True, slots=True)
class Views:
    """M sightings of or by one drone, the other ends' places known. outward: (M,) whether it is the drone that saw.

    moved: (M, 3) the drone's displacement since the reference, its local frame. other: (M, 3) where the other one was, mission
    frame. direction: (M, 3) local frame where outward, else mission frame. Variances as in ``Sightings``.
    places: (F, 3) where the drone was by a fix, moved_place: (F, 3), place_var: (F, 3).
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


@dataclass(frozen=True, slots=True)
class Alignment:
    """The best pose (4,), its covariance (4, 4) as far as the others are known exactly, the logarithm of its likelihood, by how
    much that is above the next best of another heading or place, and the share of sightings that it explains.
    """

    pose: Array
    covariance: Array
    evidence: float
    lead: float
    share: float


def views_of(drone: int, data: Sightings, others: Array, others_var: Array, at: Array, fixes: Fixes, moving_var: Array) -> Views:
    """Sightings by or of ``drone`` as seen from it.

    others: (M, 4) poses of the other ends at the sightings' times; others_var: (M, 2) variances of their places (each axis) and
    headings. at: (3,) the reference in the drone's continuous frame. moving_var: (M,) m^2 of drift since.
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
    """The pose that explains most; None where there is nothing to go by."""
    starts = _starts(views)
    if not len(starts):
        return None
    pose = starts
    for width in _WIDTHS:
        information, pull, _, _ = _fit(views, pose, width)
        pose = pose + np.linalg.solve(information, pull[:, :, None])[:, :, 0]
    information, _, evidence, share = _fit(views, pose, 1.0)
    best = int(np.argmax(evidence))
    turn = pose[:, 3] - pose[best, 3]
    apart = np.linalg.norm(pose[:, :3] - pose[best, :3], axis=1) > _DISTINCT_M
    distinct = apart | (np.abs(np.arctan2(np.sin(turn), np.cos(turn))) > _DISTINCT_YAW)
    lead = float(evidence[best] - evidence[distinct].max()) if distinct.any() else np.inf
    found = pose[best].copy()
    found[3] = np.arctan2(np.sin(found[3]), np.cos(found[3]))
    return Alignment(found, np.linalg.inv(information[best]), float(evidence[best]), lead, float(share[best]))


def evidence_of(views: Views, pose: Array) -> float:
    """Logarithm of the likelihood of the data with the drone at one pose (4,)."""
    return float(_fit(views, pose[None], 1.0)[2][0])


def _starts(views: Views) -> Array:
    """(S, 4) poses to start from."""
    yaws: Array = np.arange(HEADINGS, dtype=np.float64) * (2.0 * np.pi / HEADINGS)
    arm = turned(yaws[:, None], np.broadcast_to(views.moved, (HEADINGS, *views.moved.shape)))
    toward = _toward(views, yaws)
    starts = []
    both = np.isfinite(views.direction_var) & np.isfinite(views.range_var)
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
    """(S, M, 3) measured directions from the drone to the others, mission frame, were the drone's heading ``yaws`` (S,)."""
    outward = views.outward[:, None] == 1
    own = turned(yaws[:, None], np.broadcast_to(views.direction, (len(yaws), *views.direction.shape)))
    return np.where(outward, own, -views.direction)


def _fit(views: Views, pose: Array, width: float) -> tuple[Array, Array, Array, Array]:
    """Of poses (S, 4): information (S, 4, 4), gradient (S, 4), log likelihood (S,), share of sightings explained (S,), all
    variances taken ``width`` times as large."""
    count, yaw = len(pose), pose[:, 3][:, None]
    information, pull = np.zeros((count, 4, 4)), np.zeros((count, 4))
    information += np.diag(_FLOOR)
    evidence, share = np.zeros(count), np.ones(count)
    if len(views.other):
        arm = turned(yaw, np.broadcast_to(views.moved, (count, *views.moved.shape)))
        apart = views.other - pose[:, None, :3] - arm  # from the drone to the others
        distance = np.maximum(np.sqrt((apart * apart).sum(-1)), _NEAREST_M)
        along = apart / distance[..., None]
        toward = _toward(views, pose[:, 3])
        slope = np.zeros((*distance.shape, 4, 4))  # of (direction, range) by (x, y, z, yaw)
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
        weight = belief(true, false)
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
    weighted = (slope * (belief(true, false)[..., None] / var)[..., None]).reshape(count, -1, 4)
    information += np.swapaxes(weighted, 1, 2) @ slope.reshape(count, -1, 4)
    pull -= (np.swapaxes(weighted, 1, 2) @ residual.reshape(count, -1, 1))[..., 0]
    evidence += np.logaddexp(true, false).sum(1)
