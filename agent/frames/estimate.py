"""The keyframe loop: all drones' poses are predicted, corrected, checked for consistency, and realigned where unknown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.checkpoint import Checkpoint
from radron.agent.frames.consistency import KEYFRAMES, tally, verdict
from radron.agent.frames.finding import find
from radron.agent.frames.graph import LAUNCH_EPOCH
from radron.agent.frames.intake import Intake
from radron.agent.frames.joint import NO_HEADINGS, Headings, corrected
from radron.agent.frames.judgement import clear_suspicions, judge
from radron.agent.frames.keyframe import Keyframe, Setting
from radron.agent.frames.placement import Placement
from radron.agent.frames.residuals import FIX_OUTLIER_SHARE
from radron.agent.frames.slides import find_slides, note_moves, place_anew

_RETRY = 3  # keyframes between attempts to align a lost frame
_ATTEMPTS = 2  # attempts per keyframe over all drones: one takes about 30 ms, during which the flight loop waits
_TOO_WIDE_M = 25.0  # sigma of a position beyond which it counts as unknown


class KeyframeEstimate(Protocol):
    """Interface of an estimator that computes the frames of a swarm, one keyframe (time of an estimate) after the other."""

    def step(self, before: Checkpoint, index: int) -> Checkpoint:
        """Return the state of the frame estimate after keyframe ``index``, from the state ``before`` it."""


class Estimate:
    """The estimator of the swarm's frames: it computes the state after each keyframe from the state before.

    It holds no state of its own.
    """

    def __init__(self, mission: MissionConfig, intake: Intake) -> None:
        self._setting = Setting(mission, intake)

    def step(self, before: Checkpoint, index: int) -> Checkpoint:
        """Return the state of the frame estimate after keyframe ``index``, from the state ``before`` it."""
        keyframe = Keyframe(self._setting, before, index)
        for drone in range(len(keyframe.members)):
            _launch(keyframe, drone)
        _correct(keyframe)
        find_slides(keyframe)
        judged = verdict(keyframe.tallies)
        conflicting = {drone for pair in judged.conflicts() for drone in pair}
        judge(keyframe, judged)
        for drone in _due_for_alignment(keyframe):
            find(keyframe, drone, conflicting)
        clear_suspicions(keyframe)
        _publish(keyframe)
        return keyframe.checkpoint()


FrameEstimates = Callable[[MissionConfig, Intake], KeyframeEstimate]  # as ``Estimate``


def _launch(keyframe: Keyframe, drone: int) -> None:
    """Initialise a drone's pose from the layout, if that gives its heading."""
    track, member = keyframe.intake.tracks[drone], keyframe.members[drone]
    if member.launched or track.first_ns is None or track.first_ns > keyframe.stamp_ns:
        return
    origin, variances, heading_known = keyframe.drift.layout(drone)
    at_launch = track.segments[0].epoch == LAUNCH_EPOCH
    keyframe.members[drone] = replace(member, launched=True, since=keyframe.index, trusted=at_launch)
    if not at_launch or not heading_known:
        return
    layout = Placement(np.append(origin, keyframe.drift.yaw_rad(drone)), np.diag(variances), np.zeros(3))
    pose, covariance = layout.carried(keyframe.joint.at[drone])
    if not keyframe.setting.exact[drone]:
        covariance = covariance + np.diag(keyframe.drift.over(drone, 0.0, keyframe.joint.far[drone]))
    keyframe.joint = keyframe.joint.with_drone(drone, pose, covariance)
    place_anew(keyframe, [drone])


def _correct(keyframe: Keyframe) -> None:
    """Apply the measurements since the last keyframe.

    Sightings by and of a drone count from the keyframe after its launch on. The launch falls somewhere in its keyframe interval,
    so that there may be a single sighting of each pair. While a place is uncertain by nearly the distance between two drones, a
    false sighting fits as well as a true one, and only several sightings tell them apart. Fixes that lead a track do not count:
    they and the track cannot both be right, and a moving frame would follow them. Fixes of a sliding track do not count either.
    """
    slots = keyframe.joint.slots()
    seen = keyframe.intake.sightings(keyframe.before + 1, keyframe.index)
    settled = np.array([member.launched and member.since < keyframe.index for member in keyframe.members]) & (slots >= 0)
    seen = seen.take(settled[seen.observer] & settled[seen.target])
    fixes = keyframe.fixes
    known = slots[fixes.drone] >= 0
    slides = np.array([keyframe.slides(drone) for drone in range(len(keyframe.members))])[fixes.drone]
    counted = known & (keyframe.leads_m == 0.0) & ~slides
    result = corrected(keyframe.joint, seen, keyframe.older_var(seen), fixes.take(counted), _headings(keyframe))
    prior, keyframe.joint = keyframe.joint, result.joint
    note_moves(keyframe, prior, np.isin(np.arange(len(slots)), [*seen.observer, *seen.target, *fixes.drone[counted]]))
    tallied = tally(len(keyframe.members), seen, result.sightings)
    keyframe.tallies = (*keyframe.tallies, tallied)[-KEYFRAMES:]
    believed = np.zeros(len(fixes))
    believed[counted] = result.fixes
    believed[known & slides] = result.joint.fits(fixes.take(known & slides))
    for drone, weight in zip(fixes.drone[known].tolist(), believed[known].tolist(), strict=True):
        missed = 0 if weight > 1.0 - FIX_OUTLIER_SHARE else keyframe.members[drone].missed + 1
        keyframe.members[drone] = replace(keyframe.members[drone], missed=missed)


def _due_for_alignment(keyframe: Keyframe) -> list[int]:
    """Drones due for alignment now, by the oldest last attempt."""
    known = set(keyframe.joint.drones.tolist())
    lost = [
        drone
        for drone, member in enumerate(keyframe.members)
        if member.launched and drone not in known and keyframe.index - member.attempted >= _RETRY
    ]
    return sorted(lost, key=lambda drone: keyframe.members[drone].attempted)[:_ATTEMPTS]


def _headings(keyframe: Keyframe) -> Headings:
    """Compass headings of the drones that still use them."""
    rows = []
    for drone in keyframe.joint.drones.tolist():
        var = keyframe.drift.compass_var(drone, keyframe.seconds)
        if var is not None and keyframe.members[drone].trusted and not keyframe.adrift(drone):
            rows.append((drone, keyframe.drift.yaw_rad(drone), var))
    if not rows:
        return NO_HEADINGS
    drones, yaws, variances = zip(*rows, strict=True)
    return Headings(np.array(drones), np.array(yaws), np.array(variances))


def _publish(keyframe: Keyframe) -> None:
    """Publish each frame as valid from now on."""
    told = {drone for drone, _, _ in keyframe.emissions}
    for row, drone in enumerate(keyframe.joint.drones.tolist()):
        if drone in told or keyframe.setting.exact[drone]:
            continue
        if keyframe.joint.block(row).diagonal()[:3].max() > _TOO_WIDE_M**2:
            continue
        keyframe.emit(drone, keyframe.stamp_ns, keyframe.placement(drone))
