"""Reference path for the tracker, and heading, of one drone in each stage; in its own local frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import atan2, cos, sin

import numpy as np

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.geometry import Array, Vector3
from radron.agent.localization.ownpose import LocalFrame, OwnPose
from radron.agent.motion.braking import comes_to_rest
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.circling import Circling
from radron.agent.navigation.home import Home
from radron.agent.navigation.mapping import Lanes
from radron.agent.navigation.moment import HORIZON, STEP_S, Centre, Moment
from radron.agent.navigation.neighbours import Neighbour
from radron.agent.navigation.ownground import OwnGround
from radron.agent.navigation.peers.bearings import freest_bearing
from radron.agent.navigation.surveying import InformedSearch
from radron.agent.navigation.unheard.absence import Absence
from radron.agent.navigation.unheard.contact import Circle
from radron.agent.navigation.unheard.crossing import WayHome, climb_s, crossing_height_m
from radron.agent.navigation.unheard.lines import KEPT_M
from radron.agent.navigation.unheard.wayaround import WayAround, hovering
from radron.protocol.messages import Stage
from radron.protocol.stages import BRAKING

# A drone with an unknown frame waits in place, and after a while on a small circle. Reason: from ranges alone, the heading of its
# frame can be found only if the drone moves. The circle begins in the direction away from the drones that it sees, so that two
# such drones do not fly towards each other.
_PATIENCE_S = 5.0
_WAITING_RADIUS_M, _WAITING_MPS = 2.0, 1.0
_AT_HEIGHT_M = 1.0  # tolerance for arrival in the altitude layer


class Guidance:
    """References and headings of one drone.

    has_room: the circle of this drone while drones are missing lies inside the fence, or is not in use. Without room the drone
        stops, and then returns. The other drones expect such a stop, as of a vehicle without its agent. On its way to a circle
        partly outside of the fence, it would have to evade the drones on smaller circles.
    kept_places: missing drones whose places on the circle the last reference left free, as obstacles; local frame.
    """

    def __init__(
        self,
        mission: MissionConfig,
        drone: DroneConfig,
        own: OwnPose,
        ground: OwnGround,
        home: Home,
        search: Lanes,
        informed: InformedSearch,
    ) -> None:
        self._config = mission
        self._id = drone.id
        self._climb_ns = round(climb_s(mission, drone.id) * 1e9)
        self._own, self._ground, self._home = own, ground, home
        self._search, self._informed = search, informed
        self._circling = Circling(mission, drone.id, ground)
        self._way, self._around = WayHome(mission, drone.id), WayAround(mission)
        self._absence: Absence | None = None
        self._others: Sequence[PeerPlan] = ()
        self.has_room = True
        self.kept_places: list[PeerPlan] = []
        self._yaw_rad = 0.0
        self._stays: Vector3 | None = None  # hold position, local
        self._waits: tuple[int, float, float] | None = None  # begin and position of the wait for its frame, local
        self._freest_rad = 0.0  # direction with most room for motion then
        self._climbs_at: Vector3 | None = None  # position of the climb to the altitude layer, before a search in it, local
        self._climbs_ns: int | None = None  # stamp of the begin of that climb, or of the climb before a way home

    @property
    def comes_down(self) -> bool:
        """Whether the drone is over home in its altitude layer, and descends, or waits there to descend; then it lands."""
        return self._way.comes_down

    @property
    def waits(self) -> bool:
        """Whether the drone waits because its local frame is not known."""
        return self._waits is not None

    def begin(self) -> None:
        """Begin guidance, or begin it anew in another local frame: forget all places in the former one."""
        self._waits = self._stays = self._climbs_at = self._climbs_ns = None
        self._circling.begin()
        self._way.begin()

    def leap(self) -> None:
        """Note that the vehicle has left its plan, so that a hold is at its present stopping point."""
        self._stays = None

    def centre(self, moment: Moment) -> Centre | None:
        """Return the centre of the circle; None without a source estimate, or while the local frame is not known."""
        return self._circling.centre(moment, self._own.frame)

    def circle(self, moment: Moment, centre: Centre | None) -> Circle | None:
        """Return the present circle of this drone, mission frame; None if it does not track, or without a ``centre``."""
        return self._circling.circle(moment, centre)

    def reference(
        self,
        moment: Moment,
        state: PeerState,
        centre: Centre | None,
        partners: Sequence[Neighbour],
        deviation_m: float = 0.0,
        absence: Absence | None = None,
        others: Sequence[PeerPlan] = (),
        seen: Sequence[float] = (),
    ) -> Reference:
        """Return the reference path of this drone for the present stage.

        Args:
            moment: inputs of this step.
            state: position and velocity at which the new plan begins, local frame.
            centre: of the circle; None if not known.
            partners: drones with a two-way link that take part, and share area and circle.
            deviation_m: RMS deviation of this drone from its plans.
            absence: missing drones, and the consequences for this one; None: no drone is missing.
            others: possible positions of all drones in flight, as obstacles.
            seen: directions (rad, ascending) in which this drone sees others; needed while its frame is not known.
        """
        self._absence, self._others, self.kept_places = absence, others, []
        above, self._climbs_at = self._climbs_at, None
        begun_ns, self._climbs_ns = self._climbs_ns, None
        circles = centre is not None and moment.stage is not Stage.SURVEY
        self.has_room = self._circling.has_room(moment, centre, absence)
        if not moment.vehicle.position_trusted or moment.stage in BRAKING:  # braking by setpoints
            return self.stay(state)
        if self._holds and not circles and moment.stage is not Stage.RETURN:
            is_low = moment.stage is Stage.SURVEY and self._may_meet
            return self._hold_above(moment, state, above) if is_low else self.stay(state)
        if not self.has_room:
            return self.stay(state)
        if moment.stage is Stage.TAKEOFF:
            return self._rise(moment, state)
        self._stays, frame = None, self._own.frame
        if frame is not None:
            self._waits = None
        if moment.stage is Stage.RETURN:
            return self._return(moment, state, deviation_m, begun_ns)
        self._way.begin()
        if frame is None:
            return self._wait(moment, state, seen)
        searches = moment.stage is Stage.SURVEY or centre is None
        if searches and self._may_meet:
            return self._search_above(moment, state, partners, frame, above, begun_ns)
        if searches or centre is None:
            return self._survey(moment, state, partners, frame)
        if self._holds:
            return self._circling.hover(moment, state, centre, absence, self._survey_z_m(moment))
        on_circle = self._circling.reference(moment, state, centre, partners, deviation_m, absence, others)
        reference, self.kept_places = on_circle
        return reference

    @property
    def _holds(self) -> bool:
        """Whether the drone has to hold because it is isolated (mission key ``safety.alone``)."""
        return self._absence is not None and self._absence.alone and self._config.safety.alone == "hold"

    @property
    def _may_meet(self) -> bool:
        """Whether missing drones may fly at unknown positions."""
        return self._absence is not None and bool(self._absence.anywhere)

    def heading(self, moment: Moment, centre: Centre | None) -> tuple[float, float]:
        """Return yaw (rad) and its rate (rad/s), local frame. The drone turns all the time in the search (paper, Sec. V-A), and
        faces the source while it tracks; in other stages the yaw stays.
        """
        if moment.stage in (Stage.TAKEOFF, Stage.RETURN, *BRAKING):
            return self._yaw_rad, 0.0
        rate_rps = 0.0
        if moment.stage is Stage.SURVEY or centre is None:
            rate_rps = self._config.survey.yaw_rate_rps
            self._yaw_rad = rate_rps * moment.stage_s
        else:
            (cx, cy, _), (x, y, _) = centre.position, moment.vehicle.position_m
            self._yaw_rad = atan2(cy - y, cx - x)
        return self._yaw_rad, rate_rps

    def _over_z_m(self, moment: Moment) -> float:
        return self._ground.level_m(moment.vehicle) + crossing_height_m(self._config, self._id)

    def _survey_z_m(self, moment: Moment) -> float:
        return self._ground.level_m(moment.vehicle) + self._config.survey.height_m

    def _survey(self, moment: Moment, state: PeerState, partners: Sequence[Neighbour], frame: LocalFrame) -> Reference:
        to_mission, to_local = frame.mission_from_local, frame.local_from_mission
        here = to_mission.apply_point(state.position)[:2]
        moves = to_mission.rotate_direction(state.velocity)[:2]
        others = [to_mission.apply_point(partner.plan.state(moment.now_ns).position)[:2] for partner in partners]
        walls = tuple(self._absence.walls.values()) if self._absence is not None else ()
        found = self._informed.reference(moment.now_ns, here, moves, others, HORIZON, STEP_S, walls, self._search.is_complete)
        if found is None:
            searching = self._absence.missing if self._absence is not None and walls else ()  # missing drones keep their shares
            active = sorted([self._id, *(partner.id for partner in partners), *searching])
            found = self._search.reference(active, here, HORIZON, STEP_S)
        positions, velocities = found
        level = np.zeros(HORIZON + 1)
        placed = to_local.apply(np.column_stack((positions, level)))
        moving = to_local.rotate(np.column_stack((velocities, level)))
        is_beyond = any(wall.parts_from(here, KEPT_M) for wall in walls)  # it may have been flown there while its agent was down
        lanes_z_m = self._ground.level_m(moment.vehicle) + self._search.height_m
        placed[:, 2] = self._over_z_m(moment) if is_beyond else lanes_z_m
        return Reference(placed, moving, STEP_S)

    def circles_of_others(
        self, moment: Moment, centre: Centre | None, absence: Absence | None, ahead: Callable[[], Array]
    ) -> list[PeerPlan]:
        """Return, as obstacles, the neighbouring circles that missing drones may fly, while this drone tracks, or climbs before
        its way home; else an empty list. ``ahead``: returns its planned positions (K, 3), local frame.
        """
        climbs = moment.stage is Stage.RETURN and self._way.climbs
        return self._circling.circles_of_others(moment, centre, absence, ahead, climbs=climbs, has_room=self.has_room)

    def stay(self, state: PeerState) -> Reference:
        """Return a hold at the point where the drone comes to rest; the tracker still keeps separation.

        A hold at the position where the braking begins would make the drone fly back by several metres, against following drones.
        """
        place = self._stays = self._stays or comes_to_rest(state, self._config.limits)
        return Reference(np.tile(place, (HORIZON + 1, 1)), np.zeros((HORIZON + 1, 3)), STEP_S)

    def _rise(self, moment: Moment, state: PeerState) -> Reference:
        """Return a vertical climb to the height of the search."""
        x, y, _ = self._stays = self._stays or state.position
        return self._level(moment, np.full(HORIZON + 2, x), np.full(HORIZON + 2, y))

    def _wait(self, moment: Moment, state: PeerState, seen: Sequence[float]) -> Reference:
        """Return a hold for a drone with an unknown frame; after 5 s a small circle through its position, which begins away from
        the drones that it sees. ``seen``: their directions (rad, ascending).
        """
        x, y, _ = state.position
        since_ns, x, y = self._waits = self._waits or (moment.now_ns, x, y)
        waited_s = (moment.now_ns - since_ns) * 1e-9 - _PATIENCE_S
        if waited_s <= 0.0:
            self._freest_rad = freest_bearing(seen)
        turned = np.maximum(0.0, waited_s + STEP_S * np.arange(HORIZON + 2.0)) * (_WAITING_MPS / _WAITING_RADIUS_M)
        turned += self._freest_rad
        over_x = x + _WAITING_RADIUS_M * (cos(self._freest_rad) - np.cos(turned))
        return self._level(moment, over_x, y + _WAITING_RADIUS_M * (sin(self._freest_rad) - np.sin(turned)))

    def _search_above(
        self,
        moment: Moment,
        state: PeerState,
        partners: Sequence[Neighbour],
        frame: LocalFrame,
        above: Vector3 | None,
        begun_ns: int | None,
    ) -> Reference:
        """Return a search in the own altitude layer, above all low flight, because missing drones may be anywhere below. First
        the drone climbs there on the spot, and waits until all drones that climb at the same time have passed its layer:
        separation may push a climbing drone sideways.

        ``above``, ``begun_ns``: place (local frame) and begin of the climb so far; None: it begins now, at the stopping point.
        """
        is_there = abs(moment.vehicle.height_m - crossing_height_m(self._config, self._id)) < _AT_HEIGHT_M
        if not self._are_climbing(moment, begun_ns) and is_there:
            found = self._survey(moment, state, partners, frame)
            found.positions[:, 2] = self._over_z_m(moment)
            return found
        return self._hold_above(moment, state, above)

    def _are_climbing(self, moment: Moment, begun_ns: int | None) -> bool:
        """Whether missing drones that began to climb at the same time as this one may still pass its altitude layer.

        ``begun_ns``: stamp of the begin of the climb so far; None: it begins now.
        """
        self._climbs_ns = moment.now_ns if begun_ns is None else begun_ns
        return moment.now_ns - self._climbs_ns < self._climb_ns

    def _hold_above(self, moment: Moment, state: PeerState, above: Vector3 | None) -> Reference:
        """Return a climb on the spot to the own altitude layer, and a hold there; arguments as of ``_search_above``."""
        x, y, _ = self._climbs_at = above or comes_to_rest(state, self._config.limits)
        still = np.ones(HORIZON + 2)
        return self._level(moment, x * still, y * still, crossing_height_m(self._config, self._id))

    def _return(self, moment: Moment, state: PeerState, deviation_m: float, begun_ns: int | None) -> Reference:
        """Return the way home, around hovering vehicles and the homes of missing drones; a hold if home is not known.

        Speed and height are those of the search. While drones are missing, the way leads through the own altitude layer, above
        all circles, because neither side knows the position of the other.
        """
        x, y, _ = state.position
        home = self._home.in_local or (x, y, 0.0)
        unheard, height_m = self._absence is not None, moment.vehicle.height_m
        rest = comes_to_rest(state, self._config.limits)[:2]
        to, over_m = self._way.course(
            (x, y),
            rest,
            height_m,
            home[:2],
            unheard=unheard,
            taken=self._home_is_taken,
            are_climbing=unheard and self._are_climbing(moment, begun_ns),
        )
        way = np.array([(x, y), to])
        if (frame := self._own.frame) is not None:
            homes = self._absence.homes if self._absence is not None else ()
            kept = (*homes, *hovering(self._others, frame.mission_from_local))
            way = self._around.local((x, y), to, frame, kept, deviation_m)
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(way, axis=0).T)))
        travelled = self._config.survey.speed_mps * STEP_S * np.arange(HORIZON + 2.0)
        return self._level(moment, np.interp(travelled, along, way[:, 0]), np.interp(travelled, along, way[:, 1]), over_m)

    @property
    def _home_is_taken(self) -> bool:
        """Whether home lies beyond a separation line, where a missing drone may search."""
        home = self._home.in_mission
        walls = self._absence.walls.values() if self._absence is not None else ()
        return home is not None and any(wall.parts_from(home[:2]) for wall in walls)

    def _level(self, moment: Moment, x: Array, y: Array, height_m: float | None = None) -> Reference:
        """Return a reference at constant height through horizontal positions (HORIZON + 2,), one step apart, local frame.

        ``height_m``: above the ground; None: the height of the search.
        """
        z_m = self._survey_z_m(moment) if height_m is None else self._ground.level_m(moment.vehicle) + height_m
        positions = np.column_stack((x, y, np.full(HORIZON + 2, z_m)))
        return Reference(positions[:-1], np.diff(positions, axis=0) / STEP_S, STEP_S)
