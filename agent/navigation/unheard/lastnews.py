"""Knowledge about the other drones that survives a restart of the agent in flight."""

from __future__ import annotations

from math import isfinite

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.navigation.unheard.contact import Wall
from radron.protocol.messages import Pose, Stage, Status


class LastNews(Struct, frozen=True, kw_only=True):
    """Last pose and stage of a flying peer, and the separation line between it and this drone; None: no line.
    ``launch``: its last pose on the ground at its launch place: its home, more exact than the mission's layout; None if no pose
    from there is known.

    The line follows from both motions at the last contact. A restarted agent, without telemetry of that time, could not compute
    it again. For a peer with a link up to the end of the former agent, all this is up to 5 s older.
    """

    pose: Pose
    stage: Stage
    mission: str
    boot: str
    wall: Wall | None
    launch: Pose | None = None

    @classmethod
    def of(cls, pose: Pose, status: Status, wall: Wall | None, launch: Pose | None = None) -> LastNews | None:
        """Return None if a state file cannot hold the data: a pose before a backward step of the own clock. A line with numbers
        that are not finite is left out, because JSON has none.
        """
        if pose.stamp_ns < 0:
            return None
        holds = wall is not None and all(map(isfinite, (*wall.normal, wall.offset)))
        return cls(
            pose=pose,
            stage=status.stage,
            mission=status.mission,
            boot=status.boot,
            wall=wall if holds else None,
            launch=_on_ground(launch) if launch is not None and launch.stamp_ns >= 0 else None,
        )

    def moved(self, by_ns: int) -> LastNews:
        """Return the same with all stamps later by that time, never before 1970."""
        pose, launch = _moved(self.pose, by_ns), _moved(self.launch, by_ns) if self.launch is not None else None
        return replace(self, pose=pose, launch=launch)

    def told_before(self, latest_ns: int) -> tuple[Pose, Status]:
        """Return the messages, stamped no later than ``latest_ns``: the own clock may have been stepped backward since."""
        stamp_ns = min(self.pose.stamp_ns, latest_ns)
        status = Status(stamp_ns=stamp_ns, drone=self.pose.drone, mission=self.mission, boot=self.boot, stage=self.stage)
        return replace(self.pose, stamp_ns=stamp_ns), status


def _moved(pose: Pose, by_ns: int) -> Pose:
    return replace(pose, stamp_ns=max(0, pose.stamp_ns + by_ns))


def _on_ground(launch: Pose) -> Pose:
    """Return the launch pose on the ground, where local frames begin: the pose itself may belong to the takeoff."""
    return replace(launch, position_m=(*launch.position_m[:2], 0.0))
