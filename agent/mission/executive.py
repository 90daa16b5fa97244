"""The mission executive of one drone: from world model and telemetry to the stage, and from the stage to a vehicle command."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from math import dist, inf

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.estimator import Hypothesis
from radron.agent.geometry import Vector3
from radron.agent.localization.clocks import Clocks
from radron.agent.localization.knownframe import LARGEST_DOUBT_M
from radron.agent.localization.ownpose import OwnPose
from radron.agent.mission.aloft import Aloft
from radron.agent.mission.authority import MODES, is_failsafe
from radron.agent.mission.memory import Memory
from radron.agent.mission.problems import LOW_BATTERY, TELEMETRY_AGE_NS
from radron.agent.mission.remembering import Remembering
from radron.agent.mission.reserve import Reserve
from radron.agent.mission.situation import Situation
from radron.agent.mission.stages import ROOMLESS_S, STRANDED_S, Mission
from radron.agent.mission.worldmodel import WorldModel
from radron.agent.navigation.focus import focus, have_had_turns, looks
from radron.agent.navigation.home import NO_NEARER_S, REVOKED_NO_NEARER_S, KeptHome
from radron.agent.navigation.mapping import Block, Lanes, MapSurvey, blocks_of, map_conclusion
from radron.agent.navigation.moment import Moment
from radron.agent.navigation.navigator import Navigator
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.reckoning import Reckoning
from radron.agent.navigation.surveying import CoverageLog, InformedSearch, Prospect, Search, conclusion
from radron.agent.navigation.unheard.crossing import low_m
from radron.agent.vehicle.interface import Request, VehicleCommand, VehicleState
from radron.protocol.codes import Code
from radron.protocol.entries import Coverage
from radron.protocol.messages import Action, Plan, Stage
from radron.protocol.stages import ON_GROUND, RETURNING, SEARCHING
from radron.protocol.texts import CodedText

Searched = tuple[int, int, tuple[tuple[float, float], ...]]
_LONGEST_FLIGHT_NS = 3_600_000_000_000  # no battery of a small multicopter lasts longer


class Decision(Struct, frozen=True):
    """Result of a step. ``plan``: a new one, to be published; ``searched``: stamp, epoch and path of a searched stretch."""

    command: VehicleCommand
    plan: Plan | None = None
    searched: Searched | None = None


class Executive:
    """Flies the mission of one drone.

    ``finding``: the result of a search that ended without finding a source; else None. ``remembering``: state for an agent that
    is restarted in flight.
    """

    def __init__(
        self,
        mission: MissionConfig,
        drone: DroneConfig,
        world: WorldModel,
        own: OwnPose,
        counters: Counter[str],
        memory: Memory | None,
        clocks: Clocks,
    ) -> None:
        """``memory``: from the agent that flew this drone before."""
        self._config = mission
        self._id, self._mission_id = drone.id, mission.mission_id
        self._world, self._own, self._counters = world, own, counters
        self._clocks, self._utc = clocks, clocks.utc
        can_lose = mission.fusion.estimator != "given"
        self._mission, self._aloft = Mission(mission.track, mission.survey, can_lose, mission.area.floor_m), Aloft()
        frames, fusion = world.frames.graph, world.fusion
        self._search: Lanes = Search(mission, drone.id, frames)
        if self._maps:
            self._search = MapSurvey(mission, drone.id, frames, self._blocks)
        self._coverage = CoverageLog(self._search.swath_m)
        self.prospect = Prospect(lambda: fusion.outlook)
        informed = InformedSearch(mission, self.prospect)
        self._navigator = Navigator(mission, drone, own, frames, self._search, informed, self._measured)
        self._reserve = Reserve(drone.id, mission.safety.battery_reserve)
        self.finding: CodedText | None = None
        self._revoked = False
        self._left: Hypothesis | None = None  # the last one of a drone that is revoked: the others circle there
        self.remembering = Remembering(mission.mission_id, self._mission, self._navigator, own, counters, memory, self._utc)

    @property
    def stage(self) -> Stage:
        """The present stage."""
        return self._mission.stage

    def flies_home(self, now_ns: int) -> bool:
        """Whether this agent flies its vehicle home, or has. False while a pilot or a failsafe flies it, and without recent
        telemetry, when it holds.
        """
        vehicle, stage = self._own.vehicle, self.stage
        if stage not in RETURNING or vehicle is None or self._mission.released:
            return stage is Stage.LANDED
        return now_ns - vehicle.stamp_ns <= TELEMETRY_AGE_NS and vehicle.mode in MODES[stage]

    @property
    def reckoning(self) -> Reckoning | None:
        """The context of the last plan; None while the vehicle is released."""
        return self._navigator.reckoning

    @property
    def swath_m(self) -> float:
        """Width searched along a path."""
        return self._coverage.swath_m

    def follow(self, vehicle: VehicleState) -> None:
        """Take telemetry, each once."""
        self._navigator.follow(vehicle)
        self._aloft = self._aloft.observed(vehicle)
        if (started_ns := self.remembering.rejoin(vehicle)) != 0:
            self._begin(started_ns)

    @property
    def started_ns(self) -> int | None:
        """Stamp of the start command with which the swarm's mission began; None while this drone does not fly it, or does not
        know.
        """
        started_ns = self._mission.flight.started_ns
        return None if self.stage in ON_GROUND or started_ns == 0 else started_ns

    def obey(
        self, action: Action, stamp_ns: int, begun_ns: int | None, now_ns: int, problems: tuple[CodedText, ...]
    ) -> str | None:
        """Carry out an operator's command of that stamp. Returns why it was refused, or None.

        ``begun_ns``: when the swarm's mission began, as other drones report; None without a report: then a start begins the
        mission, and after a landing a new one. No other command states this time. ``problems``: the obstacles to a start.
        """
        started_ns = stamp_ns if begun_ns is None else min(stamp_ns, begun_ns)
        refused = self._mission.command(action, started_ns, self._situation(now_ns, problems))
        if refused is not None:
            return refused
        if action is Action.START and self._own.vehicle is not None:
            self._navigator.take_off(self._own.vehicle)
            self.finding = None
            self._begin(started_ns)
            self._coverage = CoverageLog(self._search.swath_m)
        return None

    def revoke(self) -> None:
        """Note that this drone has been revoked: it returns, and the others ignore its messages."""
        if not self._revoked:
            self._left = focus(self._world.fusion.hypothesis, self._config)
        self._revoked = self._navigator.revoked = True

    def left_out(self) -> None:
        """Discard what this drone measures from now on: its log has contradicted itself."""
        self._own.left_out()

    def exclude(self, drone: str) -> None:
        """Note that another drone has been revoked: it returns, without a link to any other."""
        self._navigator.excluded.add(drone)

    def obeys(self, drone: str, now_ns: int) -> None:
        """Another drone that has been revoked is on its way home."""
        self._navigator.obeys(drone, now_ns)

    def passing(self, now_ns: int, peers: Peers) -> tuple[str, ...]:
        """Ids of drones that fly past this one, on the ground, so near that it must not take off."""
        vehicle = self._own.vehicle
        if vehicle is None or vehicle.in_air or self.stage not in ON_GROUND:
            return ()
        return self._navigator.passing(now_ns, vehicle, peers)

    @property
    def home_m(self) -> Vector3 | None:
        """Where a return ends, mission frame; None while not known."""
        return self._navigator.home.kept.place_m

    def silences_ns(self, peers: Peers, stamp_ns: int) -> dict[str, int]:
        """Return the time without a pose of each other drone at a stamp."""
        return self._navigator.silences_ns(peers, stamp_ns)

    def problems(self, now_ns: int) -> tuple[CodedText, ...]:
        """Problems of this drone's flight for the operator, one line each."""
        unsteered, landed = self._mission.unsteered(now_ns), self._mission.flight.landed_because
        coming_down = "landed" if self.stage is Stage.LANDED else "lands"
        low = LOW_BATTERY if self._reserve.is_low else None
        why = CodedText(Code.LANDING, f"{coming_down}: {landed}") if landed else None
        standing = self._mission.standing_armed(now_ns)
        absence = self._navigator.absence
        links = absence.problems if absence is not None else ()
        told = (unsteered, standing, *links, low, why, self._navigator.response.problem)
        return tuple(text for text in told if text is not None)

    def take_coverage(self, entry: Coverage, anew: bool) -> None:
        """Take the coverage of any drone; ``anew``: the present division of the area lacks it, and is made again."""
        self._search.take(entry)
        if anew:
            self._search.divide_anew()

    def recount_coverage(self, drone: str, entries: Iterable[Coverage]) -> None:
        """Count only these entries of a drone's coverage."""
        self._search.recount(drone, entries)

    def step(self, now_ns: int, peers: Peers) -> Decision:
        """Advance the mission, and plan."""
        self._look_up(now_ns, peers)
        self._conclude(now_ns)
        if self.stage is Stage.RETURN and self._own.vehicle is not None:
            self._navigator.home.watch(self._own.vehicle)
        absence = self._navigator.absence
        unheard = absence.coming_home if absence is not None else ()
        way_home_s = self._way_home_s if self._reserve.is_low else 0.0
        self._reserve = self._reserve.observed(now_ns, self._own.vehicle, peers.statuses(now_ns), unheard, way_home_s)
        self._mission.step(self._situation(now_ns))
        self.remembering.note(now_ns, peers)
        return self._decide(now_ns, peers)

    @property
    def _maps(self) -> bool:
        """Whether the mission is a map of contaminated ground."""
        return self._config.survey.strategy == "map"

    def _blocks(self) -> list[Block]:
        """The swarm's map of contaminated ground; empty without one."""
        found = self._world.fusion.contamination
        return [] if found is None else blocks_of(found)

    @property
    def _way_home_s(self) -> float:
        """Duration of the straight way home, s; 0 if not known."""
        vehicle, home = self._own.vehicle, self._navigator.home.in_local
        return dist(vehicle.position_m[:2], home[:2]) / self._config.survey.speed_mps if vehicle and home else 0.0

    def _look_up(self, now_ns: int, peers: Peers) -> None:
        """Handle an in-flight start: publish a flying stage, and accept commands.

        Home is the launch place by the mission; the mission's begin is as the others report.
        """
        if self._aloft.shown and self.stage in ON_GROUND and self._own.vehicle is not None:
            self._counters["found_flying"] += 1
            self._mission.find_flying(self._own.vehicle, now_ns)
            self._navigator.resume(KeptHome(self._config.member(self._id).origin_m))
        started_ns, utc_ns = self._mission.flight.started_ns, self._utc.of(now_ns)
        if self.stage not in ON_GROUND and utc_ns - started_ns >= _LONGEST_FLIGHT_NS:  # begin not known
            begun_ns = peers.begun_ns(self._mission_id, now_ns, utc_ns)
            if begun_ns is not None and begun_ns > started_ns:
                self._begin(begun_ns)
            elif started_ns == 0 and self.stage in SEARCHING:  # older entries are of another flight
                self._begin(utc_ns - _LONGEST_FLIGHT_NS)

    def _begin(self, started_ns: int) -> None:
        """Discard all measurements and coverage of before."""
        self._mission.begin(started_ns)
        self._world.start(started_ns)
        self._search.begin(started_ns)

    def _situation(self, now_ns: int, problems: tuple[CodedText, ...] = ()) -> Situation:
        vehicle, hypothesis = self._own.vehicle, self._world.fusion.hypothesis
        at_home = self.stage is Stage.RETURN and self._navigator.home.is_reached and not self._navigator.comes_down
        returning_s = (now_ns - self._mission.flight.since_ns) * 1e-9 if self.stage is Stage.RETURN else 0.0
        return Situation(
            now_ns,
            vehicle,
            hypothesis is not None,
            self._world.last_cone_ns,
            at_home,
            problems,
            rms_m=hypothesis.sight_of(self._id).rms_m if hypothesis is not None and hypothesis.evidence is not None else None,
            nothing_found=self.finding is not None,
            stranded_s=self._stranded_s,
            revoked=self._revoked,
            battery_low=self._reserve.returns,
            battery_spent=self._reserve.is_spent,
            no_nearer=self._is_no_nearer(returning_s),
            searches_on=self._searches_on(hypothesis, now_ns),
            looks=looks(hypothesis),
        )

    def _is_no_nearer(self, returning_s: float) -> bool:
        """Whether the return has made no progress for long enough to land on the spot. A revoked drone has less time, because the
        others expect it landed soon. Not while it is above the altitudes of the others, or over home.
        """
        vehicle, home = self._own.vehicle, self._navigator.home
        is_low = vehicle is not None and vehicle.height_m < low_m(self._config)
        longest_s = REVOKED_NO_NEARER_S if self._revoked and is_low and not home.is_near else NO_NEARER_S
        longest_s = STRANDED_S if self._never_knows_its_frame else longest_s
        return min(returning_s, home.no_nearer_s) >= longest_s

    @property
    def _never_knows_its_frame(self) -> bool:
        """Whether this drone has no way home, and nothing to wait for. Others keep clear of all its possible positions."""
        return self._own.is_lost or self._own.is_displaced

    def _searches_on(self, hypothesis: Hypothesis | None, now_ns: int) -> bool:
        """Whether to search for further sources: for a map always. The search continues until all of the area is covered. It
        resumes once each source has had its turn, while the exclusion leaves room for a source, or at once where a search cue
        leads to one. It ends with its time, and pauses during a verification pass, and while drones without a link may circle: a
        drone leaving the circle could meet them.
        """
        if self._maps:
            return True
        absence = self._navigator.absence
        if absence is not None and absence.may_circle:
            return False
        if hypothesis is None or hypothesis.watched_s is None or looks(hypothesis):
            return False
        longest_s = self._config.survey.duration_s
        flight = self._mission.flight
        began = flight.tracking_since_ns is not None
        searched_s = (self._utc.of(now_ns) - flight.started_ns) * 1e-9 if began else flight.searched_s(now_ns)
        if longest_s is not None and searched_s >= longest_s:
            return False
        if not began:
            return not self._search.is_complete
        outlook = self.prospect.at(now_ns)
        if outlook is None:
            return False
        if outlook.lead is not None:
            return True
        hides = outlook.exclusion is not None and bool(outlook.exclusion.left.any())
        return hides and have_had_turns(hypothesis, self._config)

    @property
    def _stranded_s(self) -> float:
        """The return delay, s; infinite without a reason (no feasible circle while links are lost, isolation, uncertain
        position).
        """
        absence = self._navigator.absence
        if absence is not None and not self._navigator.has_room:
            return ROOMLESS_S
        is_alone = absence is not None and absence.alone and self._config.safety.alone == "return"
        return STRANDED_S if is_alone or self._never_knows_its_frame or self._own.doubt_m > LARGEST_DOUBT_M else inf

    def _measured(self, now_ns: int) -> frozenset[str]:
        """The drones that have measured since the mission began, and no longer ago than one may fly.

        Cameras measure on the ground as well, before a start in which not all take part.
        """
        since_ns = max(self._mission.flight.started_ns, self._utc.of(now_ns) - _LONGEST_FLIGHT_NS)
        return frozenset(name for name, newest_ns in self._world.fusion.log.publishers.items() if newest_ns >= since_ns)

    def _conclude(self, now_ns: int) -> None:
        """Note that the search has ended without a source, until one is found; or that the map is complete."""
        if self._maps:
            if self.stage is Stage.SURVEY and not self.finding:
                searched_s = self._mission.flight.searched_s(now_ns)
                self.finding = map_conclusion(self._config.survey, searched_s, self._search.is_complete, self._blocks)
        elif self._world.fusion.hypothesis is not None:
            self.finding = None
        elif self.stage is Stage.SURVEY:
            found = conclusion(self._config, self._mission.flight.searched_s(now_ns), self.prospect.at(now_ns))
            self.finding = found or self.finding

    def _decide(self, now_ns: int, peers: Peers) -> Decision:
        """The command for the autopilot."""
        request, vehicle = self._mission.request, self._own.vehicle
        height_m = self._config.survey.height_m
        if request is not Request.OFFBOARD or vehicle is None:
            self._navigator.rest(now_ns, peers)
            return Decision(VehicleCommand(request, takeoff_height_m=height_m))
        if now_ns - vehicle.stamp_ns > TELEMETRY_AGE_NS:
            self._navigator.rest(now_ns, peers)
            return Decision(VehicleCommand(self._request_blind(vehicle, now_ns)))
        believed = self._left if self._revoked else focus(self._world.fusion.hypothesis, self._config)
        if believed is not None and (stamp_ns := self._clocks.own_ns_of_common(believed.stamp_ns)) != believed.stamp_ns:
            believed = replace(believed, stamp_ns=stamp_ns)
        moment = Moment(now_ns, self.stage, self._mission.flight.since_ns, vehicle, believed, self._mission.flight.took_part_ns)
        setpoint, plan = self._navigator.step(moment, peers)
        if self._navigator.waits:
            self._counters["waited_without_frame"] += 1
        searched = None
        if self._coverage.swath_m != self._search.swath_m:  # other lanes: the path so far does not count for them
            self._coverage = CoverageLog(self._search.swath_m)
        if self.stage is Stage.SURVEY:
            searched = self._coverage.add(now_ns, vehicle.epoch, vehicle.position_m[:2])
        return Decision(VehicleCommand(request, setpoint, height_m), plan, searched)

    def _request_blind(self, vehicle: VehicleState, now_ns: int) -> Request:
        """Return the request without recent telemetry: hold. In a failsafe, offboard without a setpoint, so that the failsafe may
        return or land: on so bad a link the autopilot would not leave a hold again.
        """
        if is_failsafe(vehicle):
            self._counters["left_to_failsafe"] += 1
            self._mission.unheard(now_ns, holds=False)
            return Request.OFFBOARD
        self._counters["held_without_telemetry"] += 1
        self._mission.unheard(now_ns, holds=True)
        return Request.HOLD
