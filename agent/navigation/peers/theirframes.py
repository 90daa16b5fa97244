"""Frames of the other drones, as one drone applies them: as in the log, or continued until the log contains them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.drift import Drift
from radron.agent.frames.graph import LAUNCH_EPOCH, FrameGraph
from radron.agent.frames.kept import KeptFrame
from radron.agent.frames.transform import Transform
from radron.agent.localization.continuity import carried_on
from radron.agent.navigation.peers.doubted import doubt_m
from radron.agent.navigation.peers.placing import WORST_SIGMA_M, bare
from radron.protocol.messages import Pose

_DOUBTED = np.diag([0.5 * WORST_SIGMA_M**2, 0.5 * WORST_SIGMA_M**2, 1.0, 0.01])  # of a frame that has become unknown


class TheirFrames:
    """Transforms from the local frames of the others to the mission frame."""

    def __init__(self, mission: MissionConfig, graph: FrameGraph) -> None:
        self._graph, self._drift = graph, Drift(mission)
        self._members = {member.id: member for member in mission.drones}
        self._placed: dict[str, tuple[Pose, Transform]] = {}  # the newest pose of each in a known frame, and that frame
        self._otherwise: dict[str, list[Transform]] = {}  # frames of alternative position hypotheses after jumps
        self._carried: dict[str, int] = {}  # epoch with a frame by continuity, or from before a restart
        self._remembered: Mapping[str, KeptFrame] = {}

    @property
    def kept(self) -> dict[str, KeptFrame]:
        """Frames of the others, for a restart of the agent in flight; without a new link, the frame stored before."""
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
        """Epochs of drones with frames by the continuity of their motion only, not from the log."""
        return dict(self._carried)

    def remember(self, frames: Mapping[str, KeptFrame]) -> None:
        """Restore the plausible frames stored before a restart of the agent: each holds for its epoch until the log contains it,
        and drifts. Alternative position hypotheses are restored, too.
        """
        self._remembered = frames
        for name, kept in frames.items():
            other = None if kept.otherwise is None else kept.otherwise.mission_from_local
            if other is not None:
                self._otherwise[name] = [other]

    def told(self, name: str, epoch: int) -> Transform | None:
        """Return a frame in an epoch, as in the log."""
        return self._graph.mission_from_local(name, epoch)

    def of(self, name: str, pose: Pose) -> Transform | None:
        """Return a frame at this pose, as in the log. Until the log contains it: a frame by the continuity of the motion after a
        jump, and the stored one after a restart of this agent. A frame that has become unknown gets a large covariance.
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
        """Return the frame of a drone's alternative position hypothesis (``doubted``). It precedes the jumps, and explains the
        uncertainty published with the present frame. Until that is published, its pose reports an unbounded uncertainty. None
        without a second hypothesis, or if the mission does not give its frame.
        """
        launch = self.told(name, LAUNCH_EPOCH)
        if launch is None or not self._members[name].is_exact or pose.epoch == LAUNCH_EPOCH:
            return None
        otherwise = self._otherwise.get(name, [launch])
        told = (one for one in otherwise if mission_from_theirs is not None and doubt_m(pose, mission_from_theirs, one) > 0.0)
        return next(told, otherwise[0] if pose.position_sigma_m >= WORST_SIGMA_M else None)

    def _note_jump(self, name: str, pose: Pose) -> None:
        """Note a jump: the frame of the alternative hypothesis stays the same, or continues as well if the jump was announced.
        The announcement is not published, but the uncertainty published afterwards shows it.
        """
        before, frame = self._placed.get(name, (pose, None))
        if before.epoch == pose.epoch or frame is None or not self._members[name].is_exact:
            return
        frame = self._as_told(name, before.epoch, frame)
        other = bare(self.elsewhere(name, before, frame) or frame)
        self._otherwise[name] = [other, carried_on(other, before, pose)]

    def _of_before_restart(self, name: str, pose: Pose) -> tuple[Pose, Transform] | None:
        """Return the frame stored before a restart of this agent, with a pose of then; None if the peer has jumped since."""
        kept = self._remembered.get(name)
        frame = kept.mission_from_local if kept is not None and kept.epoch == pose.epoch else None
        if kept is None or frame is None:
            return None
        self._carried[name] = pose.epoch
        return replace(pose, stamp_ns=kept.stamp_ns), frame

    def _as_told(self, name: str, epoch: int, frame: Transform) -> Transform:
        """Return the frame of the last position, as in the log now; with great uncertainty if the log contains it no more."""
        known = self.told(name, epoch)
        if known is None and self._carried.get(name) != epoch:
            return Transform(frame.yaw_rad, frame.translation, _DOUBTED)
        return known or frame
