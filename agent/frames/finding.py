"""Alignment of a drone with an unknown or untrusted frame, by recent sightings between it and the others."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from radron.agent.frames.alignment import Alignment, Views, align, evidence_of, views_of
from radron.agent.frames.joint import Joint, corrected
from radron.agent.frames.keyframe import SPEED_MPS, Keyframe
from radron.agent.frames.placement import Placement
from radron.agent.frames.residuals import Fixes, Ints, Sightings, turned
from radron.agent.frames.slides import place_anew
from radron.agent.geometry import Array

_MOST_VIEWS = 120  # most sightings used in an alignment; of more, every n-th
_FEWEST_VIEWS = 4
_SHARE = 0.35  # share of the sightings that an alignment must explain: half of the observers may be faulty
_WIDE = np.array([1e4, 1e4, 1e4, math.pi**2])  # m^2, rad^2: an uninformative prior
_OUTSIDE = 16.3  # chi-square of three degrees of freedom, exceeded by one in a thousand


@dataclass(frozen=True, slots=True)
class Found:
    """The pose found for a drone, with the sightings (relative observations) and satellite positions from which it was found."""

    alignment: Alignment
    seen: Sightings
    fixes: Fixes


def find(keyframe: Keyframe, drone: int, conflicting: set[int]) -> None:
    """Find the pose of a drone whose frame is unknown by the sightings since the loss, and add it to the estimate if it is
    certain.

    ``conflicting``: drones whose sightings contradict each other.
    """
    member = keyframe.members[drone]
    first = max(member.since, keyframe.index - keyframe.setting.window)
    found = _found(keyframe, drone, first, conflicting)
    keyframe.members[drone] = replace(keyframe.members[drone], attempted=keyframe.index)
    if found is None:
        return
    insert(keyframe, drone, found)
    if member.lost_ns is not None:
        keyframe.emit(drone, member.lost_ns, keyframe.placement(drone))
    keyframe.members[drone] = replace(keyframe.members[drone], sound_ns=keyframe.stamp_ns, lost_ns=None)


def aligned_better(keyframe: Keyframe, drone: int, first: int) -> Found | None:
    """Return a drone's pose by other drones' sightings of it since keyframe (time of a frame estimate) ``first``; None unless
    they clearly contradict the present pose.
    """
    others = keyframe.joint.without(drone)
    found = _aligned(keyframe, drone, others, first, use_own_data=False)
    if found is None:
        return None
    row = int(np.searchsorted(keyframe.joint.drones, drone))
    present = evidence_of(_views(keyframe, drone, others, found.seen, found.fixes), keyframe.joint.pose[row])
    return found if found.alignment.evidence - present >= keyframe.config.lead else None


def insert(keyframe: Keyframe, drone: int, found: Found) -> None:
    """Add a found pose to the joint estimate by the measurements behind it, so that its correlations with the other poses are
    kept.
    """
    alignment, seen, fixes = found.alignment, found.seen, found.fixes
    wide = keyframe.joint.with_drone(drone, alignment.pose, np.diag(_WIDE))
    doubt = keyframe.joint.with_drone(drone, alignment.pose, alignment.covariance).covariance
    result = corrected(wide, seen, keyframe.older_var(seen), fixes, doubt=doubt)
    # Drift since then is common to all older sightings.
    age_s = float(np.mean(1e-9 * (keyframe.stamp_ns - seen.stamp_ns))) if len(seen) else 0.0
    drifted = keyframe.drift.over(drone, age_s, age_s * SPEED_MPS)
    keyframe.joint = result.joint.widened(drone, drifted)
    place_anew(keyframe, [drone])
    if len(fixes) and result.fixes[0] < 0.5 and keyframe.members[drone].trusted and len(seen):  # the first fix is the layout
        place = ", ".join(f"{axis:.0f}" for axis in keyframe.drift.layout(drone)[0])
        keyframe.suspect(drone, f"it was not launched where the mission has it ({place})", lasting=True)


def _found(keyframe: Keyframe, drone: int, first: int, conflicting: set[int]) -> Found | None:
    """The pose from drones that agree with each other. Of two contradicting drones, only the drone with sightings consistent with
    the aligned drone's launch position in the mission file is used.
    """
    trusted = keyframe.members[drone].trusted
    sides = sorted(conflicting & set(keyframe.joint.drones.tolist()))
    if not sides or not trusted:
        return _aligned(keyframe, drone, keyframe.joint, first, use_own_data=trusted)
    fitting = []
    for side in sides:
        others = keyframe.joint
        for other in sides:
            others = others if other == side else others.without(other)
        found = _aligned(keyframe, drone, others, first, use_own_data=True)
        if found is not None and _fits_layout(keyframe, drone, found.alignment):
            fitting.append(found)
    return fitting[0] if len(fitting) == 1 else None


def _fits_layout(keyframe: Keyframe, drone: int, alignment: Alignment) -> bool:
    """Whether a pose is consistent with the layout of the drone's frame."""
    layout = _layout_as_fix(keyframe, drone)
    placement = Placement(alignment.pose, alignment.covariance, keyframe.joint.at[drone])
    pose, covariance = placement.carried(layout.at[0])
    var = layout.var[0] + covariance.diagonal()[:3] + keyframe.joint.covariance.diagonal().reshape(-1, 4)[:, :3].max(0)
    return bool(((pose[:3] - layout.place[0]) ** 2 / var).sum() < _OUTSIDE)


def _aligned(keyframe: Keyframe, drone: int, others: Joint, first: int, use_own_data: bool) -> Found | None:
    """A drone's pose by sightings between it and ``others`` since keyframe ``first``, and by its own data (layout, fixes) if
    trusted; None while the solution is ambiguous.
    """
    slots, config = others.slots(), keyframe.config
    seen = keyframe.intake.sightings(first, keyframe.index)
    of_it = (seen.observer == drone) & (slots[seen.target] >= 0) | (seen.target == drone) & (slots[seen.observer] >= 0)
    seen = seen.take(of_it)
    fixes = Fixes.empty()
    if use_own_data:
        fixes = keyframe.intake.fixes(first, keyframe.index)
        fixes = Fixes.joined([_layout_as_fix(keyframe, drone), fixes.take(fixes.drone == drone)])
    if len(seen) + max(len(fixes) - 1, 0) < _FEWEST_VIEWS:
        return None
    alignment = align(_views(keyframe, drone, others, seen, fixes))
    if alignment is None or alignment.lead < config.lead or alignment.share < _SHARE:
        return None
    sigma = np.sqrt(alignment.covariance.diagonal())
    if sigma[:3].max() > config.aligned_sigma_m or sigma[3] > math.radians(config.aligned_yaw_deg):
        return None
    return Found(alignment, seen, fixes)


def _views(keyframe: Keyframe, drone: int, others: Joint, seen: Sightings, fixes: Fixes) -> Views:
    """A subset of the sightings between a drone and ``others``, and fixes, expressed from the drone's side."""
    stride = -(-len(seen) // _MOST_VIEWS)
    seen = seen.take(slice(None, None, stride)) if stride > 1 else seen
    outward = seen.observer == drone
    ends = np.where(outward, seen.target, seen.observer)
    at_end = np.where(outward[:, None], seen.at_target, seen.at_observer)
    rows = others.slots()[ends]
    pose = others.pose[rows].copy()
    moved = at_end - others.at[ends]
    pose[:, :3] += turned(pose[:, 3], moved)
    diagonal = others.covariance.diagonal().reshape(-1, 4)[rows]
    place_var = diagonal[:, :3].mean(1) + 0.5 * diagonal[:, 3] * (moved[:, :2] ** 2).sum(1)
    ends_var: Array = np.stack([place_var, diagonal[:, 3]], axis=1)
    return views_of(drone, seen, pose, ends_var, others.at[drone], fixes, keyframe.older_var(seen))


def _layout_as_fix(keyframe: Keyframe, drone: int) -> Fixes:
    """The layout position of the frame's origin as a fix, with the drift of the track since then in its variance."""
    origin, variances, _ = keyframe.drift.layout(drone)
    first_ns = keyframe.intake.tracks[drone].first_ns
    assert first_ns is not None
    since = keyframe.drift.over(drone, 1e-9 * (keyframe.stamp_ns - first_ns), float(keyframe.joint.far[drone]))
    stamps: Ints = np.array([first_ns], dtype=np.int64)
    return Fixes(np.array([drone]), stamps, np.zeros((1, 3)), origin[None], (variances[:3] + since[:3])[None], np.ones(1))
