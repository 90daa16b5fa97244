"""What an agent that is restarted in flight still knows of the other drones."""

from __future__ import annotations

from math import isfinite

from msgspec import Struct
from msgspec.structs import replace

from agent.navigation.unheard.contact import Wall
from protocol.messages import Pose, Stage, Status


class LastNews(Struct, frozen=True, kw_only=True):
    """The last pose and stage of a drone that flies by them, and the line that parts it from this one; None: there is none.
    ``launch``: its last pose before it left the place of its launch, there on the ground: its home, which the mission's layout
    tells less well; None where it was not heard there.

    That line follows from how both moved when they last heard each other. A restarted agent, which has no telemetry of then,
    could not work it out again. Of one that was heard until this agent was ended, all this is up to 5 s older.
    """

    pose: Pose
    stage: Stage
    mission: str
    boot: str
    wall: Wall | None
    launch: Pose | None = None

    @classmethod
    def of(cls, pose: Pose, status: Status, wall: Wall | None, launch: Pose | None = None) -> LastNews | None:
        """None where a state file cannot hold it: after the own clock was set back to before this pose. Without a line whose
        numbers are not finite, as JSON has none.
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

    def told_before(self, latest_ns: int) -> tuple[Pose, Status]:
        """The messages, with a stamp no later than this: the own clock may have been set back since."""
        stamp_ns = min(self.pose.stamp_ns, latest_ns)
        status = Status(stamp_ns=stamp_ns, drone=self.pose.drone, mission=self.mission, boot=self.boot, stage=self.stage)
        return replace(self.pose, stamp_ns=stamp_ns), status


def _on_ground(launch: Pose) -> Pose:
    """That pose may be of the takeoff; local frames begin on the ground."""
    return replace(launch, position_m=(*launch.position_m[:2], 0.0))
