"""The frames of the other drones as one drone flies by them: as the log tells them, or continued until it does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec.structs import replace

from agent.config.mission import MissionConfig
from agent.frames.drift import Drift
from agent.frames.graph import LAUNCH_EPOCH, FrameGraph
from agent.frames.kept import KeptFrame
from agent.frames.transform import Transform
from agent.localization.continuity import carried_on
from agent.navigation.peers.doubted import doubt_m
from agent.navigation.peers.placing import WORST_SIGMA_M, bare
from protocol.messages import Pose

_DOUBTED = np.diag([0.5 * WORST_SIGMA_M**2, 0.5 * WORST_SIGMA_M**2, 1.0, 0.01])  # of a frame that has become unknown


class TheirFrames:
    """Transforms from the local frames of the others to the mission frame."""

    def __init__(self, mission: MissionConfig, graph: FrameGraph) -> None:
        self._graph, self._drift = graph, Drift(mission)
        self._members = {member.id: member for member in mission.drones}
        self._placed: dict[str, tuple[Pose, Transform]] = {}  # the newest pose of each in a known frame, and that frame
        self._otherwise: dict[str, list[Transform]] = {}  # by which those that have jumped may be elsewhere
        self._carried: dict[str, int] = {}  # the epoch whose frame is one by continuity, or from before a restart
        self._remembered: Mapping[str, KeptFrame] = {}

    @property
    def kept(self) -> dict[str, KeptFrame]:
        """The frames of the others, for an agent that is restarted in flight; while one is not heard again, that of before."""
        found = {
            name: KeptFrame.of(
                pose.epoch, pose.stamp_ns, self._as_told(name, pose.epoch, frame), self.elsewhere(name, pose, frame)
            )
            for name, (pose, frame) in self._placed.items()
        }
        known = {name: kept for name, kept in found.items() if kept is not None}
        return {name: kept for name, kept in self._remembered.items() if name not in found} | known

    @property
    def epochs(self) -> dict[str, int]:
        """The epochs of those whose frames nobody tells, but the continuity of their motion."""
        return dict(self._carried)

    def remember(self, frames: Mapping[str, KeptFrame]) -> None:
        """Take the plausible frames stored before the agent was restarted: each holds for its epoch until the log tells it, and
        drifts. One that was in doubt is as before where else it may be.
        """
        self._remembered = frames
        for name, kept in frames.items():
            other = None if kept.otherwise is None else kept.otherwise.mission_from_local
            if other is not None:
                self._otherwise[name] = [other]

    def told(self, name: str, epoch: int) -> Transform | None:
        """Its frame in an epoch, as the log tells it."""
        return self._graph.mission_from_local(name, epoch)

    def of(self, name: str, pose: Pose) -> Transform | None:
        """Its frame at this pose; after a jump one by the continuity of its motion, after a restart of this agent the one of
        before, until the log tells it; one that has become unknown with a large covariance.
        """
        known = self.told(name, pose.epoch)
        self._note_jump(name, pose)
        if known is not None:
            self._placed[name] = pose, known
            self._carried.pop(name, None)
            return known
        last = self._placed.get(name) or self._of_before_restart(name, pose)
        if last is None:
            return None
        before, transform = last
        if before.epoch != pose.epoch:
            transform = carried_on(transform, before, pose)
            self._carried[name] = pose.epoch
        elif self._carried.get(name) == pose.epoch:
            transform = self._drift.aged(name, transform, (pose.stamp_ns - before.stamp_ns) * 1e-9, pose.position_m)
        else:
            return self._as_told(name, pose.epoch, transform)
        self._placed[name] = pose, transform
        return transform

    def elsewhere(self, name: str, pose: Pose, mission_from_theirs: Transform | None) -> Transform | None:
        """The frame by which a drone that is in doubt is elsewhere (``doubted``): the one that its jumps leave, and that explains
        the doubt of which it tells with its frame; until it has told that, its pose tells that it may be anywhere. None without a
        doubt, or where the mission does not know its frame.
        """
        launch = self.told(name, LAUNCH_EPOCH)
        if launch is None or not self._members[name].is_exact or pose.epoch == LAUNCH_EPOCH:
            return None
        otherwise = self._otherwise.get(name, [launch])
        told = (one for one in otherwise if mission_from_theirs is not None and doubt_m(pose, mission_from_theirs, one) > 0.0)
        return next(told, otherwise[0] if pose.position_sigma_m >= WORST_SIGMA_M else None)

    def _note_jump(self, name: str, pose: Pose) -> None:
        """Where its localisation jumps, the frame by which it is elsewhere stays what it is; or goes on by continuity as well, if
        the jump was announced. Nobody but itself knows that, but the doubt of which it tells shows it.
        """
        before, frame = self._placed.get(name, (pose, None))
        if before.epoch == pose.epoch or frame is None or not self._members[name].is_exact:
            return
        frame = self._as_told(name, before.epoch, frame)
        other = bare(self.elsewhere(name, before, frame) or frame)
        self._otherwise[name] = [other, carried_on(other, before, pose)]

    def _of_before_restart(self, name: str, pose: Pose) -> tuple[Pose, Transform] | None:
        """The frame stored before this agent was restarted, with a pose of then; None where the other one has jumped since."""
        kept = self._remembered.get(name)
        frame = kept.mission_from_local if kept is not None and kept.epoch == pose.epoch else None
        if kept is None or frame is None:
            return None
        self._carried[name] = pose.epoch
        return replace(pose, stamp_ns=kept.stamp_ns), frame

    def _as_told(self, name: str, epoch: int, frame: Transform) -> Transform:
        """The frame in which one was placed last, as the log tells it now; where the log tells it no more, with great doubt."""
        known = self.told(name, epoch)
        if known is None and self._carried.get(name) != epoch:
            return Transform(frame.yaw_rad, frame.translation, _DOUBTED)
        return known or frame
