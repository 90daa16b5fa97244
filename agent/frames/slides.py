"""Which tracks slide: those that the sightings move against most others by more than they drift.

A receiver that is spoofed slowly, or a SLAM that loses its way, moves a track by little in each keyframe, as far as drift and
sightings allow. As sightings tie all frames to each other, those of all follow: each track is moved by a share of the slide. What
each has been moved by in the last while tells them apart: those that do not slide have all been moved by the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from agent.frames.consistency import Flags
from agent.frames.joint import Joint
from agent.frames.keyframe import Keyframe

_MEMORY_S = 15.0  # time constant of what a track has been moved by
_GATE = 12.0  # of a squared innovation in units of its variance
_FEWEST = 2  # tracks that have been moved by the same


def note_moves(keyframe: Keyframe, prior: Joint) -> None:
    """Add by how much the correction of this keyframe has moved each track from ``prior``."""
    kept = math.exp(-keyframe.seconds / _MEMORY_S)
    moved = keyframe.joint.pose[:, :2] - prior.pose[:, :2]
    for row, drone in enumerate(prior.drones.tolist()):
        member = keyframe.members[drone]
        x, y = (kept * np.array(member.moved_m) + moved[row]).tolist()
        var = kept**2 * member.moved_var + float(keyframe.drifted[drone])
        keyframe.members[drone] = replace(member, moved_m=(x, y), moved_var=var)


def find_slides(keyframe: Keyframe) -> None:
    """Mark the drones whose tracks slide against the largest group of those that do not slide against each other, and take back
    what these have been moved by. Of groups that are equally large each may be the one that slides.
    """
    drones = keyframe.joint.drones
    sliding = np.array([keyframe.slides(drone) for drone in drones.tolist()], dtype=np.bool_)
    alike = _alike(keyframe)
    groups = _groups(alike, sliding)
    outside = [~group & ~alike[:, group].any(1) for group in groups]
    if len(groups) == 1 and (outside[0] & ~sliding).any():
        _take_back(keyframe, drones[groups[0]].tolist())
    for group, apart in zip(groups, outside, strict=True):
        names = ", ".join(keyframe.setting.names[drone] for drone in drones[group].tolist())
        for drone in drones[apart].tolist():
            if len(groups) == 1:
                keyframe.members[drone] = replace(keyframe.members[drone], slid_ns=keyframe.stamp_ns)
                keyframe.suspect(drone, f"its track slides against those of {names}")
            else:
                keyframe.suspect(drone, f"its track slides against those of {names}, or they against it", ambiguous=True)


def _groups(alike: Flags, sliding: Flags) -> list[Flags]:
    """Each (n,): the largest groups of tracks that have been moved by the same, of two at least."""
    among = alike & ~sliding & ~sliding[:, None]
    counts = among.sum(1)
    largest = among[counts == max(counts.max(initial=0), _FEWEST)]
    return list(np.unique(largest, axis=0))


def _take_back(keyframe: Keyframe, steady: list[int]) -> None:
    """Move the swarm back by what these drones have been moved by, as the slide of others did so; none that is exact has been."""
    pose = keyframe.joint.pose.copy()
    if not any(keyframe.setting.exact[drone] for drone in keyframe.joint.drones):
        pose[:, :2] -= np.mean([keyframe.members[drone].moved_m for drone in steady], axis=0)
    keyframe.joint = replace(keyframe.joint, pose=pose)
    place_anew(keyframe, steady)
    for drone in steady:
        suspicion = keyframe.members[drone].suspicion
        if suspicion is not None and not suspicion.lasting:
            keyframe.members[drone] = replace(keyframe.members[drone], suspicion=None)


def place_anew(keyframe: Keyframe, drones: Iterable[int]) -> None:
    """Forget by how much the tracks of these drones have been moved, as they are placed by other means."""
    rows = keyframe.joint.slots()
    for drone in drones:
        var = float(keyframe.joint.block(int(rows[drone])).diagonal()[:2].mean())
        keyframe.members[drone] = replace(keyframe.members[drone], moved_m=(0.0, 0.0), moved_var=var)


def _alike(keyframe: Keyframe) -> Flags:
    """(n, n) whether the tracks of two drones have been moved by the same, as far as they drift."""
    members = [keyframe.members[drone] for drone in keyframe.joint.drones.tolist()]
    moved = np.array([member.moved_m for member in members]).reshape(-1, 2)
    placed = keyframe.joint.covariance.diagonal().reshape(-1, 4)[:, :2].mean(1)
    var = np.array([member.moved_var for member in members]) + placed
    off = moved[:, None] - moved
    alike: Flags = (off**2).sum(2) <= _GATE * (var[:, None] + var)
    return alike
