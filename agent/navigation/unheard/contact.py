"""State of the link between two drones, their last contact, and the separation line by it. Horizontal, mission frame."""

from __future__ import annotations

from enum import Enum, auto
from math import hypot

from msgspec import Struct

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Point2
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.peers.newest import Peer
from radron.agent.navigation.unheard.agentless import Course
from radron.protocol.messages import Pose, Stage

SILENT_NS = 1_000_000_000  # a link is lost after this time without a pose: ten pose periods
# A peer is quiet after this time without a pose, beyond its usual delay: four poses are missing. Its agent may be lost, and then
# its vehicle stops soon. A drone that follows at 6 m/s and notices only after a second could not stop behind it any more.
QUIET_NS = 400_000_000
# A drone counts as on the circle within these tolerances: its distance from the circle, and the difference of its velocity from
# a velocity along the circle, between zero and the speed of the circle. The second one allows for half a metre of offset from
# the circle (``radron.agent.motion.encirclement``). With wider tolerances, drones that only cross the circle at 4 to 6 m/s would
# count as circling, and get no separation line.
ON_M, _ON_MPS = 3.0, 1.5
_NOTICES_S = SILENT_NS * 1e-9


class Wall(Struct, frozen=True):
    """Separation line between this drone and a missing drone, mission frame. This drone's side: ``normal . p >= offset``, with
    the unit vector ``normal`` and the offset in m.
    """

    normal: Point2
    offset: float

    def parts_from(self, place: Point2, by_m: float = 0.0) -> bool:
        """Whether a place lies on the other side of the line, farther than ``by_m`` from it."""
        return self.normal[0] * place[0] + self.normal[1] * place[1] < self.offset - by_m


class Circle(Struct, frozen=True):
    """Circle of a tracking drone around the source, mission frame: flown counter-clockwise at ``speed_mps``, with a centre that
    moves at ``velocity``.
    """

    centre: Point2
    velocity: Point2
    radius_m: float
    speed_mps: float

    def has(self, one: PeerState) -> bool:
        """Whether a drone has arrived on the circle: near it, and with a speed along it between zero and ``speed_mps``."""
        dx, dy = one.position[0] - self.centre[0], one.position[1] - self.centre[1]
        u, v = one.velocity[0] - self.velocity[0], one.velocity[1] - self.velocity[1]
        far_m = max(hypot(dx, dy), 1e-6)
        outward_mps, along_mps = (dx * u + dy * v) / far_m, (dx * v - dy * u) / far_m
        beside_mps = along_mps - min(max(along_mps, 0.0), self.speed_mps)
        return abs(far_m - self.radius_m) < ON_M and hypot(outward_mps, beside_mps) < _ON_MPS


class Contact(Struct, frozen=True):
    """Last contact with a peer whose link is lost or one-way: the last moment at which messages arrived in both directions.

    stamp_ns: own time. course: failsafe course of the peer's vehicle from then on. stage: its stage then.
    theirs: its position and velocity then, mission frame.
    tracked: both drones tracked the source then. circled: both had arrived on the circle.
    """

    stamp_ns: int
    course: Course
    stage: Stage
    theirs: PeerState
    tracked: bool
    circled: bool


class LinkState(Enum):
    """State of the link to another drone, as this drone knows it."""

    ON_GROUND = auto()
    NEVER_HEARD = auto()
    LOST = auto()
    ONE_WAY = auto()  # heard, but without reception of this drone
    TWO_WAY = auto()


def link_state(peer: Peer, listener: str, now_ns: int, *, revoked: bool) -> LinkState:
    """Return the state of the link between a peer and this drone, whose id is ``listener``. ``revoked``: this drone is revoked,
    so no peer accepts its messages.
    """
    pose = peer.pose
    if peer.is_on_ground(now_ns):
        return LinkState.ON_GROUND
    if pose is None:
        return LinkState.NEVER_HEARD
    if now_ns - pose.stamp_ns > SILENT_NS:
        return LinkState.LOST
    return LinkState.ONE_WAY if revoked or pose.silences_ns.get(listener, 0) > SILENT_NS else LinkState.TWO_WAY


def last_contact_ns(pose: Pose, listener: str) -> int:
    """Return the stamp of the last contact in both directions, by a peer's newest pose. It is the stamp of the last pose of the
    ``listener`` (this drone) that the peer had received by then, as its table of contacts reports.

    Both drones of a link derive the same stamp, up to a pose period and a message's delay, whichever direction fails first.
    """
    return pose.stamp_ns - pose.silences_ns.get(listener, 0)


def hears(pose: Pose, other: str) -> bool:
    """Whether a drone's pose reports that it has received a pose of the drone ``other`` in the last second."""
    return pose.silences_ns.get(other, SILENT_NS + 1) <= SILENT_NS


def motion_of(pose: Pose, mission_from_theirs: Transform) -> PeerState:
    """Return the position and velocity of a drone at its pose, in the mission frame."""
    return PeerState(mission_from_theirs.apply_point(pose.position_m), mission_from_theirs.rotate_direction(pose.velocity_mps))


def wall_between(mine: PeerState, theirs: PeerState) -> Wall:
    """Return the separation line of two drones. It is perpendicular to the line between their positions at the last contact, and
    half-way between their positions one second later, when both notice the loss.

    ``mine``, ``theirs``: motions at the last contact, mission frame. A line half-way between the positions at the contact would
    be too near: at 5 m/s towards it, a drone stops 2 m beyond. The direction is that at the contact, because the drones may have
    passed each other a second later.
    """
    (x, y, _), (u, v, _) = mine.position, mine.velocity
    (other_x, other_y, _), (other_u, other_v, _) = theirs.position, theirs.velocity
    dx, dy = x - other_x, y - other_y
    apart_m = max(hypot(dx, dy), 1e-6)
    normal = dx / apart_m, dy / apart_m
    middle_x, middle_y = 0.5 * (x + other_x + (u + other_u) * _NOTICES_S), 0.5 * (y + other_y + (v + other_v) * _NOTICES_S)
    return Wall(normal, normal[0] * middle_x + normal[1] * middle_y)
