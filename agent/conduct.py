"""How one drone flies its mission: from what it knows to the stage, and from the stage to what the autopilot is to do."""

from __future__ import annotations

from collections import Counter

from msgspec import Struct

from agent.config import DroneConfig, MissionConfig
from agent.guidance import Moment
from agent.knowledge import Knowledge
from agent.memory import Memory
from agent.mission import Mission, Situation
from agent.navigator import Navigator
from agent.peers import Peers
from agent.problems import TELEMETRY_AGE_NS
from agent.search import CoverageLog, InformedSearch, Prospect, Search, conclusion
from agent.vehicle.interface import Request, VehicleCommand, VehicleState
from agent.whereabouts import Whereabouts
from protocol.messages import Action, Coverage, Plan, Stage

Searched = tuple[int, int, tuple[tuple[float, float], ...]]


class Act(Struct, frozen=True):
    """What a step comes to. plan: to be published, where one was made; searched: stamp, epoch and path of what was searched."""

    command: VehicleCommand
    plan: Plan | None = None
    searched: Searched | None = None


class Conduct:
    """``finding``: what the search has ended with, where it has found nothing; else empty. ``memory``: what an agent that is
    restarted must know, the same object as long as nothing in it changes."""

    def __init__(
        self,
        mission: MissionConfig,
        drone: DroneConfig,
        knowledge: Knowledge,
        where: Whereabouts,
        counters: Counter[str],
        memory: Memory | None,
    ) -> None:
        """``memory``: of the agent that flew this drone before."""
        self._config = mission
        self._id, self._mission_id = drone.id, mission.mission_id
        self._knowledge, self._where, self._counters = knowledge, where, counters
        self._mission = Mission(mission.track, mission.survey, can_lose=mission.fusion.estimator != "given")
        frames, fusion = knowledge.frames.graph, knowledge.fusion
        self._search = Search(mission, drone.id, frames, lambda: fusion.log.entries(Coverage))
        self._coverage = CoverageLog(mission.survey.lane_spacing_m)
        self._prospect = Prospect(lambda: fusion.outlook)
        self._navigator = Navigator(mission, drone, frames, self._search, InformedSearch(mission, self._prospect))
        self.finding = ""
        self.memory = memory
        self._remembered = memory  # until telemetry has shown what it is worth

    @property
    def stage(self) -> Stage:
        """What the drone is doing."""
        return self._mission.stage

    @property
    def swath_m(self) -> float:
        """Width of what is searched by flying a path."""
        return self._coverage.swath_m

    def follow(self, vehicle: VehicleState) -> None:
        """Take telemetry, each once."""
        self._navigator.follow(vehicle)
        if self._remembered is not None:
            self._rejoin(self._remembered, vehicle)

    @property
    def started_ns(self) -> int | None:
        """With which start command's stamp the swarm's mission began; None while this drone does not fly it."""
        return self._mission.started_ns if self.stage not in (Stage.PREFLIGHT, Stage.LANDED) else None

    def obey(self, action: Action, stamp_ns: int, started_ns: int, now_ns: int, problems: tuple[str, ...]) -> bool:
        """Carry out an operator's command of that stamp, or refuse it.

        started_ns: with which stamp the swarm's mission began, if this is a start. problems: what stands against one.
        """
        if self._mission.command(action, stamp_ns, self._situation(now_ns, problems)) is not None:
            return False
        if action is Action.START and self._where.vehicle is not None:
            self._navigator.home.took_off(self._where.vehicle)
            self._mission.started_ns = started_ns
            self._knowledge.start(started_ns)
        return True

    def divide_anew(self) -> None:
        """More was covered than the division of the area rests on."""
        self._search.divide_anew()

    def step(self, now_ns: int, peers: Peers) -> Act:
        """Move on in the mission, and plan."""
        self._conclude(now_ns)
        self._mission.step(self._situation(now_ns))
        self._remember(now_ns)
        return self._act(now_ns, peers)

    def _rejoin(self, memory: Memory, vehicle: VehicleState) -> None:
        """Go on with the flight that is remembered, or forget it where the vehicle is on the ground."""
        fits = memory.fits(self._mission_id, vehicle)
        if fits is None:
            return
        self._remembered = None
        if not fits:
            self._counters["memory_void"] += 1
            return
        self._counters["rejoined"] += 1
        self._mission.rejoin(memory, vehicle, vehicle.stamp_ns)
        self._navigator.home.remember(memory.home_m)
        self._knowledge.start(memory.started_ns)

    def _remember(self, now_ns: int) -> None:
        if self._remembered is None:
            home = self._navigator.home.in_mission
            memory = self._mission.memory(self._mission_id, home, now_ns, self._where.epoch_offset)
            if memory != self.memory:
                self.memory = memory

    def _situation(self, now_ns: int, problems: tuple[str, ...] = ()) -> Situation:
        vehicle, hypothesis = self._where.vehicle, self._knowledge.fusion.hypothesis
        at_home = self.stage is Stage.RETURN and vehicle is not None and self._navigator.home.is_reached(vehicle)
        return Situation(
            now_ns,
            vehicle,
            hypothesis is not None,
            self._knowledge.last_cone_ns,
            at_home,
            problems,
            rms_m=hypothesis.sight_of(self._id).rms_m if hypothesis is not None and hypothesis.evidence is not None else None,
            nothing_found=self.finding != "",
        )

    def _conclude(self, now_ns: int) -> None:
        """Say that nothing was found once that is so, and until something is."""
        if self._knowledge.fusion.hypothesis is not None:
            self.finding = ""
        elif self.stage is Stage.SURVEY:
            found = conclusion(self._config.survey, self._mission.searched_s(now_ns), self._prospect.at(now_ns))
            self.finding = found or self.finding

    def _act(self, now_ns: int, peers: Peers) -> Act:
        """What the autopilot is to do. A drone that does not know where it is, or in which frame, holds."""
        request, vehicle = self._mission.request, self._where.vehicle
        height_m = self._config.survey.height_m
        if request is not Request.OFFBOARD or vehicle is None:
            self._navigator.rest()
            return Act(VehicleCommand(request, takeoff_height_m=height_m))
        if abs(now_ns - vehicle.stamp_ns) > TELEMETRY_AGE_NS:  # of the future: this computer's clock was set back
            self._navigator.rest()
            self._counters["held_without_telemetry"] += 1
            return Act(VehicleCommand(Request.HOLD))
        moment = Moment(now_ns, self.stage, self._mission.since_ns, vehicle, self._knowledge.fusion.hypothesis)
        setpoint, plan = self._navigator.step(moment, peers)
        if self._navigator.waits:
            self._counters["waited_without_frame"] += 1
        searched = None
        if self.stage is Stage.SURVEY:
            searched = self._coverage.add(now_ns, vehicle.epoch, vehicle.position_m[:2])
        return Act(VehicleCommand(request, setpoint, height_m), plan, searched)
