"""Where a drone may be that flew and is not heard any more. Separation is kept from all of it, for as long as it is possible.

Nobody can tell which of two things has happened:

- its agent is gone. Its autopilot stops, and does what the mission's ``safety.agent_lost`` says: it returns straight to the place
  of its launch, first up and then across, and lands; or it lands or stays where it has stopped.
- only the radio is. It flies on, and cannot hear this drone either. While it searched, both keep to their own side of the line
  half-way between the places where they last heard of each other; while it tracked, both leave for circles of different radius
  (``agent.motion.rings``).

How early and how late it may be on its way home is known only within wide limits: at each time it may be anywhere between two
places of that way. Positions are horizontal, mission frame.
"""

from __future__ import annotations

from collections.abc import Callable
from math import dist, hypot

import numpy as np
from msgspec import Struct

from agent.config.mission import MissionConfig
from agent.frames.transform import Transform
from agent.geometry import Array, Point2, Vector3
from agent.motion.separation import PeerPlan
from agent.navigation.peers import Peer
from protocol.messages import Pose, Stage

TAKING_PART = (Stage.TAKEOFF, Stage.SURVEY, Stage.TRACK, Stage.REACQUIRE)
CIRCLING = (Stage.TRACK, Stage.REACQUIRE)
SILENT_NS = 1_000_000_000  # without a pose: ten of their periods
APART_NS = 60_000_000_000  # drones that do not hear each other keep to their own sides for this long after their last contact
# The same for the places of a shared circle. Each side notices after a second, and moves to a circle of its own, 6 m or more from
# the next, at up to 2 m/s (``agent.motion.orbit``): by then they are 5 m apart.
LEAVING_NS = 5_000_000_000
KEPT_M = 4.5  # least distance of a waypoint from that line
_BEHIND_M = 2.0  # nearest place of the other beyond the line half-way: with margins, each stays 3.6 m from it
# An autopilot without setpoints (PX4: COM_OF_LOSS_T): it flies on for a second, stops, climbs (MPC_Z_V_AUTO_UP, which preflight
# checks, and slower near the height), goes home at 3 to 6 m/s (MPC_XY_CRUISE: 5), and comes down at half a metre per second or
# more. From the last setpoint until it leaves, PX4 takes 4.2 s for a rise of 2 m, 8.4 s for 10 m, and 12 s for 20 m.
_GOES_ON_S, _STOPPED_S = 1.0, 3.5
_CLIMB_MPS, _DESCENT_MPS, _DOWN_S = 1.5, 0.5, 10.0
_SLOWEST_MPS, _FASTEST_MPS = 3.0, 6.0
_FARTHEST_S = 1.0  # it stops between one and two of these times its velocity ahead
_SIGMA_M = 0.3  # of its way to the side


class Wall(Struct, frozen=True):
    """The line half-way between this drone and a silent one; this drone keeps to where ``normal . p`` is at least ``offset``."""

    normal: Point2
    offset: float


class Absence(Struct, frozen=True):
    """Drones of the mission that took part and are not heard any more, and what follows for this one.

    ``ring``: which of the circles apart from each other this drone and those that it hears fly on; ``kept``: whose place on the
    circle is kept; ``walls``: what this drone keeps behind, by the drone beyond; ``alone``: it hears no other drone.
    """

    missing: tuple[str, ...]
    ring: int
    kept: tuple[str, ...]
    walls: dict[str, Wall]
    alone: bool


class Viewer(Struct, frozen=True):
    """The drone that keeps clear: its frame, its planned positions (K, 3) from now on, ``step_s`` apart, local frame, and where
    it was at a stamp, mission frame. ``circles``: it tracks.
    """

    now_ns: int
    step_s: float
    local_from_mission: Transform
    ahead: Callable[[], Array]
    place_at: Callable[[int], Vector3 | None]
    circles: bool


class Silent:
    """The silent drones of a mission."""

    def __init__(self, mission: MissionConfig) -> None:
        self._safety = mission.safety
        self._index = {member.id: index for index, member in enumerate(mission.drones)}
        self._launch: dict[str, Point2] = {member.id: member.origin_m[:2] for member in mission.drones}
        self._homeless = {member.id for member in mission.drones if member.localization == "slam"}
        self._return_heights_m = mission.return_heights_m
        self._walls: dict[str, tuple[int, Wall]] = {}  # with the stamp of the last contact

    def walls(self, now_ns: int) -> dict[str, Wall]:
        """The lines to keep behind now, by the drone beyond."""
        return {name: wall for name, (stamp_ns, wall) in sorted(self._walls.items()) if 0 <= now_ns - stamp_ns < APART_NS}

    def heard(self, name: str) -> None:
        """It is heard again, or on the ground."""
        self._walls.pop(name, None)

    def plans(
        self, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform, sigma_m: float, me: Viewer
    ) -> list[PeerPlan]:
        """Where it may be along the horizon, as far as that is nearest to this drone's own plan."""
        stage = peer.status.stage if peer.status is not None else Stage.SURVEY
        silent_s = (me.now_ns - pose.stamp_ns) * 1e-9
        ahead = me.local_from_mission.inverse().apply(me.ahead())[:, :2]
        times: Array = silent_s + me.step_s * np.arange(float(len(ahead)))
        found: list[Array] = []
        x, y, z = mission_from_theirs.apply_point(pose.position_m)
        u, v, _ = mission_from_theirs.rotate_direction(pose.velocity_mps)
        first, last = (x + _GOES_ON_S * u, y + _GOES_ON_S * v), (x + 2.0 * _FARTHEST_S * u, y + 2.0 * _FARTHEST_S * v)
        wall = self._wall(name, stage, pose.stamp_ns, (x, y), me) if silent_s < APART_NS * 1e-9 else None
        gone = self._without_agent(name, stage)
        rise_m = max(0.0, self._return_heights_m[self._index[name]] - z)
        if gone == "return":
            home = self._home(name, peer, mission_from_theirs)
            found += self._way_home(((x, y), first, last), home, rise_m, max(z, z + rise_m), times, ahead)
        elif gone == "hold" or silent_s < _STOPPED_S + _DOWN_S + max(z, 0.0) / _DESCENT_MPS:
            found.append(_on_way((x, y), last, ahead))
        walls = [] if wall is None else [_beyond(name, wall, ahead, sigma_m, me)]
        return walls + [blind_plan(name, me.now_ns, me.step_s, _local(places, me), hypot(sigma_m, _SIGMA_M)) for places in found]

    def _without_agent(self, name: str, stage: Stage) -> str:
        """What its autopilot does if its agent is gone: without offboard mode, what it did before."""
        if stage in (Stage.LANDING, Stage.ABORT):
            return "land"
        if stage not in (*CIRCLING, Stage.SURVEY, Stage.RETURN):
            return "hold"
        return "hold" if name in self._homeless and self._safety.agent_lost == "return" else self._safety.agent_lost

    def _way_home(
        self,
        stop: tuple[Point2, Point2, Point2],
        home: Point2,
        rise_m: float,
        height_m: float,
        times: Array,
        ahead: Array,
    ) -> list[Array]:
        """The nearest places of where it stops, while it may still be there, and of its way home, until it must be down."""
        last_heard, first, last = stop
        leaves_s = _STOPPED_S + rise_m / _CLIMB_MPS
        middle = (0.5 * (first[0] + last[0]), 0.5 * (first[1] + last[1]))
        way_m = dist(middle, home)
        down_s = leaves_s + way_m / _SLOWEST_MPS + height_m / _DESCENT_MPS + _DOWN_S
        found = []
        if times[0] < leaves_s:
            found.append(_on_way(last_heard, last, ahead))
        if times[0] < down_s:
            front = np.clip(_FASTEST_MPS * (times - _GOES_ON_S), 0.0, way_m)
            back = np.clip(_SLOWEST_MPS * (times - leaves_s), 0.0, way_m)
            found.append(_on_way(middle, home, ahead, back, front))
        return found

    def _home(self, name: str, peer: Peer, mission_from_theirs: Transform) -> Point2:
        """Where its autopilot returns to."""
        launch, pose = peer.launch, peer.pose
        if launch is None or pose is None or launch.epoch != pose.epoch:
            return self._launch[name]
        x, y, _ = mission_from_theirs.apply_point(launch.position_m)
        return x, y

    def _wall(self, name: str, stage: Stage, stamp_ns: int, theirs: Point2, me: Viewer) -> Wall | None:
        """The line between the two of them; None where both circled already when they last heard of each other."""
        known = self._walls.get(name)
        if known is not None and known[0] == stamp_ns:
            return known[1]
        mine = me.place_at(stamp_ns)
        if mine is None or stage not in TAKING_PART or (stage in CIRCLING and me.circles):
            return None
        dx, dy = mine[0] - theirs[0], mine[1] - theirs[1]
        apart_m = max(hypot(dx, dy), 1e-6)
        normal = dx / apart_m, dy / apart_m
        middle = 0.5 * (mine[0] + theirs[0]), 0.5 * (mine[1] + theirs[1])
        wall = Wall(normal, normal[0] * middle[0] + normal[1] * middle[1])
        self._walls[name] = stamp_ns, wall
        return wall


def blind_plan(name: str, now_ns: int, step_s: float, places: Array, sigma_m: float = 0.0, away: Array | None = None) -> PeerPlan:
    """Places (K, 3) where a drone may be that does not know of this one; ``away``: (K, 2), it may be anywhere beyond these."""
    return PeerPlan(name, now_ns, step_s, list(map(tuple, places.tolist())), sigma_m, blind=True, away=away)


def _local(places: Array, me: Viewer) -> Array:
    """Places (K, 3) of places (K, 2) of the mission frame in the viewer's."""
    return me.local_from_mission.apply(np.column_stack((places, np.zeros(len(places)))))


def _beyond(name: str, wall: Wall, ahead: Array, sigma_m: float, me: Viewer) -> PeerPlan:
    """Anywhere beyond a wall."""
    normal = np.array(wall.normal)
    places = ahead - (ahead @ normal - (wall.offset - _BEHIND_M))[:, None] * normal
    u, v, _ = me.local_from_mission.rotate_direction((*wall.normal, 0.0))
    return blind_plan(name, me.now_ns, me.step_s, _local(places, me), sigma_m, away=np.tile((u, v), (len(places), 1)))


def _on_way(start: Point2, end: Point2, ahead: Array, back: Array | None = None, front: Array | None = None) -> Array:
    """The places (K, 2) of a straight way nearest to those ahead (K, 2), between ``back`` and ``front`` (K,) m from its start."""
    length_m = dist(start, end)
    along = np.array([end[0] - start[0], end[1] - start[1]]) / max(length_m, 1e-9)
    place = np.clip((ahead - start) @ along, 0.0 if back is None else back, length_m if front is None else front)
    places: Array = np.array(start) + place[:, None] * along
    return places
