"""Positions of a vehicle without its agent. The autopilot stops, and follows the mission's ``safety.agent_lost``. Either it
returns straight to the launch place, first up and then across, and lands; or it lands or holds at the stop.

The times of departure and arrival are known only within wide limits. At each time the vehicle may be anywhere between two points
of its way. Positions are horizontal, mission frame; times in seconds since the last pose.
"""

from __future__ import annotations

from math import ceil, dist, hypot, inf

import numpy as np
from msgspec import Struct, UnsetType

from radron.agent.config.mission import MissionConfig
from radron.agent.geometry import Array, Point2, Vector3
from radron.agent.localization.continuity import ONWARD_S
from radron.agent.motion.reference import PeerState
from radron.protocol.messages import Pose, Stage
from radron.protocol.stages import DESCENDING, STEERED

# Autopilot without setpoints (PX4: COM_OF_LOSS_T): flies on for a second, stops, climbs (MPC_Z_V_AUTO_UP, which preflight
# checks; slower near the height), returns at 3 to 6 m/s (MPC_XY_CRUISE: 5), and descends at half a metre per second or
# more. From the last setpoint to the departure, PX4 takes 4.2 s for a rise of 2 m, 8.4 s for 10 m, and 12 s for 20 m.
_GOES_ON_S, _STOPPED_S = 1.0, 3.5
_CLIMB_MPS, _DESCENT_MPS, _DOWN_S = 1.5, 0.5, 10.0
_SLOWEST_MPS, _FASTEST_MPS = 3.0, 6.0
# Earliest departure after a rise of more than a metre: below all three measured, and below that of a return by the agent itself,
# which waits in its altitude layer (``crossing.climb_s``).
_STOPS_S, _FASTEST_CLIMB_MPS, _RISE_M = 2.5, 2.2, 1.0
# Least and greatest stopping distance, in seconds of its velocity: about ``ONWARD_S``; greatest one of a failsafe hold.
_NEAREST_S, _FARTHEST_S, _HOLD_S = 0.5, 2.0, 2.3
_BRAKES_MPS2, _BRAKES_LATE_S = 6.0, 0.6  # stopping distance after a hold command: v^2 / 6 + 0.6 v; MPC_ACC_HOR is 3 m/s^2
_GAP_M = 6.0  # between two keep-out places (separation and more around each) that leave no way between them
_LOWER_M = 12.0  # nearer to home than this the return may be lower (PX4: RTL_MIN_DIST, RTL_CONE_ANG)


class Stretch(Struct, frozen=True):
    """Straight way of a vehicle: at the k-th time it is anywhere between ``back`` and ``front`` (K,), metres from the start;
    None: anywhere on the way.
    """

    start: Point2
    end: Point2
    back: Array | None = None
    front: Array | None = None

    def nearest(self, places: Array) -> Array:
        """Return the points (K, 2) of the stretch nearest to places (K, 2), one for each time."""
        length_m = dist(self.start, self.end)
        along = np.array([self.end[0] - self.start[0], self.end[1] - self.start[1]]) / max(length_m, 1e-9)
        least, most = (0.0 if self.back is None else self.back), (length_m if self.front is None else self.front)
        place = np.clip((places - self.start) @ along, least, most)
        found: Array = np.array(self.start) + place[:, None] * along
        return found


class Course(Struct, frozen=True):
    """Failsafe course of one vehicle: it stops somewhere on ``stop``, and stays there until ``leaves_s``; infinity: for good.
    ``way``: from the stop to home, at the height ``cruise_m``; the vehicle departs at ``departs_s`` at the earliest, is over home
    from ``home_from_s`` on at the earliest, and by ``arrives_s`` at the latest, and down by ``down_s``. None: no return.
    ``goes_on_m``: least distance along ``stop`` before the vehicle stops.
    """

    stop: Stretch
    leaves_s: float
    way: tuple[Point2, Point2] | None = None
    cruise_m: float = 0.0
    departs_s: float = 0.0
    home_from_s: float = 0.0
    arrives_s: float = inf
    down_s: float = 0.0
    goes_on_m: float = 0.0

    def stretches(self, times: Array, below_m: Array | float, above_m: Array | float = -inf) -> list[Stretch]:
        """Return the possible stretches at times (K,), ascending from now on; none once the vehicle must be down.

        ``below_m``, ``above_m``: heights at these times, above and below which a crossing vehicle is not in the way.
        """
        leaves_s, is_under = self._leaves_s(float(np.max(below_m))), np.broadcast_to(above_m, times.shape) < self.cruise_m
        is_met = self.way is None or bool(is_under.any())
        found = [self.stops(times)] if times[0] < leaves_s and is_met else []
        if self.way is None or times[0] >= self.down_s:
            return found
        start, home = self.way
        way_m = dist(start, home)
        meets = is_under & (times >= self.departs_s) & ((self.cruise_m <= below_m) | (way_m <= _LOWER_M))
        if not meets.any():
            return [*found, Stretch(home, home)] if self.is_over_home(times, above_m) else found
        front = np.clip(_FASTEST_MPS * (np.minimum(times, times[meets][-1]) - self.departs_s), 0.0, way_m)
        back = np.minimum(np.clip(_SLOWEST_MPS * (times - leaves_s), 0.0, way_m), front)
        return [*found, Stretch(start, home, back, front)]

    def is_over_home(self, times: Array, above_m: Array | float = -inf) -> bool:
        """Whether the vehicle may descend over its home at one of these times; ``above_m``: as for ``stretches``."""
        return bool(((times >= self.home_from_s) & (np.asarray(above_m) < self.cruise_m)).any())

    @property
    def hovers(self) -> list[Point2]:
        """Hover places along the stop of a vehicle that stays, too near to each other for a way between them; else none."""
        (x, y), (end_x, end_y) = self.stop.start, self.stop.end
        if self.leaves_s < inf:
            return []
        count = 1 + ceil(dist(self.stop.start, self.stop.end) / _GAP_M)
        return [(x + share * (end_x - x), y + share * (end_y - y)) for share in np.linspace(0.0, 1.0, count).tolist()]

    def is_stop(self, stretch: Stretch) -> bool:
        """Whether a stretch returned by ``stretches`` is the stop of this course."""
        return (stretch.start, stretch.end) == (self.stop.start, self.stop.end)

    def _leaves_s(self, below_m: float) -> float:
        """Return the latest departure for a return up to ``below_m``; a higher return has climbed out of the way by then.

        The departure at full height would be too late. Until then, a drone in descent below it would wait low beside its own
        home, near circling drones that keep clear of that home only.
        """
        return max(_STOPPED_S, self.leaves_s - max(0.0, self.cruise_m - below_m) / _CLIMB_MPS) if self.way else self.leaves_s

    def stops(self, times: Array) -> Stretch:
        """Return the stretch of the stop, at times as in ``stretches``. At first the vehicle flies on, and leaves its last
        position: a follower has to brake, and not to go around.
        """
        start, end = self.stop.start, self.stop.end
        back = self.goes_on_m * np.clip(times / _GOES_ON_S, 0.0, 1.0)
        return Stretch(start, end, back, np.full(len(times), dist(start, end)))


class Agentless:
    """Failsafe courses of the vehicles of a mission."""

    def __init__(self, mission: MissionConfig) -> None:
        self._agent_lost = mission.safety.agent_lost
        self._launch: dict[str, Vector3] = {member.id: member.origin_m for member in mission.drones}
        self._homeless = {member.id for member in mission.drones if member.localization == "slam"}
        self._return_m = {member.id: height for member, height in zip(mission.drones, mission.return_heights_m, strict=True)}
        self._corners = mission.area.polygon_m
        self._fastest_mps = max(mission.limits.speed_mps, _FASTEST_MPS)

    def course(self, name: str, moves: PeerState, stage: Stage, home: Vector3, *, steered: bool = False) -> Course:
        """Return the failsafe course from a position and velocity, mission frame, with the agent at that stage.

        ``steered``: by its agent until then, according to its last pose.
        """
        (_, _, z), (u, v, _) = moves.position, moves.velocity
        reaction = self._reaction(name, stage)
        goes_on_m = _NEAREST_S * hypot(u, v) if steered and stage in STEERED else 0.0
        if reaction == "hold":
            return Course(_stop(moves, _HOLD_S if self._agent_lost == "hold" else _FARTHEST_S), inf, goes_on_m=goes_on_m)
        if reaction == "land":
            return Course(_stop(moves), _STOPPED_S + _DOWN_S + max(z, 0.0) / _DESCENT_MPS, goes_on_m=goes_on_m)
        return self.return_of(name, moves, home, goes_on_m)

    @staticmethod
    def blind_hold(moves: PeerState) -> Course:
        """Return the course after a hold command of an agent without telemetry. The vehicle flies on until the agent notices, and
        then brakes straight ahead.
        """
        (x, y, _), (u, v, _) = moves.position, moves.velocity
        ahead_s = _GOES_ON_S + hypot(u, v) / _BRAKES_MPS2 + _BRAKES_LATE_S
        return Course(Stretch((x, y), (x + ahead_s * u, y + ahead_s * v)), inf)

    def return_of(self, name: str, moves: PeerState, home: Vector3, goes_on_m: float = 0.0) -> Course:
        """Return the way home, up and across: flown by the autopilot if it has a home, and otherwise by the agent."""
        (x, y, z), (u, v, _) = moves.position, moves.velocity
        home_x, home_y, home_z = home
        cruise_m = max(z, home_z + self._return_m[name])
        leaves_s = _STOPPED_S + (cruise_m - z) / _CLIMB_MPS
        way = (x + ONWARD_S * u, y + ONWARD_S * v), (home_x, home_y)
        rises = dist(*way) > _LOWER_M and cruise_m - z > _RISE_M
        departs_s = _STOPS_S + (cruise_m - z) / _FASTEST_CLIMB_MPS if rises else _GOES_ON_S
        home_from_s = departs_s + dist(*way) / self._fastest_mps
        arrives_s = leaves_s + dist(*way) / _SLOWEST_MPS
        down_s = arrives_s + (cruise_m - home_z) / _DESCENT_MPS + _DOWN_S
        return Course(_stop(moves), leaves_s, way, cruise_m, departs_s, home_from_s, arrives_s, down_s, goes_on_m)

    def longest_s(self, name: str) -> float:
        """Return the longest time to landing after an unhindered return from anywhere in the area."""
        home_x, home_y, _ = self._launch[name]
        way_m, cruise_m = max(dist(corner, (home_x, home_y)) for corner in self._corners), self._return_m[name]
        return _STOPPED_S + cruise_m / _CLIMB_MPS + way_m / _SLOWEST_MPS + cruise_m / _DESCENT_MPS + _DOWN_S

    def _reaction(self, name: str, stage: Stage) -> str:
        """Return the reaction of the autopilot to the loss of its agent; without offboard mode, its present action."""
        if stage in DESCENDING:
            return "land"
        if stage not in STEERED:
            return "hold"
        return "hold" if name in self._homeless else self._agent_lost

    def has_home(self, name: str) -> bool:
        """Whether the autopilot can return: not if the origin of its local frame is arbitrary."""
        return name not in self._homeless

    def launch(self, name: str) -> Vector3:
        """Launch place by the mission's layout."""
        return self._launch[name]

    def home(self, name: str, pose: Pose) -> Vector3:
        """Destination of a return, with or without the agent: as published, else by the mission's layout."""
        return self._launch[name] if isinstance(pose.home_m, UnsetType) else pose.home_m


def _stop(moves: PeerState, farthest_s: float = _FARTHEST_S) -> Stretch:
    """Return the stretch of the stop from a position and velocity."""
    (x, y, _), (u, v, _) = moves.position, moves.velocity
    return Stretch((x, y), (x + farthest_s * u, y + farthest_s * v))
