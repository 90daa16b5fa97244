"""The brain of one drone: what it hears, sees and measures goes in, messages and a command come out.

The same pilot flies in lockstep, live and in a replay: once made it does no I/O, reads no clock and draws no random numbers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from agent.config import DroneConfig, MissionConfig
from agent.detector.calibration import Calibration, load_calibration
from agent.detector.chain import DetectorChain
from agent.detector.readout import Readout
from agent.detector.recognition import NuclideWatch
from agent.errors import ConfigError
from agent.exchange import LogExchange
from agent.frames.swarm import SwarmFrames
from agent.fusion.engine import Fusion
from agent.fusion.estimator import Hypothesis, Outlook
from agent.fusion.registry import estimator_named
from agent.guidance import Moment
from agent.memory import Memory
from agent.mission import FLYING, Mission, Situation
from agent.navigator import Navigator
from agent.observer import Observer
from agent.peers import Peers
from agent.problems import TELEMETRY_AGE_NS, TWIN_NS, Problems
from agent.reporter import Condition, Outbox, Reporter
from agent.search import CoverageLog, InformedSearch, Prospect, Search, conclusion
from agent.vehicle.interface import GnssFix, Request, SeenDrone, VehicleCommand, VehicleState
from agent.whereabouts import Whereabouts, plausible
from protocol.codec import decode_from
from protocol.errors import ProtocolError
from protocol.keys import parse_key
from protocol.messages import (
    Action,
    AnyMessage,
    Command,
    Cone,
    Coverage,
    Entry,
    Estimate,
    Frame,
    Plan,
    Pose,
    Stage,
    Status,
)

_NEWS = (Pose, Plan, Estimate, Status)
COMMAND_AGE_NS = 10_000_000_000  # an older command is not carried out


class Step(Struct, frozen=True):
    """What a step yields: payloads to publish under their keys, and what the autopilot is to do."""

    publications: list[tuple[str, bytes]]
    command: VehicleCommand


class Pilot:
    """One drone's mission, from the start command to the landing."""

    def __init__(
        self,
        mission: MissionConfig,
        drone: DroneConfig,
        boot: str,
        listeners: Sequence[str] = (),
        memory: Memory | None = None,
    ) -> None:
        """Set up a drone.

        Args:
            mission: the same on every drone.
            drone: this one.
            boot: 16 hex digits, new at every start of the agent.
            listeners: estimators that fuse the same log without any say in the flight.
            memory: of the agent that flew this drone before; the flight goes on if telemetry shows it in the air.

        Raises:
            ConfigError: the drone is not one of the mission's.
            DetectorError: its camera's calibration cannot be read.
        """
        ids = [member.id for member in mission.drones]
        member = next((member for member in mission.drones if member.id == drone.id), None)
        if member is None:
            raise ConfigError(f"drone {drone.id!r} is not in the mission; its drones are {', '.join(ids)}")
        self._config = mission
        self._id = drone.id
        self._boot = boot
        self._mission_id = mission.mission_id
        self._mission = Mission(mission.track, mission.survey, can_lose=mission.fusion.estimator != "given")
        self.counters: Counter[str] = Counter()
        self._observer = Observer(drone, self._mission_id, boot)
        history, numbers = self._observer.history, self._observer.numbers
        epoch_offset = memory.epoch_offset if memory is not None else 0
        self._where = Whereabouts(mission, member, boot, history, numbers, self.counters, epoch_offset)
        frames = self.frames.graph
        self.fusion = Fusion(mission, frames)
        self.listeners = {name: Fusion(mission, frames, estimator_named(name, mission)) for name in listeners}
        calibration = load_calibration(Path(drone.calibration)) if drone.calibration else Calibration.nominal()
        self._watch = NuclideWatch(mission.nuclide)
        self._chain = DetectorChain(mission.detection, mission.nuclide, calibration, self._watch.add)
        self._peers = Peers([name for name in ids if name != drone.id])
        self._search = Search(mission, drone.id, frames, lambda: self.fusion.log.entries(Coverage))
        self._coverage = CoverageLog(mission.survey.lane_spacing_m)
        self._prospect = Prospect(lambda: self.fusion.outlook)
        self._navigator = Navigator(mission, drone, frames, self._search, InformedSearch(mission, self._prospect))
        self._finding = ""
        self._vehicle: VehicleState | None = None
        self._last_cone_ns = 0
        self._remembered = memory  # until telemetry has shown what it is worth
        self.memory = memory
        self._problems = Problems(drone.id, self._mission_id)
        self._exchange = LogExchange(mission.swarm, self.fusion.log, self.counters)
        self._outbox = Outbox(mission.swarm, self.counters)
        self._reporter = Reporter(drone.id, self._mission_id, boot, mission.fusion.estimator)

    @property
    def stage(self) -> Stage:
        """What the drone is doing."""
        return self._mission.stage

    @property
    def frames(self) -> SwarmFrames:
        """Where the local frames of all drones lie in the mission frame."""
        return self._where.frames

    @property
    def hypothesis(self) -> Hypothesis | None:
        """Where the source is believed to be; mission frame."""
        return self.fusion.hypothesis

    @property
    def outlook(self) -> Outlook | None:
        """What is known while there is no hypothesis."""
        return self.fusion.outlook

    @property
    def finding(self) -> str:
        """What the search has ended with, where it has found nothing; else empty."""
        return self._finding

    @property
    def digest(self) -> str:
        """Digest of the log, 32 hex digits."""
        return self.fusion.digest

    def warn(self, problems: tuple[str, ...]) -> None:
        """Take what the operator has to know of this drone, in place of what was given before."""
        self._problems.warned = problems

    def block(self, problems: tuple[str, ...]) -> None:
        """Take what stands against a start besides what the pilot sees by itself, in place of what was given before."""
        self._problems.blocked = problems

    def log_summary(self) -> bytes:
        """What the log holds: a request for what it lacks, to be answered by the others' ``log_answer``."""
        return self._exchange.summary()

    def log_answer(self, request: bytes) -> list[tuple[str, bytes]]:
        """Keys and payloads of log entries that the asker lacks; a bounded number, the oldest first."""
        return self._exchange.answer(request)

    def observe_vehicle(self, state: VehicleState) -> None:
        """Take the newest telemetry. What is older than known, not finite or absurdly far away is counted and dropped."""
        if self._vehicle is not None and state.stamp_ns <= self._vehicle.stamp_ns:
            self.counters["telemetry_older_than_known"] += 1
            return
        if not plausible(state):
            self.counters["telemetry_implausible"] += 1
            return
        state = self._where.understood(state)
        self._vehicle = state
        self._observer.history.add(state)
        self._navigator.follow(state)
        if self._remembered is not None:
            self._rejoin(self._remembered, state)

    def observe_detector(self, readout: Readout) -> list[tuple[str, bytes]]:
        """Take what the camera saw. Returns what it becomes, log entries of this drone, to be published at once."""
        for entry in self._observer.observe(self._chain.process(readout)):
            self._record(entry, readout.end_ns)
        self._watch.look(readout.end_ns)
        self._problems.noticed = self._watch.problems
        self.counters["pixel_hits_lost"] = self._chain.lost_hits
        self.counters["detections_dropped"] = self._observer.dropped
        return self._outbox.take()

    def observe_fix(self, fix: GnssFix) -> list[tuple[str, bytes]]:
        """Take what a satellite receiver says. Returns the log entry that it becomes, to be published at once."""
        entry = self._where.positioning.fix(fix)
        if entry is not None:
            self._record(entry, entry.stamp_ns)
        return self._outbox.take()

    def observe_sightings(self, seen: Sequence[SeenDrone]) -> list[tuple[str, bytes]]:
        """Take what sensors have seen of the other drones. Returns what it becomes, log entries, to be published at once."""
        for sight in seen:
            entry = self._where.positioning.sighting(sight)
            if entry is not None:
                self._record(entry, entry.stamp_ns)
                self._peers.see(entry)
        return self._outbox.take()

    def receive(self, key: str, payload: bytes, now_ns: int) -> None:
        """Take a message from the mesh. Whatever is wrong with it is counted and dropped, never raised."""
        try:
            message = decode_from(key, payload)
            swarm = parse_key(key).swarm
        except ProtocolError:
            self.counters["rejected_malformed"] += 1
            return
        if swarm != self._config.swarm:
            self.counters["dropped_other_swarm"] += 1
            return
        reason = self._dispatch(message, payload, now_ns)
        if reason is not None:
            self.counters[f"dropped_{reason}"] += 1

    def advance(self, now_ns: int) -> None:
        """Fold what came in, so that the hypothesis rests on it without waiting for the next step.

        Costs nearly nothing when nothing came in; much at once is folded in slices over several calls.
        """
        self.frames.advance(now_ns)
        self.fusion.advance(now_ns)
        for listener in self.listeners.values():
            listener.advance(now_ns)

    def step(self, now_ns: int) -> Step:
        """Decide: fold the log, move on in the mission, plan, and report. To be called at 20 Hz or more."""
        self.advance(now_ns)
        before = self._mission.stage
        self._conclude(now_ns)
        self._mission.step(self._situation(now_ns))
        if self._mission.stage is not before:
            self._reporter.hurry(now_ns)
        self._remember(now_ns)
        command = self._command(now_ns)
        self._report(now_ns)
        return Step(self._outbox.take(), command)

    def _dispatch(self, message: AnyMessage, payload: bytes, now_ns: int) -> str | None:
        if isinstance(message, Command):
            return self._obey(message, now_ns)
        if isinstance(message, Entry):
            self._fold(message, payload, now_ns)
            return None
        if message.drone == self._id:
            if isinstance(message, Status) and message.boot != self._boot and abs(now_ns - message.stamp_ns) < TWIN_NS:
                self._problems.hear_twin(now_ns)
            return "own_id"
        if isinstance(message, Status):
            self._where.clocks.hear(message, now_ns)  # however old its stamp seems
        if isinstance(message, Frame):
            return None  # for onlookers: every agent derives the frames from its own log
        if isinstance(message, _NEWS):
            return self._peers.receive(message, now_ns)
        return "unused"

    def _obey(self, command: Command, now_ns: int) -> str | None:
        if command.mission != self._mission_id:
            return "command_of_another_mission"
        if command.drones and self._id not in command.drones:
            return None
        if abs(now_ns - command.stamp_ns) > COMMAND_AGE_NS:
            return "command_too_old"
        self._problems.unplaced = self._where.is_unplaced
        problems = self._problems.against_start(now_ns, self._vehicle, self._peers.statuses(now_ns))
        situation = replace(self._situation(now_ns), problems=problems)
        refused = self._mission.command(command.action, command.stamp_ns, situation)
        if refused is not None:
            return "command_refused"
        if command.action is Action.START and self._vehicle is not None:
            self._navigator.home.took_off(self._vehicle)
            self._start_fusion(command.stamp_ns)
        return None

    def _start_fusion(self, started_ns: int) -> None:
        self.frames.start(started_ns)
        for fusion in (self.fusion, *self.listeners.values()):
            fusion.start(started_ns)

    def _rejoin(self, memory: Memory, vehicle: VehicleState) -> None:
        """Go on with the flight that is remembered, or forget it where the vehicle is on the ground."""
        fits = memory.fits(self._mission_id, vehicle)
        if fits is None:
            return
        self._remembered = None
        if not fits:
            self.counters["memory_void"] += 1
            return
        self.counters["rejoined"] += 1
        self._mission.rejoin(memory, vehicle, vehicle.stamp_ns)
        self._navigator.home.remember(memory.home_m)
        self._start_fusion(memory.started_ns)

    def _remember(self, now_ns: int) -> None:
        """Keep what a restarted agent must know: the same object as long as nothing in it changes."""
        if self._remembered is None:
            memory = self._mission.memory(self._mission_id, self._navigator.home.in_mission, now_ns, self._where.epoch_offset)
            if memory != self.memory:
                self.memory = memory

    def _record(self, entry: Entry, now_ns: int) -> None:
        """Publish an entry of this drone and keep it, by the very bytes that the others get."""
        payload = self._outbox.put(entry)
        if payload is not None:
            self._fold(entry, payload, now_ns)

    def _fold(self, entry: Entry, payload: bytes, now_ns: int) -> None:
        if not self.fusion.receive(entry, payload):
            return
        self._where.take(entry)
        for listener in self.listeners.values():
            listener.receive(entry, payload)
        if isinstance(entry, Cone):
            self._last_cone_ns = max(self._last_cone_ns, min(entry.stamp_ns, now_ns))
        elif isinstance(entry, Coverage) and entry.drone == self._id and entry.boot != self._boot:
            self._search.divide_anew()  # of this drone before its agent was restarted

    def _situation(self, now_ns: int) -> Situation:
        vehicle = self._vehicle
        at_home = self._mission.stage is Stage.RETURN and vehicle is not None and self._navigator.home.is_reached(vehicle)
        hypothesis = self.hypothesis
        return Situation(
            now_ns,
            vehicle,
            hypothesis is not None,
            self._last_cone_ns,
            at_home,
            rms_m=hypothesis.sight_of(self._id).rms_m if hypothesis is not None and hypothesis.evidence is not None else None,
            nothing_found=self._finding != "",
        )

    def _conclude(self, now_ns: int) -> None:
        """Say that nothing was found once that is so, and until something is."""
        if self.hypothesis is not None:
            self._finding = ""
        elif self._mission.stage is Stage.SURVEY:
            found = conclusion(self._config.survey, self._mission.searched_s(now_ns), self._prospect.at(now_ns))
            if found and not self._finding:
                self._reporter.hurry(now_ns)
            self._finding = found or self._finding

    def _command(self, now_ns: int) -> VehicleCommand:
        """What the autopilot is to do. A drone that does not know where it is, or in which frame, holds."""
        request = self._mission.request
        height_m = self._config.survey.height_m
        vehicle = self._vehicle
        if request is not Request.OFFBOARD or vehicle is None:
            self._navigator.rest()
            return VehicleCommand(request, takeoff_height_m=height_m)
        if abs(now_ns - vehicle.stamp_ns) > TELEMETRY_AGE_NS:  # of the future: this computer's clock was set back
            self._navigator.rest()
            self.counters["held_without_telemetry"] += 1
            return VehicleCommand(Request.HOLD)
        stage = self._mission.stage
        moment = Moment(now_ns, stage, self._mission.since_ns, vehicle, self.hypothesis)
        setpoint, plan = self._navigator.step(moment, self._peers)
        if self._navigator.waits:
            self.counters["waited_without_frame"] += 1
        if plan is not None:
            self._outbox.put(plan)
        if stage is Stage.SURVEY:
            self._report_coverage(now_ns, vehicle)
        return VehicleCommand(request, setpoint, height_m)

    def _report_coverage(self, now_ns: int, vehicle: VehicleState) -> None:
        report = self._coverage.add(now_ns, vehicle.epoch, vehicle.position_m[:2])
        if report is not None:
            self._record(self._observer.coverage(*report, self._coverage.swath_m), now_ns)

    def _report(self, now_ns: int) -> None:
        believed = (self.hypothesis, self.fusion.digest) if self.hypothesis is not None else None
        vehicle, condition = self._vehicle, partial(self._condition, now_ns)
        for message in self._reporter.due(now_ns, vehicle, self._where.frame(vehicle), believed, condition):
            self._outbox.put(message)

    def _condition(self, now_ns: int) -> Condition:
        self._problems.seen = self._where.problems(now_ns, self._vehicle, self._mission.stage in FLYING)
        self._problems.unplaced = self._where.is_unplaced
        problems = self._problems.all(now_ns, self._vehicle, self._peers.statuses(now_ns))
        delays_ns = self._where.clocks.delays_ns(now_ns)
        return Condition(self._mission.stage, dict(self.counters), problems, self._finding, self._watch.message, delays_ns)
