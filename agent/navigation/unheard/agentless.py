"""Possible positions of a vehicle whose agent no longer sends setpoints (a failsafe course). The autopilot stops the vehicle, and
then follows the mission's ``safety.agent_lost``: it climbs, returns straight to the launch place and lands there; or it lands or
holds where it stopped.

The times of departure and arrival are known only within wide limits. So at each time the vehicle may be anywhere between two
points of its way. Positions are horizontal, mission frame; times in seconds since the last pose.
"""

from __future__ import annotations

from math import ceil, dist, hypot, inf

import numpy as np
from msgspec import Struct, UnsetType

from radron.agent.config.mission import MissionConfig
from radron.agent.geometry import Array, Point2, Vector3
from radron.agent.localization.continuity import ONWARD_S
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.unheard.crossing import crossing_height_m
from radron.agent.terrain.ground import Ground
from radron.protocol.messages import Pose, Stage
from radron.protocol.stages import DESCENDING, STEERED

# Autopilot without setpoints (PX4: COM_OF_LOSS_T): flies on for a second, stops, climbs (MPC_Z_V_AUTO_UP, which preflight
# checks; slower near the height), returns at 3 to 6 m/s (MPC_XY_CRUISE: 5), and descends at half a metre per second or
# more. From the last setpoint to the departure for home, PX4 takes 4.2 s for a rise of 2 m, 8.4 s for 10 m, 12 s for 20 m.
_GOES_ON_S, _STOPPED_S = 1.0, 3.5
_CLIMB_MPS, _DESCENT_MPS, _DOWN_S = 1.5, 0.5, 10.0
_SLOWEST_MPS, _FASTEST_MPS = 3.0, 6.0
# Earliest departure after a rise of more than a metre: after the stop, and a climb whose mean rate grows with the rise, up to
# 3 m/s (greatest MPC_Z_V_AUTO_UP). Earlier than all measured ones, and than the departure of a drone that its agent brings home,
# which waits in its altitude layer first (``crossing.climb_s``).
_STOPS_S, _RISE_M = 2.5, 1.0
_MEAN_CLIMB_MPS, _FASTEST_CLIMB_MPS, _CLIMB_ENDS_S = 2.2, 3.0, 1.5
_CLIMBS_MPS = 0.5  # a vehicle that rises faster climbs already
# Least and greatest stopping distance, in seconds of flight at the last velocity (``ONWARD_S`` is between them); greatest one of
# a failsafe hold.
_NEAREST_S, _FARTHEST_S, _HOLD_S = 0.5, 2.0, 2.3
_BRAKES_MPS2, _BRAKES_LATE_S = 6.0, 0.6  # stopping distance after a hold command: v^2 / 6 + 0.6 v; MPC_ACC_HOR is 3 m/s^2
_GAP_M = 6.0  # between the centres of two keep-out discs: no way leads between them
_LOWER_M = 12.0  # nearer to home than this the return may be lower than the return height (PX4: RTL_MIN_DIST, RTL_CONE_ANG)


class Stretch(Struct, frozen=True):
    """Part of a straight line on which a vehicle may be at each of K times: between ``back`` and ``front`` (K,), metres from
    ``start``. None: from ``start``, and up to ``end``.
    """

    start: Point2
    end: Point2
    back: Array | None = None
    front: Array | None = None

    def nearest(self, places: Array) -> Array:
        """Return the points (K, 2) of the stretch, one for each time, nearest to the ``places`` (K, 2) at the same times."""
        length_m = dist(self.start, self.end)
        along = np.array([self.end[0] - self.start[0], self.end[1] - self.start[1]]) / max(length_m, 1e-9)
        least, most = (0.0 if self.back is None else self.back), (length_m if self.front is None else self.front)
        place = np.clip((places - self.start) @ along, least, most)
        found: Array = np.array(self.start) + place[:, None] * along
        return found


class Course(Struct, frozen=True):
    """Failsafe course of one vehicle; times in s since the last pose, horizontal positions, mission frame.

    stop: stretch on which the vehicle comes to rest, and stays.
    leaves_s: latest time of its departure from there, or of its landing there; infinite: it holds there for good.
    way: from the stop to home; None: no return. With None, the fields below mean nothing.
    cruise_m: least height of the return, m, in the mission frame; top_m: greatest one.
    fastest_mps: greatest speed of the return.
    departs_s: earliest departure. home_from_s: earliest arrival over home. arrives_s: latest arrival over home.
    down_s: latest end of the landing at home.
    goes_on_m: least distance from the last pose to the place of rest.
    """

    stop: Stretch
    leaves_s: float
    way: tuple[Point2, Point2] | None = None
    cruise_m: float = 0.0
    top_m: float = 0.0
    fastest_mps: float = _FASTEST_MPS
    departs_s: float = 0.0
    home_from_s: float = 0.0
    arrives_s: float = inf
    down_s: float = 0.0
    goes_on_m: float = 0.0

    def stretches(self, times: Array, below_m: Array | float, above_m: Array | float = -inf) -> list[Stretch]:
        """Return the stretches on which the vehicle may be at K times: the stop, and the way home or the place over home.

        ``times``: (K,), ascending from now on. A vehicle on its way home above ``below_m``, or at ``above_m`` or lower, is left
        out: it passes over or under this drone (heights in m at each time). Empty once the vehicle must have landed.
        """
        leaves_s, is_under = self._leaves_s(float(np.max(below_m))), np.broadcast_to(above_m, times.shape) < self.top_m
        is_met = self.way is None or bool(is_under.any())
        found = [self.stops(times)] if times[0] < leaves_s and is_met else []
        if self.way is None or times[0] >= self.down_s:
            return found
        start, home = self.way
        way_m = dist(start, home)
        meets = is_under & (times >= self.departs_s) & ((self.cruise_m <= below_m) | (way_m <= _LOWER_M))
        if not meets.any():
            return [*found, Stretch(home, home)] if self.is_over_home(times, above_m) else found
        front = np.clip(self.fastest_mps * (np.minimum(times, times[meets][-1]) - self.departs_s), 0.0, way_m)
        back = np.minimum(np.clip(_SLOWEST_MPS * (times - leaves_s), 0.0, way_m), front)
        return [*found, Stretch(start, home, back, front)]

    def is_over_home(self, times: Array, above_m: Array | float = -inf) -> bool:
        """Whether the vehicle may be over its home, or in descent there, at one of these times; ``above_m``: as for
        ``stretches``.
        """
        return bool(((times >= self.home_from_s) & (np.asarray(above_m) < self.top_m)).any())

    @property
    def hovers(self) -> list[Point2]:
        """Places along the stop, for a vehicle that holds there for good; empty for a vehicle that leaves. They are so close to
        each other that no way home leads between them.
        """
        (x, y), (end_x, end_y) = self.stop.start, self.stop.end
        if self.leaves_s < inf:
            return []
        count = 1 + ceil(dist(self.stop.start, self.stop.end) / _GAP_M)
        return [(x + share * (end_x - x), y + share * (end_y - y)) for share in np.linspace(0.0, 1.0, count).tolist()]

    def is_stop(self, stretch: Stretch) -> bool:
        """Whether a stretch returned by ``stretches`` is that of the stop, and not of the way home."""
        return (stretch.start, stretch.end) == (self.stop.start, self.stop.end)

    def _leaves_s(self, below_m: float) -> float:
        """Return the latest time (s) at which the vehicle may still be at its stop, not higher than ``below_m``.

        It climbs there before its return, and is out of the way above ``below_m``. The end of the whole climb would be too late:
        until then, a drone in descent below it would wait low beside its own home, close to circling drones, which keep clear
        of the home alone.
        """
        return max(_STOPPED_S, self.leaves_s - max(0.0, self.cruise_m - below_m) / _CLIMB_MPS) if self.way else self.leaves_s

    def stops(self, times: Array) -> Stretch:
        """Return the stretch on which the vehicle may come to rest, at ``times`` as in ``stretches``.

        In the first second the rear end of the stretch moves on by ``goes_on_m``, because the vehicle surely flies that far. So
        a drone behind it brakes instead of flying around it.
        """
        start, end = self.stop.start, self.stop.end
        back = self.goes_on_m * np.clip(times / _GOES_ON_S, 0.0, 1.0)
        return Stretch(start, end, back, np.full(len(times), dist(start, end)))


class Agentless:
    """Failsafe courses of the vehicles of a mission, by its launch layout, return heights and ``safety.agent_lost``."""

    def __init__(self, mission: MissionConfig) -> None:
        self._agent_lost = mission.safety.agent_lost
        self._launch: dict[str, Vector3] = {member.id: member.origin_m for member in mission.drones}
        self._homeless = {member.id for member in mission.drones if member.localization == "slam"}
        self._return_m = {member.id: height for member, height in zip(mission.drones, mission.return_heights_m, strict=True)}
        self._layer_m = {member.id: crossing_height_m(mission, member.id) for member in mission.drones}
        self._ground = Ground.from_config(mission)
        self._highest_ground_m = self._ground.highest_m(mission.area)
        self._corners = mission.area.polygon_m
        self._climb_mps = mission.limits.climb_mps
        self._returns_mps = max(mission.survey.speed_mps, _FASTEST_MPS)
        self._fastest_mps = max(mission.limits.speed_mps, self._returns_mps)

    def course(self, name: str, moves: PeerState, stage: Stage, home: Vector3, *, steered: bool = False) -> Course:
        """Return the failsafe course of a vehicle from the loss of its agent on.

        ``moves``: its position and velocity then, mission frame; ``stage``: of its agent then; ``home``: destination of a return;
        ``steered``: its last pose says that its agent steered it.
        """
        (_, _, z), (u, v, _) = moves.position, moves.velocity
        reaction = self._reaction(name, stage)
        goes_on_m = _NEAREST_S * hypot(u, v) if steered and stage in STEERED else 0.0
        if reaction == "hold":
            return Course(_stop(moves, _HOLD_S if self._without_agent(name) == "hold" else _FARTHEST_S), inf, goes_on_m=goes_on_m)
        if reaction == "land":
            return Course(_stop(moves), _STOPPED_S + _DOWN_S + max(z, 0.0) / _DESCENT_MPS, goes_on_m=goes_on_m)
        return self.return_of(name, moves, home, goes_on_m, steered=steered)

    @staticmethod
    def blind_hold(moves: PeerState) -> Course:
        """Return the course of a vehicle whose agent has no telemetry, and therefore commands a hold. The vehicle flies on until
        the agent notices, brakes straight ahead, and holds for good. ``moves``: at the last pose, mission frame.
        """
        (x, y, _), (u, v, _) = moves.position, moves.velocity
        ahead_s = _GOES_ON_S + hypot(u, v) / _BRAKES_MPS2 + _BRAKES_LATE_S
        return Course(Stretch((x, y), (x + ahead_s * u, y + ahead_s * v)), inf)

    def return_of(self, name: str, moves: PeerState, home: Vector3, goes_on_m: float = 0.0, *, steered: bool = False) -> Course:
        """Return the course of a vehicle that returns: it stops, climbs on the spot, flies across to home and lands.

        The autopilot flies it, or the agent if the autopilot has no home. ``moves``: position and velocity at the start, mission
        frame; ``goes_on_m``: as in ``Course``; ``steered``: by its agent at the start. Otherwise it may have stopped already.
        """
        (x, y, z), (u, v, up_mps) = moves.position, moves.velocity
        home_x, home_y, home_z = home
        cruise_m = max(z, home_z + self._return_m[name])
        leaves_s = _STOPPED_S + (cruise_m - z) / _CLIMB_MPS
        way = (x + ONWARD_S * u, y + ONWARD_S * v), (home_x, home_y)
        rises = dist(*way) > _LOWER_M and cruise_m - z > _RISE_M
        stops_s = _STOPS_S if steered and up_mps <= _CLIMBS_MPS else 0.0
        departs_s = stops_s + self._least_climb_s(cruise_m - z) if rises else _GOES_ON_S
        home_from_s = departs_s + dist(*way) / self._fastest_mps
        arrives_s = leaves_s + dist(*way) / _SLOWEST_MPS
        down_s = arrives_s + (cruise_m - home_z) / _DESCENT_MPS + _DOWN_S
        return Course(
            stop=_stop(moves),
            leaves_s=leaves_s,
            way=way,
            cruise_m=cruise_m,
            top_m=max(cruise_m, self._highest_m(name, home)),
            fastest_mps=self._returns_mps,
            departs_s=departs_s,
            home_from_s=home_from_s,
            arrives_s=arrives_s,
            down_s=down_s,
            goes_on_m=goes_on_m,
        )

    def _least_climb_s(self, rise_m: float) -> float:
        """Return the least time (s) of a climb, by the autopilot or the agent, after the stop."""
        mean_mps, fastest_mps = max(_MEAN_CLIMB_MPS, self._climb_mps), max(_FASTEST_CLIMB_MPS, self._climb_mps)
        return min(rise_m / mean_mps, _CLIMB_ENDS_S + rise_m / fastest_mps)

    def _highest_m(self, name: str, home: Vector3) -> float:
        """Return the greatest height (m, mission frame) of a return by the agent: its altitude layer above the ground below."""
        x, y, z = home
        return z + self._layer_m[name] + max(0.0, self._highest_ground_m - self._ground.height_m(x, y))

    def longest_s(self, name: str) -> float:
        """Return the longest time (s) from the start of an unhindered return, anywhere in the area, to its landing."""
        home_x, home_y, _ = self._launch[name]
        way_m, cruise_m = max(dist(corner, (home_x, home_y)) for corner in self._corners), self._return_m[name]
        return _STOPPED_S + cruise_m / _CLIMB_MPS + way_m / _SLOWEST_MPS + cruise_m / _DESCENT_MPS + _DOWN_S

    def _reaction(self, name: str, stage: Stage) -> str:
        """Return what the autopilot does without its agent: "land", "hold" or "return". A vehicle that its agent does not steer
        at this stage continues its landing or its hold.
        """
        if stage in DESCENDING:
            return "land"
        if stage not in STEERED:
            return "hold"
        return self._without_agent(name)

    def _without_agent(self, name: str) -> str:
        """Return what the autopilot of this drone does if setpoints stop: it cannot return without a home."""
        return "hold" if name in self._homeless else self._agent_lost

    def has_home(self, name: str) -> bool:
        """Whether the autopilot of a drone can return by itself; not with SLAM, whose local frame has an arbitrary origin."""
        return name not in self._homeless

    def launch(self, name: str) -> Vector3:
        """Launch place (m) by the mission's layout, mission frame."""
        return self._launch[name]

    def home(self, name: str, pose: Pose) -> Vector3:
        """Destination of a return, mission frame: as the drone published it with its ``pose``, else its launch place by the
        mission's layout.
        """
        return self._launch[name] if isinstance(pose.home_m, UnsetType) else pose.home_m


def _stop(moves: PeerState, farthest_s: float = _FARTHEST_S) -> Stretch:
    """Return the stretch on which a vehicle with this motion may come to rest: up to ``farthest_s`` of its velocity ahead."""
    (x, y, _), (u, v, _) = moves.position, moves.velocity
    return Stretch((x, y), (x + farthest_s * u, y + farthest_s * v))
