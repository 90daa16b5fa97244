"""Local frames of the other drones in the mission frame, as this drone uses them: by the log, or, as long as the log does not
give one, by the continuous motion of the drone over a jump of its localisation.
"""

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

_DOUBTED = np.diag([0.5 * WORST_SIGMA_M**2, 0.5 * WORST_SIGMA_M**2, 1.0, 0.01])  # covariance of a frame that the log lost again


class TheirFrames:
    """Transforms from the local frames of the other drones to the mission frame."""

    def __init__(self, mission: MissionConfig, graph: FrameGraph) -> None:
        self._graph, self._drift = graph, Drift(mission)
        self._members = {member.id: member for member in mission.drones}
        self._placed: dict[str, tuple[Pose, Transform]] = {}  # the newest pose of each in a known frame, and that frame
        self._carried: dict[str, int] = {}  # epoch of each whose frame is by continuous motion, or from before a restart
        self._remembered: Mapping[str, KeptFrame] = {}

    @property
    def kept(self) -> dict[str, KeptFrame]:
        """Frames of the other drones, to be stored for a restart of the agent in flight; of a drone not heard since the last
        restart, the frame stored before.
        """
        found = {
            name: KeptFrame.of(pose.epoch, pose.stamp_ns, self._as_told(name, pose.epoch, frame))
            for name, (pose, frame) in self._placed.items()
        }
        known = {name: kept for name, kept in found.items() if kept is not None}
        return {name: kept for name, kept in self._remembered.items() if name not in found} | known

    @property
    def epochs(self) -> dict[str, int]:
        """Epoch of each drone whose present frame follows from its continuous motion, or from before a restart of this agent, and
        not from the log; by id.
        """
        return dict(self._carried)

    def remember(self, frames: Mapping[str, KeptFrame]) -> None:
        """Restore the frames stored before a restart of this agent, already checked to be plausible. Each applies to its epoch
        until the log gives the frame; until then its uncertainty grows.
        """
        self._remembered = frames

    def told(self, name: str, epoch: int) -> Transform | None:
        """Return the frame of a drone in an epoch by the log; None if the log does not give it."""
        return self._graph.mission_from_local(name, epoch)

    def of(self, name: str, pose: Pose) -> Transform | None:
        """Return the frame of a drone at its newest pose; None if it is not known.

        It is that of the log. While the log does not give it: after a jump, the frame in which the vehicle has moved on without a
        jump; after a restart of this agent, the stored frame. If the log gave it and does so no more: the last one, with a large
        covariance.
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
        """Return the frame of a drone by its alternative position hypothesis, as its pose publishes it. None without one, or if
        the mission does not give its frame exactly: then only the log tells its position uncertainty.

        After an unannounced jump, a drone assumes that it has moved on without a jump. The alternative is that its localisation
        is right after the jump. Separation is kept from both positions, as exactly known points. The published position
        uncertainty is not added, because it includes the distance between both; with it, drones with hypotheses 8.8 m apart
        would keep each other away from their homes. A drone with two hypotheses of its own position keeps clear of the others as
        seen from both (``myself.Self.elsewhere``).
        """
        other = pose.alternative
        if isinstance(other, UnsetType) or not self._members[name].is_exact:
            return None
        return Transform(other.yaw_rad, other.translation_m)

    def _of_before_restart(self, name: str, pose: Pose) -> tuple[Pose, Transform] | None:
        """Return the frame stored before a restart of this agent, and the pose with the stamp of that time; None without one, or
        if the peer's localisation has jumped since.
        """
        kept = self._remembered.get(name)
        frame = kept.mission_from_local if kept is not None and kept.epoch == pose.epoch else None
        if kept is None or frame is None:
            return None
        self._carried[name] = pose.epoch
        return replace(pose, stamp_ns=kept.stamp_ns), frame

    def _as_told(self, name: str, epoch: int, frame: Transform) -> Transform:
        """Return the frame of an epoch by the log now; if the log gives none, ``frame``, the last one: with a large covariance if
        it was that of the log.
        """
        known = self.told(name, epoch)
        if known is None and self._carried.get(name) != epoch:
            return Transform(frame.yaw_rad, frame.translation, _DOUBTED)
        return known or frame
