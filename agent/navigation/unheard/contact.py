"""When two drones last heard each other, and the line half-way between them that follows from it. Horizontal, mission frame."""

from __future__ import annotations

from math import hypot

from msgspec import Struct

from agent.frames.transform import Transform
from agent.geometry import Point2
from agent.motion.reference import PeerState
from agent.navigation.unheard.agentless import Course
from protocol.messages import Pose, Stage

SILENT_NS = 1_000_000_000  # without a pose: ten of their periods
# So near to the circle, and so near to the velocity of those that fly along it or stand on it, a drone is on it, and no longer on
# its way there. With a velocity that differs by so much it is half a metre from its place on it (``agent.motion.encirclement``).
# Two that crossed the circle at 4 and 6 m/s, against its turn, were taken to circle, and met on their ways to two others: 1.4 m.
ON_M, _ON_MPS = 3.0, 1.5
_NOTICES_S = SILENT_NS * 1e-9


class Wall(Struct, frozen=True):
    """The line half-way between this drone and a silent one; this drone keeps to where ``normal . p`` is at least ``offset``."""

    normal: Point2
    offset: float

    def parts_from(self, place: Point2, by_m: float = 0.0) -> bool:
        """Whether a place lies beyond it, by more than that."""
        return self.normal[0] * place[0] + self.normal[1] * place[1] < self.offset - by_m


class Circle(Struct, frozen=True):
    """The circle that a drone tracks on, counter-clockwise at ``speed_mps`` around a centre with that velocity; mission frame."""

    centre: Point2
    velocity: Point2
    radius_m: float
    speed_mps: float

    def has(self, one: PeerState) -> bool:
        """Whether one that is there has arrived on it: it is near, and flies along it, stands on it, or something in between."""
        dx, dy = one.position[0] - self.centre[0], one.position[1] - self.centre[1]
        u, v = one.velocity[0] - self.velocity[0], one.velocity[1] - self.velocity[1]
        far_m = max(hypot(dx, dy), 1e-6)
        outward_mps, along_mps = (dx * u + dy * v) / far_m, (dx * v - dy * u) / far_m
        beside_mps = along_mps - min(max(along_mps, 0.0), self.speed_mps)
        return abs(far_m - self.radius_m) < ON_M and hypot(outward_mps, beside_mps) < _ON_MPS


class Contact(Struct, frozen=True):
    """When two drones last heard each other: the earlier of both directions. What the other one's vehicle would have done from
    there if its agent had gone then, its stage, how it moved, whether both tracked, and whether both were on the circle.
    """

    stamp_ns: int
    course: Course
    stage: Stage
    theirs: PeerState
    tracked: bool
    circled: bool


def motion_of(pose: Pose, mission_from_theirs: Transform) -> PeerState:
    """How a drone moves by its pose, mission frame."""
    return PeerState(mission_from_theirs.apply_point(pose.position_m), mission_from_theirs.rotate_direction(pose.velocity_mps))


def wall_between(mine: PeerState, theirs: PeerState) -> Wall:
    """The line between two that moved so when they last heard each other: half-way between where they get until they notice.

    With one half-way between where they were, who flew towards it at 5 m/s came to a stop 2 m beyond it. It is across the
    direction from one to the other when they last heard each other, as they may have passed each other when they notice.
    """
    (x, y, _), (u, v, _) = mine.position, mine.velocity
    (other_x, other_y, _), (other_u, other_v, _) = theirs.position, theirs.velocity
    dx, dy = x - other_x, y - other_y
    apart_m = max(hypot(dx, dy), 1e-6)
    normal = dx / apart_m, dy / apart_m
    middle_x, middle_y = 0.5 * (x + other_x + (u + other_u) * _NOTICES_S), 0.5 * (y + other_y + (v + other_v) * _NOTICES_S)
    return Wall(normal, normal[0] * middle_x + normal[1] * middle_y)
