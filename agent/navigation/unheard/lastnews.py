"""Last data of the other drones, stored so that an agent restarted in flight still has them."""

from __future__ import annotations

from math import isfinite

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.navigation.unheard.contact import Wall
from radron.protocol.messages import Pose


class LastNews(Struct, frozen=True, kw_only=True):
    """Last pose of a flying drone, and the separation line between it and this drone (None: no line).

    The line is stored because it follows from both motions at the last contact, and a restarted agent has no telemetry of that
    time. The data may be up to 5 s older than the end of the former agent.
    """

    pose: Pose
    wall: Wall | None

    @classmethod
    def of(cls, pose: Pose, wall: Wall | None) -> LastNews | None:
        """Return the data to store. None if the pose is stamped before 1970, by a wrong clock, which a state file cannot hold. A
        line with numbers that are not finite is left out, because JSON has none.
        """
        if pose.stamp_ns < 0:
            return None
        holds = wall is not None and all(map(isfinite, (*wall.normal, wall.offset)))
        return cls(pose=pose, wall=wall if holds else None)

    def moved(self, by_ns: int) -> LastNews:
        """Return these data with the stamp of the pose moved by ``by_ns``, but not to before 1970."""
        return replace(self, pose=replace(self.pose, stamp_ns=max(0, self.pose.stamp_ns + by_ns)))

    def pose_before(self, latest_ns: int) -> Pose:
        """Return the pose with a stamp of at most ``latest_ns``, because the own clock may have been stepped backward since."""
        return replace(self.pose, stamp_ns=min(self.pose.stamp_ns, latest_ns))
