"""Knowledge about the other drones that survives a restart of the agent in flight."""

from __future__ import annotations

from math import isfinite

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.navigation.unheard.contact import Wall
from radron.protocol.messages import Pose


class LastNews(Struct, frozen=True, kw_only=True):
    """Last pose of a flying peer, and the separation line between it and this drone; None: no line.

    The line follows from both motions at the last contact. A restarted agent, without telemetry of that time, could not compute
    it again. For a peer with a link up to the end of the former agent, all this is up to 5 s older.
    """

    pose: Pose
    wall: Wall | None

    @classmethod
    def of(cls, pose: Pose, wall: Wall | None) -> LastNews | None:
        """Return None if a state file cannot hold the data: a pose by a peer's clock before 1970. A line with numbers
        that are not finite is left out, because JSON has none.
        """
        if pose.stamp_ns < 0:
            return None
        holds = wall is not None and all(map(isfinite, (*wall.normal, wall.offset)))
        return cls(pose=pose, wall=wall if holds else None)

    def moved(self, by_ns: int) -> LastNews:
        """Return the same with the stamp later by that time, never before 1970."""
        return replace(self, pose=replace(self.pose, stamp_ns=max(0, self.pose.stamp_ns + by_ns)))

    def pose_before(self, latest_ns: int) -> Pose:
        """Return the pose, stamped no later than ``latest_ns``: the own clock may have been stepped backward since."""
        return replace(self.pose, stamp_ns=min(self.pose.stamp_ns, latest_ns))
