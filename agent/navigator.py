"""From what a drone knows to where it flies next: reference -> tracker -> setpoint, all in its own local frame."""

from __future__ import annotations

from math import atan2, hypot

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from shapely import Point

from agent.config import DroneConfig, MissionConfig
from agent.frames.graph import FrameGraph
from agent.fusion.estimator import Hypothesis
from agent.ground import Ground
from agent.motion.encirclement import Encirclement
from agent.motion.fence import Fence
from agent.motion.leading import Leading
from agent.motion.orbit import Orbit
from agent.motion.reference import Array, PeerState, Reference
from agent.motion.tracker import Relief, Tracker
from agent.neighbours import Neighbour, Neighbourhood, Self
from agent.ownframe import OwnFrame
from agent.peers import Peers
from agent.search import InformedSearch, Search
from agent.vehicle.interface import Setpoint, Vector3, VehicleState
from protocol.messages import Plan, Stage

REPLAN_NS = 200_000_000  # 5 Hz
STEP_S = 0.2  # of the tracker's horizon
HORIZON = 20
AT_HOME_M = 0.5
AT_HOME_MPS = 0.3
_SPEED_SHARE = 0.85  # of the limit, for the circle's speed and the source's together
_ROOM_M = 3.0  # between the circle and the fence
_DOUBT_SIGMAS = 2.0  # as in agent.motion.separation
_LEAST_MARGIN_M = 5.0  # of the fence, however little is known of where the drone is
_MOVED_M = 0.3  # by which the fence may be elsewhere in the local frame before it is put there
# A drone that does not know its frame waits where it is, within this fence; after a while on a small circle, because ranges alone
# tell nothing of the heading of a drone that stays.
_WAITING_FENCE_M, _PATIENCE_S = 12.0, 5.0
_WAITING_RADIUS_M, _WAITING_MPS = 2.0, 1.0


class Moment(Struct, frozen=True):
    """What a step of the navigation rests on. ``since_ns``: when the stage began; hypothesis: mission frame."""

    now_ns: int
    stage: Stage
    since_ns: int
    vehicle: VehicleState
    hypothesis: Hypothesis | None

    @property
    def stage_s(self) -> float:
        """How long the stage has lasted."""
        return (self.now_ns - self.since_ns) * 1e-9

    @property
    def ground_m(self) -> float:
        """Local z of the ground below the vehicle, by what its rangefinder says now."""
        return self.vehicle.position_m[2] - self.vehicle.height_m


class Navigator:
    """Plans one drone's flight while it searches, tracks or returns."""

    def __init__(
        self, mission: MissionConfig, drone: DroneConfig, frames: FrameGraph, search: Search, informed: InformedSearch
    ) -> None:
        self._config = mission
        self._id = drone.id
        self._lag_s = drone.vehicle_lag_s
        self._own = OwnFrame(drone.id, frames)
        self._neighbourhood = Neighbourhood(mission, frames)
        self._search, self._informed = search, informed
        self._ground = Ground.from_config(mission)
        self._orbit = Orbit(mission.encirclement, mission.area.floor_m)
        most_mps = _SPEED_SHARE * mission.limits.speed_mps - mission.encirclement.speed_mps
        self._leading = Leading(mission.area, most_mps, mission.encirclement.radius_m + _ROOM_M)
        self._encirclement = Encirclement(mission.encirclement, mission.limits)
        self._tracker: Tracker | None = None
        self._virtual = PeerState((0.0, 0.0, 0.0))  # the tracker's own state, or the vehicle's where it begins
        self._epoch = -1
        self._due_ns = 0
        self._yaw_rad = 0.0
        self._corners = np.array([(x, y, 0.0) for x, y in mission.area.polygon_m])
        self._fenced: tuple[Array, float] | None = None  # the area's corners (N, 2) and the margin of the fence; none: it waits
        self._ground_m = 0.0  # of the fence's heights
        self._waits: tuple[int, float, float] | None = None  # since when and where it waits for its frame to be known, local
        self._launch: VehicleState | None = None
        self._home: Vector3 | None = None

    @property
    def home(self) -> Vector3 | None:
        """Where a return leads, mission frame; None while nobody knows where that is."""
        launch = self._launch
        return self._own.in_mission(launch.epoch, launch.stamp_ns, launch.position_m) if launch is not None else self._home

    @property
    def waits(self) -> bool:
        """Whether the drone does not know its frame and waits for it."""
        return self._waits is not None

    def took_off(self, vehicle: VehicleState) -> None:
        """Keep the place that a return leads to."""
        self._launch = vehicle

    def rejoin(self, home: Vector3 | None) -> None:
        """Take the place that a return leads to from before this agent was restarted."""
        self._home = home

    def follow(self, vehicle: VehicleState) -> None:
        """Take telemetry, each once, also while another layer flies."""
        self._own.follow(vehicle)

    def at_home(self, vehicle: VehicleState) -> bool:
        """Whether the drone hovers over its home, near enough to land there."""
        home = self._home_in_local(vehicle.epoch)
        if home is None:
            return False
        x, y, _ = home
        u, v, _ = vehicle.velocity_mps
        return hypot(vehicle.position_m[0] - x, vehicle.position_m[1] - y) < AT_HOME_M and hypot(u, v) < AT_HOME_MPS

    def rest(self) -> None:
        """Another layer flies now; the next step begins from where the vehicle then is."""
        self._tracker = None

    def step(self, moment: Moment, peers: Peers) -> tuple[Setpoint, Plan | None]:
        """The setpoint for now, and a new plan to publish where one was made.

        A drone that does not know its frame cannot know where the area is: it waits where it is, out of the way of whom it sees.
        """
        self._own.locate(moment.vehicle.epoch)
        plan = None
        if self._tracker is None or self._epoch != moment.vehicle.epoch:
            self._tracker = self._begin(moment)
        elif moment.now_ns >= self._due_ns:
            self._virtual = self._tracker.state(moment.now_ns)
            self._confine(self._tracker, moment.vehicle)
        centre = self._centre(moment)
        if moment.now_ns >= self._due_ns:
            self._due_ns = moment.now_ns + REPLAN_NS
            plan = self._replan(self._tracker, moment, centre, peers)
        position, velocity, acceleration = self._tracker.sample(moment.now_ns)
        self._yaw_rad, yaw_rate_rps = self._heading(moment, centre)
        return Setpoint(position, velocity, acceleration, self._yaw_rad, yaw_rate_rps), plan

    def _home_in_local(self, epoch: int) -> Vector3 | None:
        """The home in the local frame of this epoch; also where only that frame is known, if the drone took off in it."""
        home = self.home
        if self._own.locate(epoch) and home is not None:
            return self._own.local_from_mission.apply_point(home)
        launch = self._launch
        return launch.position_m if launch is not None and launch.epoch == epoch else None

    def _begin(self, moment: Moment) -> Tracker:
        """From where the vehicle is, also after a jump of its localisation: in the new epoch's frame it has not moved."""
        vehicle = moment.vehicle
        self._ground_m, self._waits = self._level_m(moment), None
        tracker = Tracker(self._config.limits, self._fence(moment.vehicle), STEP_S, HORIZON, self._lag_s, drone_id=self._id)
        tracker.reset(vehicle.position_m, vehicle.velocity_mps)
        self._virtual = PeerState(vehicle.position_m, vehicle.velocity_mps)
        self._epoch, self._due_ns = vehicle.epoch, 0
        return tracker

    def _confine(self, tracker: Tracker, vehicle: VehicleState) -> None:
        """Put the fence where it is by now in the local frame, if that differs."""
        if (self._fenced is not None) is self._own.is_known:
            if self._fenced is None or self._own.mission_from_local.covariance is None:
                return
            corners, margin_m = self._fenced
            newest, newest_margin_m = self._outline(vehicle)
            if max(float(np.abs(newest - corners).max()), abs(newest_margin_m - margin_m)) < _MOVED_M:
                return
        tracker.confine(self._fence(vehicle))

    def _outline(self, vehicle: VehicleState) -> tuple[Array, float]:
        """The area's corners (N, 2) in the local frame; and the fence's margin, less what is doubted of where the vehicle is."""
        margin_m = self._config.area.fence_margin_m
        if self._own.mission_from_local.covariance is not None:
            doubted_m = margin_m - _DOUBT_SIGMAS * self._own.sigma_m(vehicle)
            margin_m = max(doubted_m, min(margin_m, _LEAST_MARGIN_M))
        return self._own.local_from_mission.apply(self._corners)[:, :2], margin_m

    def _fence(self, vehicle: VehicleState) -> Fence:
        area = self._config.area
        if not self._own.is_known:
            self._fenced = None
            here = Point(vehicle.position_m[:2]).buffer(_WAITING_FENCE_M)
            return Fence(here, area.floor_m + self._ground_m, area.ceiling_m + self._ground_m)
        corners, margin_m = self._fenced = self._outline(vehicle)
        return Fence.from_area(replace(area, fence_margin_m=margin_m), corners, ground_m=self._ground_m)

    def _level_m(self, moment: Moment) -> float:
        """Local z from which a reference's heights above ground count, and the fence's: of the ground below.

        Where the ground is not even it is 0: there the tracker adds the height of what lies under its plan.
        """
        return moment.ground_m if self._ground.level else 0.0

    def _relief(self, moment: Moment) -> Relief | None:
        """The ground around the vehicle, by the mission's model and the rangefinder; None where it is even."""
        if self._ground.level:
            return None
        x, y, _ = moment.vehicle.position_m
        return self._ground.around(self._own.mission_from_local if self._own.is_known else None, (x, y), moment.ground_m)

    def _above_level(self, moment: Moment) -> PeerState:
        """The tracker's own state with z as references count it."""
        relief, (x, y, z) = self._relief(moment), self._virtual.position
        if relief is None:
            return self._virtual
        return replace(self._virtual, position=(x, y, z - float(relief(np.array([[x, y]]))[0])))

    def _centre(self, moment: Moment) -> tuple[Vector3, Vector3] | None:
        """Where the source is now and its velocity, in the local frame and as this drone's own localisation has it."""
        hypothesis = moment.hypothesis
        if hypothesis is None or not self._own.is_known:
            return None
        x, y, z = hypothesis.sight_of(self._id).position.tolist()
        u, v, w = hypothesis.velocity.tolist()
        if hypothesis.evidence is not None:  # no other estimator knows where the source goes
            (x, y), (u, v) = self._leading.centre(moment.now_ns, hypothesis.stamp_ns, (x, y), (u, v))
        return self._own.local_from_mission.apply_point((x, y, z)), self._own.local_from_mission.rotate_direction((u, v, w))

    def _replan(self, tracker: Tracker, moment: Moment, centre: tuple[Vector3, Vector3] | None, peers: Peers) -> Plan:
        local_from_mission = self._own.local_from_mission if self._own.is_known else None
        me = Self(moment.now_ns, moment.vehicle.epoch, self._own.sigma_m(moment.vehicle), local_from_mission)
        others = self._neighbourhood.around(peers, me)
        partners = [other for other in others if other.takes_part]
        if self._own.is_known:
            self._waits = None
        if moment.stage is Stage.RETURN:
            reference = self._way_home(moment)
        elif not self._own.is_known:
            reference = self._wait(moment)
        elif moment.stage is Stage.SURVEY or centre is None:
            reference = self._survey(moment, partners)
        else:
            reference = self._circle(moment, centre, partners)
        vehicle = moment.vehicle
        made = tracker.plan(
            moment.now_ns,
            PeerState(vehicle.position_m, vehicle.velocity_mps),
            reference,
            [other.plan for other in others],
            self._relief(moment),
        )
        return Plan(
            stamp_ns=made.stamp_ns,
            drone=self._id,
            epoch=vehicle.epoch,
            step_ns=round(made.step_s * 1e9),
            positions_m=tuple(map(tuple, made.positions.tolist())),
        )

    def _survey(self, moment: Moment, partners: list[Neighbour]) -> Reference:
        here = self._own.mission_from_local.apply_point(self._virtual.position)[:2]
        moves = self._own.mission_from_local.rotate_direction(self._virtual.velocity)[:2]
        others = [
            self._own.mission_from_local.apply_point(partner.plan.state(moment.now_ns).position)[:2] for partner in partners
        ]
        found = self._informed.reference(moment.now_ns, here, moves, others, HORIZON, STEP_S)
        if found is None:
            active = sorted([self._id, *(partner.id for partner in partners)])
            found = self._search.reference(active, here, HORIZON, STEP_S)
        positions, velocities = found
        level = np.zeros(HORIZON + 1)
        placed = self._own.local_from_mission.apply(np.column_stack((positions, level)))
        moving = self._own.local_from_mission.rotate(np.column_stack((velocities, level)))
        placed[:, 2] = self._level_m(moment) + self._config.survey.height_m
        return Reference(placed, moving, STEP_S)

    def _wait(self, moment: Moment) -> Reference:
        """Stay; after a while on a small circle through the place."""
        x, y, _ = self._virtual.position
        since_ns, x, y = self._waits = self._waits or (moment.now_ns, x, y)
        waited_s = (moment.now_ns - since_ns) * 1e-9 - _PATIENCE_S
        turned = np.maximum(0.0, waited_s + STEP_S * np.arange(HORIZON + 2.0)) * (_WAITING_MPS / _WAITING_RADIUS_M)
        positions = np.empty((HORIZON + 2, 3))
        positions[:, 0] = x + _WAITING_RADIUS_M * (np.cos(turned) - 1.0)
        positions[:, 1] = y + _WAITING_RADIUS_M * np.sin(turned)
        positions[:, 2] = self._level_m(moment) + self._config.survey.height_m
        return Reference(positions[:-1], np.diff(positions, axis=0) / STEP_S, STEP_S)

    def _circle(self, moment: Moment, centre: tuple[Vector3, Vector3], partners: list[Neighbour]) -> Reference:
        """Around the hypothesis: as near as it is known, by an estimator that says so and the smooth law.

        Otherwise on the configured circle, and on ever wider ones where the source has to be found again.
        """
        config, hypothesis = self._config.encirclement, moment.hypothesis
        radius_m, height_m, doubt_m = config.radius_m, config.height_m, 0.0
        if config.law == "smooth" and hypothesis is not None and hypothesis.evidence is not None:
            rms_m = hypothesis.sight_of(self._id).rms_m
            self._orbit.update(moment.now_ns, rms_m, hypothesis.activity_bq, moment.stage is Stage.REACQUIRE)
            radius_m, height_m = self._orbit.radius_m, self._orbit.height_m
            doubt_m = _DOUBT_SIGMAS * max((partner.plan.sigma_m for partner in partners), default=0.0)
        elif moment.stage is Stage.REACQUIRE:
            radius_m += self._config.track.widening_mps * moment.stage_s
        (x, y, _), velocity = centre
        return self._encirclement.reference(
            self._above_level(moment),
            {partner.id: partner.plan.state(moment.now_ns) for partner in partners},
            self._id,
            center=(x, y, self._level_m(moment)),
            center_velocity=velocity,
            radius_m=radius_m,
            height_m=height_m,
            doubt_m=doubt_m,
        )

    def _way_home(self, moment: Moment) -> Reference:
        """Straight home at the survey's speed and height; without a known home, stay."""
        x, y, _ = self._virtual.position
        home = self._home_in_local(moment.vehicle.epoch) or (x, y, 0.0)
        way = np.array([home[0] - x, home[1] - y])
        distance = hypot(*way.tolist())
        travelled = np.minimum(self._config.survey.speed_mps * STEP_S * np.arange(HORIZON + 2.0), distance)
        positions = np.empty((HORIZON + 2, 3))
        positions[:, :2] = (x, y) + travelled[:, None] * (way / max(distance, 1e-9))
        positions[:, 2] = self._level_m(moment) + self._config.survey.height_m
        return Reference(positions[:-1], np.diff(positions, axis=0) / STEP_S, STEP_S)

    def _heading(self, moment: Moment, centre: tuple[Vector3, Vector3] | None) -> tuple[float, float]:
        """Yaw and its rate: always turning in the survey (paper, Sec. V-A), facing the hypothesis when tracking."""
        if moment.stage is Stage.RETURN:
            return self._yaw_rad, 0.0
        if moment.stage is Stage.SURVEY or centre is None:
            rate = self._config.survey.yaw_rate_rps
            return rate * moment.stage_s, rate
        (cx, cy, _), _ = centre
        x, y, _ = moment.vehicle.position_m
        return atan2(cy - y, cx - x), 0.0
