"""Frames of the other drones, as one drone applies them: as in the log, or continued until the log contains them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec import UnsetType
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.drift import Drift
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.kept import KeptFrame
from radron.agent.frames.transform import Transform
from radron.agent.localization.continuity import carried_on
from radron.agent.navigation.peers.placing import WORST_SIGMA_M
from radron.protocol.messages import Pose

_DOUBTED = np.diag([0.5 * WORST_SIGMA_M**2, 0.5 * WORST_SIGMA_M**2, 1.0, 0.01])  # of a frame that has become unknown


class TheirFrames:
    """Transforms from the local frames of the others to the mission frame."""

    def __init__(self, mission: MissionConfig, graph: FrameGraph) -> None:
        self._graph, self._drift = graph, Drift(mission)
        self._members = {member.id: member for member in mission.drones}
        self._placed: dict[str, tuple[Pose, Transform]] = {}  # the newest pose of each in a known frame, and that frame
        self._carried: dict[str, int] = {}  # epoch with a frame by continuity, or from before a restart
        self._remembered: Mapping[str, KeptFrame] = {}

    @property
    def kept(self) -> dict[str, KeptFrame]:
        """Frames of the others, for a restart of the agent in flight; without a new link, the frame stored before."""
        found = {
            name: KeptFrame.of(pose.epoch, pose.stamp_ns, self._as_told(name, pose.epoch, frame))
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
        and drifts.
        """
        self._remembered = frames

    def told(self, name: str, epoch: int) -> Transform | None:
        """Return a frame in an epoch, as in the log."""
        return self._graph.mission_from_local(name, epoch)

    def of(self, name: str, pose: Pose) -> Transform | None:
        """Return a frame at this pose, as in the log. Until the log contains it: a frame by the continuity of the motion after a
        jump, and the stored one after a restart of this agent. A frame that has become unknown gets a large covariance.
        """
        known = self.told(name, pose.epoch)
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

    def elsewhere(self, name: str, pose: Pose) -> Transform | None:
        """Return the frame of a drone's alternative position hypothesis; None without one, or if the mission does not give its
        frame: then the uncertainty follows from the log, and not from its word.

        The drone flies on by continuity; if its localisation is right, it is there. Both hypotheses are points, with no possible
        position around them. Separation is kept from each, without the position uncertainty, which includes their distance. If
        that counted as well, drones with hypotheses 8.8 m apart would hold each other off their homes. A drone with two
        hypotheses about itself keeps clear of all others as seen from both (``myself.Self.elsewhere``).
        """
        other = pose.alternative
        if isinstance(other, UnsetType) or not self._members[name].is_exact:
            return None
        return Transform(other.yaw_rad, other.translation_m)

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
