"""When two drones last heard each other, and the line half-way between them that follows from it. Horizontal, mission frame."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

from msgspec import Struct

from agent.geometry import Point2, Vector3
from agent.navigation.agentless import Course
from protocol.messages import Stage

_ON_M = 3.0  # so near to the circle a drone is on it, and no longer on its way there


class Wall(Struct, frozen=True):
    """The line half-way between this drone and a silent one; this drone keeps to where ``normal . p`` is at least ``offset``."""

    normal: Point2
    offset: float

    def parts_from(self, place: Point2) -> bool:
        """Whether a place lies beyond it."""
        return self.normal[0] * place[0] + self.normal[1] * place[1] < self.offset


class Circle(Struct, frozen=True):
    """The circle that a drone tracks on; mission frame."""

    centre: Point2
    radius_m: float

    def has(self, place: Sequence[float]) -> bool:
        """Whether a place lies on it, or so near that who is there has arrived."""
        return abs(hypot(place[0] - self.centre[0], place[1] - self.centre[1]) - self.radius_m) < _ON_M


class Contact(Struct, frozen=True):
    """When two drones last heard each other: the earlier of both directions. What the other one's vehicle would have done from
    there if its agent had gone then, its stage, and whether both were on the circle.
    """

    stamp_ns: int
    course: Course
    stage: Stage
    circled: bool

    @property
    def theirs(self) -> Point2:
        """Where the other one was."""
        return self.course.stop.start


def contact_at(stamp_ns: int, course: Course, stage: Stage, circle: Circle | None, mine: Vector3 | None) -> Contact:
    """The contact at that stamp. ``course``, ``stage``: of the other one; ``circle``, ``mine``: circle and place of this one."""
    places = (course.stop.start, mine)
    circled = circle is not None and all(place is not None and circle.has(place) for place in places)
    return Contact(stamp_ns, course, stage, circled)
