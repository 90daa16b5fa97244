"""Detection of sliding tracks: tracks moved by the sightings against most others by more than their drift.

A slowly spoofed receiver, or a lost SLAM, moves a track by little in each keyframe, within the limits of drift and sightings.
Sightings tie all frames to each other, so that all frames follow: each track is moved by a share of the slide. The accumulated
correction of each track tells them apart: steady tracks have all been corrected by the same vector.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from radron.agent.frames.consistency import Flags
from radron.agent.frames.joint import Joint
from radron.agent.frames.keyframe import Keyframe, listed
from radron.agent.geometry import Array

FEWEST = 2  # tracks with the same correction
MEMORY_S = 15.0  # time constant of a track's accumulated correction
# Squared differences in units of their variance: chi-square of two degrees of freedom, exceeded by 1 in 20 and 1 in 3000. Values
# in between are no evidence.
_ALIKE, _APART = 6.0, 16.0


def note_moves(keyframe: Keyframe, prior: Joint, observed: Flags) -> None:
    """Add each track's present correction by measurements to its accumulated correction, from which sliding tracks are found.

    keyframe: the present estimate. prior: the estimate before the correction. observed: (N,) mask of drones with sightings
    (relative observations) or satellite positions; the accumulated corrections of these drones fade with time.
    """
    kept = math.exp(-keyframe.seconds / MEMORY_S)
    moved = keyframe.joint.pose[:, :2] - prior.pose[:, :2]
    for row, drone in enumerate(prior.drones.tolist()):
        member, share = keyframe.members[drone], kept if observed[drone] else 1.0
        x, y = (share * np.array(member.moved_m) + moved[row]).tolist()
        var = share**2 * member.moved_var + float(keyframe.drifted[drone])
        keyframe.members[drone] = replace(member, moved_m=(x, y), moved_var=var)


def find_slides(keyframe: Keyframe) -> None:
    """Find drones whose tracks slide (move away slowly, by a spoofed receiver or a lost SLAM), and mark them.

    They slide against the largest group of tracks that are steady relative to each other; the wrong correction of that group is
    taken back. Of equally large groups each may be the sliding one.
    """
    drones = keyframe.joint.drones.tolist()
    for drone in drones:
        if not keyframe.slides(drone):
            keyframe.members[drone] = replace(keyframe.members[drone], slid_ns=None)
    sliding = np.array([keyframe.slides(drone) for drone in drones], dtype=np.bool_)
    judged = np.array([_is_settled(keyframe, drone) for drone in drones], dtype=np.bool_)
    off = _differences(keyframe)
    groups = _groups(keyframe, off <= _ALIKE, sliding)
    outside = [judged & ~group & (off[:, group] > _ALIKE).all(1) & (off[:, group] > _APART).any(1) for group in groups]
    if len(groups) == 1 and (outside[0] & ~sliding).any():
        _take_back(keyframe, keyframe.joint.drones[groups[0]].tolist())
    for group, apart in zip(groups, outside, strict=True):
        names = listed([keyframe.setting.names[drone] for drone in keyframe.joint.drones[group].tolist()])
        for drone in keyframe.joint.drones[apart].tolist():
            if len(groups) == 1:
                keyframe.members[drone] = replace(keyframe.members[drone], slid_ns=keyframe.stamp_ns)
                keyframe.suspect(drone, f"its track slides against {names}")
            else:
                keyframe.suspect(drone, f"its track slides against {names}, or they against it", ambiguous=True)


def place_anew(keyframe: Keyframe, drones: Iterable[int]) -> None:
    """Reset the accumulated corrections of drones' tracks, for drones whose place was found again by other means."""
    rows = keyframe.joint.slots()
    for drone in drones:
        var = float(keyframe.joint.block(int(rows[drone])).diagonal()[:2].mean())
        keyframe.members[drone] = replace(keyframe.members[drone], moved_m=(0.0, 0.0), moved_var=var)


def _is_settled(keyframe: Keyframe, drone: int) -> bool:
    """Whether a drone's frame, first from the layout, has been corrected for long, and is not exactly known."""
    seconds = 1e-9 * keyframe.intake.grid_ns * (keyframe.index - keyframe.members[drone].since)
    return seconds >= MEMORY_S and not keyframe.setting.exact[drone]


def _groups(keyframe: Keyframe, alike: Flags, sliding: Flags) -> list[Flags]:
    """The largest groups of tracks with the same correction, (n,) each; with an exact drone, if there is one."""
    among = alike & ~sliding & ~sliding[:, None]
    exact = np.array([keyframe.setting.exact[drone] for drone in keyframe.joint.drones.tolist()], dtype=np.bool_)
    if exact.any():
        among = among[among[:, exact].any(1)]
    counts = among.sum(1)
    return list(np.unique(among[counts == max(counts.max(initial=0), FEWEST)], axis=0))


def _take_back(keyframe: Keyframe, steady: list[int]) -> None:
    """Move the swarm back by the mean correction of these drones, caused by the others' slide; exact drones are never moved."""
    for drone in steady:
        keyframe.clear(drone)
    if any(keyframe.setting.exact[drone] for drone in keyframe.joint.drones.tolist()):
        return
    back = np.mean([keyframe.members[drone].moved_m for drone in steady], axis=0)
    pose = keyframe.joint.pose.copy()
    pose[:, :2] -= back
    keyframe.joint = replace(keyframe.joint, pose=pose)
    for drone in keyframe.joint.drones.tolist():
        x, y = (np.array(keyframe.members[drone].moved_m) - back).tolist()
        keyframe.members[drone] = replace(keyframe.members[drone], moved_m=(x, y))


def _differences(keyframe: Keyframe) -> Array:
    """(n, n) squared differences of two tracks' corrections, in units of the variance of their relative drift."""
    members = [keyframe.members[drone] for drone in keyframe.joint.drones.tolist()]
    moved = np.array([member.moved_m for member in members]).reshape(-1, 2)
    placed = keyframe.joint.covariance.diagonal().reshape(-1, 4)[:, :2].mean(1)
    var = np.array([member.moved_var for member in members]) + placed
    off: Array = ((moved[:, None] - moved) ** 2).sum(2) / (var[:, None] + var)
    return off
