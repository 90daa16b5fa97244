"""The reference for the tracker and the heading in each stage, in the drone's own local frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import atan2, cos, hypot, sin

import numpy as np
from msgspec import Struct

from agent.config.drone import DroneConfig
from agent.config.mission import MissionConfig
from agent.fusion.estimator import Hypothesis
from agent.geometry import Array, Point2, Vector3
from agent.localization.ownpose import LocalFrame, OwnPose
from agent.motion.braking import comes_to_rest
from agent.motion.encirclement import Encirclement
from agent.motion.leading import Leading
from agent.motion.orbit import Orbit, second_height_m
from agent.motion.reference import PeerState, Reference
from agent.motion.separation import DOUBT_SIGMAS, LEAST_MARGIN_M, PeerPlan, margin_m
from agent.navigation.focus import is_in_second_half
from agent.navigation.home import Home
from agent.navigation.neighbours import Neighbour
from agent.navigation.ownground import OwnGround
from agent.navigation.surveying import InformedSearch, Search
from agent.navigation.unheard.absence import Absence
from agent.navigation.unheard.agentless import CIRCLING
from agent.navigation.unheard.contact import Circle
from agent.navigation.unheard.crossing import WayHome
from agent.navigation.unheard.sharing import SharedCircle
from agent.navigation.unheard.wayaround import WayAround, hovering
from agent.vehicle.interface import VehicleState
from protocol.messages import Stage

STEP_S = 0.2  # of the tracker's horizon
HORIZON = 20
_SPEED_SHARE = 0.85  # of the limit, for the speeds of circle and source together
_ROOM_M = 3.0  # between the circle and the fence
# A drone whose frame is not known waits in place; after a while on a small circle, because ranges alone give no heading of a
# drone that does not move.
_PATIENCE_S = 5.0
_WAITING_RADIUS_M, _WAITING_MPS = 2.0, 1.0


class Moment(Struct, frozen=True):
    """The inputs of a navigation step. ``since_ns``: when the stage began; ``hypothesis``: mission frame."""

    now_ns: int
    stage: Stage
    since_ns: int
    vehicle: VehicleState
    hypothesis: Hypothesis | None

    @property
    def stage_s(self) -> float:
        """Duration of the stage so far."""
        return (self.now_ns - self.since_ns) * 1e-9


class Centre(Struct, frozen=True):
    """Position and velocity of the source now, in the local frame, as seen by this drone's localisation.

    ``in_mission``: the same in the mission frame, horizontal.
    """

    position: Vector3
    velocity: Vector3
    in_mission: tuple[Point2, Point2]


class Guidance:
    """References and headings of one drone.

    ``has_room``: the circle that is its own while others are not heard lies inside the fence, or is not flown on. One without
    room stops, as a vehicle without its agent does, of whose place the others keep clear, and will return: on its way to that
    circle it would flee those inside of it.
    """

    def __init__(
        self,
        mission: MissionConfig,
        drone: DroneConfig,
        own: OwnPose,
        ground: OwnGround,
        home: Home,
        search: Search,
        informed: InformedSearch,
    ) -> None:
        self._config = mission
        self._id = drone.id
        self._own, self._ground, self._home = own, ground, home
        self._search, self._informed = search, informed
        self._orbit = Orbit(mission.encirclement, mission.area.floor_m)
        self._second_m = second_height_m(mission)
        most_mps = _SPEED_SHARE * mission.limits.speed_mps - mission.encirclement.speed_mps
        self._leading = Leading(mission.area, most_mps, mission.encirclement.radius_m + _ROOM_M)
        self._encirclement = Encirclement(mission.encirclement, mission.limits)
        self._shared = SharedCircle(mission, drone.id)
        self._way, self._around = WayHome(mission, drone.id), WayAround(mission)
        self._absence: Absence | None = None
        self._others: Sequence[PeerPlan] = ()
        self.has_room = True
        self._yaw_rad = 0.0
        self._stays: Vector3 | None = None  # the place held, local
        self._waits: tuple[int, float, float] | None = None  # since when and where it waits for its frame, local

    @property
    def comes_down(self) -> bool:
        """Whether the drone comes down over home from the height at which it has returned; then it lands."""
        return self._way.comes_down

    @property
    def waits(self) -> bool:
        """Whether the drone waits because its frame is not known."""
        return self._waits is not None

    def begin(self) -> None:
        """Guidance begins, or begins again: any waiting is over."""
        self._waits = self._stays = None
        self._shared.begin()
        self._way.begin()

    def centre(self, moment: Moment) -> Centre | None:
        """The centre of the circle; None without a hypothesis, or while the local frame is not known."""
        hypothesis, frame = moment.hypothesis, self._own.frame
        if hypothesis is None or frame is None:
            return None
        x, y, z = hypothesis.sight_of(self._id).position.tolist()
        u, v, w = hypothesis.velocity.tolist()
        if hypothesis.evidence is not None:  # only such an estimator has a velocity
            (x, y), (u, v) = self._leading.centre(moment.now_ns, hypothesis.stamp_ns, (x, y), (u, v))
        to_local = frame.local_from_mission
        return Centre(to_local.apply_point((x, y, z)), to_local.rotate_direction((u, v, w)), ((x, y), (u, v)))

    def reference(
        self,
        moment: Moment,
        state: PeerState,
        centre: Centre | None,
        partners: Sequence[Neighbour],
        deviation_m: float = 0.0,
        absence: Absence | None = None,
        others: Sequence[PeerPlan] = (),
    ) -> Reference:
        """The reference from ``state``, the tracker's own, together with the drones that take part.

        ``deviation_m``: RMS deviation of this drone from its plans; ``absence``: of drones that are not heard any more;
        ``others``: all that fly, or may.
        """
        self._absence, self._others = absence, others
        circles = centre is not None and moment.stage is not Stage.SURVEY
        circle = self.circle(moment, centre)
        self.has_room = circle is None or self._shared.has_room(absence, circle.centre, self._fits(moment))
        if not moment.vehicle.position_trusted or (self._holds and not circles and moment.stage is not Stage.RETURN):
            return self._stay(state)
        if not self.has_room:
            return self._stay(state)
        if moment.stage is Stage.TAKEOFF:
            return self._rise(moment, state)
        self._stays, frame = None, self._own.frame
        if frame is not None:
            self._waits = None
        if moment.stage is Stage.RETURN:
            return self._return(moment, state, deviation_m)
        self._way.begin()
        if frame is None:
            return self._wait(moment, state)
        if moment.stage is Stage.SURVEY or centre is None:
            return self._survey(moment, state, partners, frame)
        return self._circle(moment, state, centre, partners, deviation_m)

    def circle(self, moment: Moment, centre: Centre | None) -> Circle | None:
        """The circle that the drone tracks on, mission frame; None where it does not track."""
        if centre is None or moment.stage not in CIRCLING:
            return None
        radius_m = self._orbit.radius_m if self._fits(moment) else self._config.encirclement.radius_m
        return Circle(*centre.in_mission, radius_m, self._config.encirclement.speed_mps)

    @property
    def _holds(self) -> bool:
        """Whether it stays where it keeps clear of drones that it does not hear."""
        return self._absence is not None and self._absence.alone and self._config.safety.alone == "hold"

    def heading(self, moment: Moment, centre: Centre | None) -> tuple[float, float]:
        """Yaw (rad) and its rate (rad/s): always turning in the survey (paper, Sec. V-A), facing the hypothesis when tracking."""
        if moment.stage in (Stage.TAKEOFF, Stage.RETURN):
            return self._yaw_rad, 0.0
        rate_rps = 0.0
        if moment.stage is Stage.SURVEY or centre is None:
            rate_rps = self._config.survey.yaw_rate_rps
            self._yaw_rad = rate_rps * moment.stage_s
        else:
            (cx, cy, _), (x, y, _) = centre.position, moment.vehicle.position_m
            self._yaw_rad = atan2(cy - y, cx - x)
        return self._yaw_rad, rate_rps

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
            searching = self._absence.missing if self._absence is not None and walls else ()  # a share is left to each
            active = sorted([self._id, *(partner.id for partner in partners), *searching])
            found = self._search.reference(active, here, HORIZON, STEP_S)
        positions, velocities = found
        level = np.zeros(HORIZON + 1)
        placed = to_local.apply(np.column_stack((positions, level)))
        moving = to_local.rotate(np.column_stack((velocities, level)))
        placed[:, 2] = self._survey_z_m(moment)
        return Reference(placed, moving, STEP_S)

    def _circle(
        self, moment: Moment, state: PeerState, centre: Centre, partners: Sequence[Neighbour], deviation_m: float
    ) -> Reference:
        """A circle around the hypothesis: with an estimator that has a posterior and the smooth law, as close as that allows.

        Otherwise the configured circle, growing while the source has to be found again.
        """
        config, hypothesis = self._config.encirclement, moment.hypothesis
        lift_m = self._shared.lift_m(self._absence)
        radius_m, height_m, doubt_m = config.radius_m, config.height_m + lift_m, 0.0
        fits = self._fits(moment)
        x, y, _ = centre.position
        far_m = hypot(state.position[0] - x, state.position[1] - y)
        ring_m, over_m = self._shared.course(self._absence, far_m, moment.vehicle.height_m, fits)
        if fits and hypothesis is not None:
            rms_m = hypothesis.sight_of(self._id).rms_m
            lost = moment.stage is Stage.REACQUIRE
            least_m = self._least_m(moment, hypothesis)
            self._orbit.update(moment.now_ns, rms_m, hypothesis.activity_bq, lost, ring_m, lift_m, least_m)
            radius_m, height_m = self._orbit.radius_m, self._orbit.height_m
            doubt_m = DOUBT_SIGMAS * max((partner.plan.sigma_m for partner in partners), default=0.0)
        elif ring_m is not None:
            radius_m = ring_m
        elif moment.stage is Stage.REACQUIRE:
            radius_m += self._config.track.widening_mps * moment.stage_s
        widest_m = max((margin_m(deviation_m, partner.plan.deviation_m) for partner in partners), default=0.0)
        doubt_m += max(0.0, widest_m - LEAST_MARGIN_M)
        if self._holds:
            return self._hover(moment, state, centre, radius_m)
        heard = {partner.id: partner.plan for partner in partners}
        stands = self._shared.stands(self._absence, centre.in_mission[0], radius_m)
        stands = stands or self._shared.is_crossed(moment.now_ns, centre.position, radius_m, self._others, heard)
        return self._encirclement.reference(
            self._ground.above_level(state, moment.vehicle),
            self._shared.places(moment.now_ns, heard, self._absence, (centre.position, centre.velocity), radius_m, stands),
            self._id,
            center=(x, y, self._ground.level_m(moment.vehicle)),
            center_velocity=centre.velocity,
            radius_m=radius_m,
            height_m=over_m or height_m,
            doubt_m=doubt_m,
            stands=stands,
        )

    def _least_m(self, moment: Moment, source: Hypothesis) -> float:
        """Height above ground for the second half of a turn, while all are heard: sides that are apart differ in height."""
        if self._second_m is None or self._absence is not None or moment.stage is not Stage.TRACK:
            return 0.0
        return self._second_m if is_in_second_half(source, self._config) else 0.0

    def circles_of_others(
        self, moment: Moment, centre: Centre | None, absence: Absence | None, ahead: Callable[[], Array]
    ) -> list[PeerPlan]:
        """Where missing drones may circle, and the middle of the circle (``SharedCircle``), while this one circles or climbs
        before it crosses: nearest to its plan ``ahead`` (K, 3).
        """
        climbs, circle = moment.stage is Stage.RETURN and self._way.climbs, self.circle(moment, centre)
        if absence is None or centre is None or (circle is None and not climbs):
            return []
        now_ns, at, way = moment.now_ns, centre.position, ahead()
        found = [] if circle is None else self._shared.middle(absence, now_ns, at, way, STEP_S, circle.radius_m)
        if not self.has_room:
            return found
        return found + self._shared.others(absence, now_ns, at, way, STEP_S, self._fits(moment), climbs=climbs)

    def _fits(self, moment: Moment) -> bool:
        """Whether the circle's radius follows the hypothesis' accuracy."""
        return (
            self._config.encirclement.law == "smooth" and moment.hypothesis is not None and moment.hypothesis.evidence is not None
        )

    def _hover(self, moment: Moment, state: PeerState, centre: Centre, radius_m: float) -> Reference:
        """On the circle, where it is nearest."""
        (x, y, _), (cx, cy, _) = state.position, centre.position
        angle = atan2(y - cy, x - cx)
        place = (cx + radius_m * cos(angle), cy + radius_m * sin(angle))
        positions = np.tile((*place, self._survey_z_m(moment)), (HORIZON + 1, 1))
        return Reference(positions, np.zeros((HORIZON + 1, 3)), STEP_S)

    def _stay(self, state: PeerState) -> Reference:
        """Stay where it comes to rest; the tracker still keeps separation.

        Not where it begins to brake: it would fly back there, by several metres, against those that come behind it.
        """
        place = self._stays = self._stays or comes_to_rest(state, self._config.limits)
        return Reference(np.tile(place, (HORIZON + 1, 1)), np.zeros((HORIZON + 1, 3)), STEP_S)

    def _rise(self, moment: Moment, state: PeerState) -> Reference:
        """Straight up to the height of the survey."""
        x, y, _ = self._stays = self._stays or state.position
        return self._level(moment, np.full(HORIZON + 2, x), np.full(HORIZON + 2, y))

    def _wait(self, moment: Moment, state: PeerState) -> Reference:
        """Stay; after a while fly a small circle through the place."""
        x, y, _ = state.position
        since_ns, x, y = self._waits = self._waits or (moment.now_ns, x, y)
        waited_s = (moment.now_ns - since_ns) * 1e-9 - _PATIENCE_S
        turned = np.maximum(0.0, waited_s + STEP_S * np.arange(HORIZON + 2.0)) * (_WAITING_MPS / _WAITING_RADIUS_M)
        over_x = x + _WAITING_RADIUS_M * (np.cos(turned) - 1.0)
        return self._level(moment, over_x, y + _WAITING_RADIUS_M * np.sin(turned))

    def _return(self, moment: Moment, state: PeerState, deviation_m: float) -> Reference:
        """Home at the survey's speed and height, around others that hover, and the homes of those that are not heard; if home is
        not known, stay.

        Above all circles as long as there are drones that are not heard: it cannot know where they are, nor they that it comes.
        """
        x, y, _ = state.position
        home = self._home.in_local or (x, y, 0.0)
        unheard, height_m = self._absence is not None, moment.vehicle.height_m
        to, over_m = self._way.course((x, y), height_m, home[:2], unheard=unheard, taken=self._home_is_taken)
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
        """Whether drones that are not heard may search around home."""
        home = self._home.in_mission
        walls = self._absence.walls.values() if self._absence is not None else ()
        return home is not None and any(wall.parts_from(home[:2]) for wall in walls)

    def _level(self, moment: Moment, x: Array, y: Array, height_m: float | None = None) -> Reference:
        """Through positions (HORIZON + 2,) one step apart, at a height above the ground; None: that of the survey."""
        z_m = self._survey_z_m(moment) if height_m is None else self._ground.level_m(moment.vehicle) + height_m
        positions = np.column_stack((x, y, np.full(HORIZON + 2, z_m)))
        return Reference(positions[:-1], np.diff(positions, axis=0) / STEP_S, STEP_S)
