"""What an agent that is restarted in flight still knows of the other drones."""

from __future__ import annotations

from math import isfinite

from msgspec import Struct

from agent.navigation.unheard.contact import Wall
from protocol.messages import Pose, Status


class LastNews(Struct, frozen=True, kw_only=True):
    """The last news of a drone that flies by them, and the line that parts it from this one if it is not heard any more; None:
    there is none.

    That line follows from how both moved when they last heard each other. A restarted agent, which has no telemetry of then,
    could not work it out again.
    """

    pose: Pose
    status: Status
    wall: Wall | None

    @classmethod
    def of(cls, pose: Pose, status: Status, wall: Wall | None) -> LastNews:
        """Without a line that a state file could not hold: JSON has no number that is not finite."""
        holds = wall is not None and all(map(isfinite, (*wall.normal, wall.offset)))
        return cls(pose=pose, status=status, wall=wall if holds else None)
