"""Reference for the tracker, and heading, in each stage, in the drone's own local frame."""

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

# A drone with an unknown frame waits in place, and after a while on a small circle. Reason: ranges alone give no heading of a
# peer without own motion. With bearings alone, two such drones could circle towards each other: each begins away from the other.
_PATIENCE_S = 5.0
_WAITING_RADIUS_M, _WAITING_MPS = 2.0, 1.0
_AT_HEIGHT_M = 1.0  # tolerance for arrival in the altitude layer


class Guidance:
    """References and headings of one drone.

    ``has_room``: the own circle while links are lost lies inside the fence, or is not in use. A drone without room stops, like a
    vehicle in failsafe, and then returns. All drones keep clear of such a stop; on the way to that circle the drone would flee
    from the drones inside of it. ``kept_places``: the places on the circle that the last reference left free for missing drones;
    local frame.
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
        self._climbs_at: Vector3 | None = None  # position of the climb above drones at unknown positions, local
        self._climbs_ns: int | None = None  # begin of the climb to the altitude layer, for a search in it or a way home

    @property
    def comes_down(self) -> bool:
        """Whether the drone descends over home from the height of its return; then it lands."""
        return self._way.comes_down

    @property
    def waits(self) -> bool:
        """Whether the drone waits because its frame is not known."""
        return self._waits is not None

    def begin(self) -> None:
        """Begin guidance, or begin it anew: any waiting is over."""
        self._waits = self._stays = self._climbs_at = None
        self._circling.begin()
        self._way.begin()

    def leap(self) -> None:
        """Note that the vehicle is not on its plan."""
        self._stays = None

    def centre(self, moment: Moment) -> Centre | None:
        """Centre of the circle; None without a hypothesis, or while the local frame is not known."""
        return self._circling.centre(moment, self._own.frame)

    def circle(self, moment: Moment, centre: Centre | None) -> Circle | None:
        """Circle of a tracking drone, mission frame; None outside of tracking."""
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
        """Return the reference from ``state``, the tracker's own, together with the drones that take part.

        ``deviation_m``: RMS deviation of this drone from its plans; ``absence``: consequences of missing drones;
        ``others``: all drones in the air, certain or possible; ``seen``: directions (rad) in which this drone sees others.
        """
        self._absence, self._others, self.kept_places = absence, others, []
        above, self._climbs_at = self._climbs_at, None
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
            return self._return(moment, state, deviation_m)
        self._way.begin()
        if frame is None:
            return self._wait(moment, state, seen)
        searches = moment.stage is Stage.SURVEY or centre is None
        if searches and self._may_meet:
            return self._search_above(moment, state, partners, frame, above)
        self._climbs_ns = None
        if searches or centre is None:
            return self._survey(moment, state, partners, frame)
        if self._holds:
            return self._circling.hover(moment, state, centre, absence, self._survey_z_m(moment))
        on_circle = self._circling.reference(moment, state, centre, partners, deviation_m, absence, others)
        reference, self.kept_places = on_circle
        return reference

    @property
    def _holds(self) -> bool:
        """Whether the drone, isolated, holds its position clear of lost peers."""
        return self._absence is not None and self._absence.alone and self._config.safety.alone == "hold"

    @property
    def _may_meet(self) -> bool:
        """Whether missing drones may be anywhere."""
        return self._absence is not None and bool(self._absence.anywhere)

    def heading(self, moment: Moment, centre: Centre | None) -> tuple[float, float]:
        """Yaw (rad) and its rate (rad/s): always turning in the survey (paper, Sec. V-A), facing the hypothesis when tracking."""
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
            searching = self._absence.missing if self._absence is not None and walls else ()  # each keeps a share
            active = sorted([self._id, *(partner.id for partner in partners), *searching])
            found = self._search.reference(active, here, HORIZON, STEP_S)
        positions, velocities = found
        level = np.zeros(HORIZON + 1)
        placed = to_local.apply(np.column_stack((positions, level)))
        moving = to_local.rotate(np.column_stack((velocities, level)))
        is_beyond = any(wall.parts_from(here, KEPT_M) for wall in walls)  # its vehicle flew there while its agent was down
        lanes_z_m = self._ground.level_m(moment.vehicle) + self._search.height_m
        placed[:, 2] = self._over_z_m(moment) if is_beyond else lanes_z_m
        return Reference(placed, moving, STEP_S)

    def circles_of_others(
        self, moment: Moment, centre: Centre | None, absence: Absence | None, ahead: Callable[[], Array]
    ) -> list[PeerPlan]:
        """Return the circles of missing drones, nearest to this drone's plan ``ahead`` (K, 3), while it circles or climbs before
        a crossing.
        """
        climbs = moment.stage is Stage.RETURN and self._way.climbs
        return self._circling.circles_of_others(moment, centre, absence, ahead, climbs=climbs, has_room=self.has_room)

    def stay(self, state: PeerState) -> Reference:
        """Return a hold at the stopping point; the tracker still keeps separation.

        Not at the position where the braking begins: the drone would fly back there, by several metres, against following
        traffic.
        """
        place = self._stays = self._stays or comes_to_rest(state, self._config.limits)
        return Reference(np.tile(place, (HORIZON + 1, 1)), np.zeros((HORIZON + 1, 3)), STEP_S)

    def _rise(self, moment: Moment, state: PeerState) -> Reference:
        """Return a vertical climb to the height of the survey."""
        x, y, _ = self._stays = self._stays or state.position
        return self._level(moment, np.full(HORIZON + 2, x), np.full(HORIZON + 2, y))

    def _wait(self, moment: Moment, state: PeerState, seen: Sequence[float]) -> Reference:
        """Return a hold; after a while a small circle through the position, away from visible drones."""
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
        self, moment: Moment, state: PeerState, partners: Sequence[Neighbour], frame: LocalFrame, above: Vector3 | None
    ) -> Reference:
        """Return a search in the own altitude layer, above all low flight. Drones without a separation line to this one may be
        anywhere (``Absence``), and do not hear it. First it climbs there: at ``above``, None: at its position. All drones climb
        before any search begins: separation may push climbing drones along, through the layer of an earlier search.
        """
        is_there = abs(moment.vehicle.height_m - crossing_height_m(self._config, self._id)) < _AT_HEIGHT_M
        if not self._are_climbing(moment) and is_there:
            found = self._survey(moment, state, partners, frame)
            found.positions[:, 2] = self._over_z_m(moment)
            return found
        return self._hold_above(moment, state, above)

    def _are_climbing(self, moment: Moment) -> bool:
        """Whether lost peers may climb through the layer of this drone still, if they began together with it."""
        self._climbs_ns = moment.now_ns if self._climbs_ns is None else self._climbs_ns
        return moment.now_ns - self._climbs_ns < self._climb_ns

    def _hold_above(self, moment: Moment, state: PeerState, above: Vector3 | None) -> Reference:
        """Return a hold in the altitude layer; arguments as of ``_search_above``."""
        x, y, _ = self._climbs_at = above or comes_to_rest(state, self._config.limits)
        still = np.ones(HORIZON + 2)
        return self._level(moment, x * still, y * still, crossing_height_m(self._config, self._id))

    def _return(self, moment: Moment, state: PeerState, deviation_m: float) -> Reference:
        """Return the way home at the survey's speed and height, around hovering drones and the homes of lost peers. Return a hold
        if home is not known.

        While links are lost, the way is above all circles: neither side knows the position of the other.
        """
        x, y, _ = state.position
        home = self._home.in_local or (x, y, 0.0)
        unheard, height_m = self._absence is not None, moment.vehicle.height_m
        rest = comes_to_rest(state, self._config.limits)[:2]
        if not unheard:
            self._climbs_ns = None
        to, over_m = self._way.course(
            (x, y),
            rest,
            height_m,
            home[:2],
            unheard=unheard,
            taken=self._home_is_taken,
            are_climbing=unheard and self._are_climbing(moment),
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
        """Whether missing drones may search around home."""
        home = self._home.in_mission
        walls = self._absence.walls.values() if self._absence is not None else ()
        return home is not None and any(wall.parts_from(home[:2]) for wall in walls)

    def _level(self, moment: Moment, x: Array, y: Array, height_m: float | None = None) -> Reference:
        """Return positions (HORIZON + 2,) one step apart as a reference at a height above the ground; None: survey height."""
        z_m = self._survey_z_m(moment) if height_m is None else self._ground.level_m(moment.vehicle) + height_m
        positions = np.column_stack((x, y, np.full(HORIZON + 2, z_m)))
        return Reference(positions[:-1], np.diff(positions, axis=0) / STEP_S, STEP_S)
