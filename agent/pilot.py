"""The brain of one drone: what it hears, sees and measures goes in, messages and a command come out.

The same pilot flies in lockstep, live and in a replay: once made it does no I/O, reads no clock and draws no random numbers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from msgspec import Struct

from agent.conduct import Conduct
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
from agent.knowledge import Knowledge
from agent.memory import Memory
from agent.mission import FLYING
from agent.observer import Observer
from agent.peers import Peers
from agent.problems import TWIN_NS, Problems
from agent.reporter import Condition, Outbox, Reporter
from agent.vehicle.interface import GnssFix, SeenDrone, VehicleCommand, VehicleState
from agent.whereabouts import Whereabouts
from protocol.codec import decode_from
from protocol.errors import ProtocolError
from protocol.keys import parse_key
from protocol.messages import (
    AnyMessage,
    Command,
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
LONGEST_MISSION_NS = 86_400_000_000_000  # who says to have flown for longer has a wrong clock
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
        self._swarm, self._mission_id = mission.swarm, mission.mission_id
        self._id, self._boot = drone.id, boot
        self.counters: Counter[str] = Counter()
        self._knowledge = Knowledge(mission, listeners)
        self._observer = Observer(drone, self._mission_id, boot)
        history, numbers = self._observer.history, self._observer.numbers
        epoch_offset = memory.epoch_offset if memory is not None else 0
        self._where = Whereabouts(mission, member, boot, self.frames, history, numbers, self.counters, epoch_offset)
        calibration = load_calibration(Path(drone.calibration)) if drone.calibration else Calibration.nominal()
        self._watch = NuclideWatch(mission.nuclide)
        self._chain = DetectorChain(mission.detection, mission.nuclide, calibration, self._watch.add)
        self._peers = Peers([name for name in ids if name != drone.id])
        self._conduct = Conduct(mission, drone, self._knowledge, self._where, self.counters, memory)
        self._problems = Problems(drone.id, self._mission_id)
        self._exchange = LogExchange(mission.swarm, self.fusion.log, self.counters)
        self._outbox = Outbox(mission.swarm, self.counters)
        self._reporter = Reporter(drone.id, self._mission_id, boot, mission.fusion.estimator)

    @property
    def stage(self) -> Stage:
        """What the drone is doing."""
        return self._conduct.stage

    @property
    def memory(self) -> Memory | None:
        """What an agent that is restarted must know: the same object as long as nothing in it changes."""
        return self._conduct.memory

    @property
    def frames(self) -> SwarmFrames:
        """Where the local frames of all drones lie in the mission frame."""
        return self._knowledge.frames

    @property
    def fusion(self) -> Fusion:
        """The log and the estimator that is flown by."""
        return self._knowledge.fusion

    @property
    def listeners(self) -> Mapping[str, Fusion]:
        """Further estimators on the same log, by name."""
        return self._knowledge.listeners

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
        return self._conduct.finding

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
        vehicle = self._where.follow(state)
        if vehicle is not None:
            self._conduct.follow(vehicle)

    def observe_detector(self, readout: Readout) -> list[tuple[str, bytes]]:
        """Take what the camera saw. Returns what it becomes, log entries of this drone, to be published at once."""
        for entry in self._observer.observe(self._chain.process(readout)):
            self._record(entry, readout.end_ns)
        self._watch.look(readout.end_ns)
        self._problems.noticed = (*self._chain.noise.problems, *self._observer.problems, *self._watch.problems)
        self.counters["pixel_hits_lost"] = self._chain.lost_hits
        self.counters["pixel_hits_of_noise"] = self._chain.noise.masked_hits
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
        if swarm != self._swarm:
            self.counters["dropped_other_swarm"] += 1
            return
        reason = self._dispatch(message, payload, now_ns)
        if reason is not None:
            self.counters[f"dropped_{reason}"] += 1

    def advance(self, now_ns: int) -> None:
        """Fold what came in, so that the hypothesis rests on it without waiting for the next step.

        Costs nearly nothing when nothing came in; much at once is folded in slices over several calls.
        """
        self._knowledge.advance(now_ns)

    def step(self, now_ns: int) -> Step:
        """Decide: fold the log, move on in the mission, plan, and report. To be called at 20 Hz or more."""
        self.advance(now_ns)
        stage, finding = self.stage, self.finding
        act = self._conduct.step(now_ns, self._peers)
        if self.stage is not stage or (self.finding and not finding):
            self._reporter.hurry(now_ns)
        if act.plan is not None:
            self._outbox.put(act.plan)
        if act.searched is not None:
            self._record(self._observer.coverage(*act.searched, self._conduct.swath_m), now_ns)
        if self._where.is_estimated:
            for entry in self._observer.unseen(now_ns):
                self._record(entry, now_ns)
        self._report(now_ns)
        return Step(self._outbox.take(), act.command)

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
        problems = self._problems.against_start(now_ns, self._where.vehicle, self._peers.statuses(now_ns))
        begun_ns = self._begun_ns(command.stamp_ns, now_ns)
        obeyed = self._conduct.obey(command.action, command.stamp_ns, begun_ns, now_ns, problems)
        return None if obeyed else "command_refused"

    def _begun_ns(self, stamp_ns: int, now_ns: int) -> int:
        """When the swarm's mission began for a drone that is started by a command of that stamp: with those that fly it already,
        so that all leave out the same of what was measured before.
        """
        statuses = self._peers.statuses(now_ns).values()
        begun = (status.started_ns for status in statuses if status.mission == self._mission_id)
        return min((stamp_ns, *(began for began in begun if began is not None and now_ns - began < LONGEST_MISSION_NS)))

    def _record(self, entry: Entry, now_ns: int) -> None:
        """Publish an entry of this drone and keep it, by the very bytes that the others get."""
        payload = self._outbox.put(entry)
        if payload is not None:
            self._fold(entry, payload, now_ns)

    def _fold(self, entry: Entry, payload: bytes, now_ns: int) -> None:
        if not self._knowledge.take(entry, payload, now_ns):
            return
        self._where.take(entry)
        if isinstance(entry, Coverage) and entry.drone == self._id and entry.boot != self._boot:
            self._conduct.divide_anew()  # of this drone before its agent was restarted

    def _report(self, now_ns: int) -> None:
        believed = (self.hypothesis, self.fusion.digest) if self.hypothesis is not None else None
        vehicle, condition = self._where.vehicle, partial(self._condition, now_ns)
        for message in self._reporter.due(now_ns, vehicle, self._where.frame, believed, condition):
            self._outbox.put(message)

    def _condition(self, now_ns: int) -> Condition:
        self._problems.seen = self._where.problems(now_ns, self.stage in FLYING)
        self._problems.unplaced = self._where.is_unplaced
        problems = self._problems.all(now_ns, self._where.vehicle, self._peers.statuses(now_ns))
        delays_ns = self._where.clocks.delays_ns(now_ns)
        began_ns, seen = self._conduct.started_ns, self._watch.message
        return Condition(self.stage, dict(self.counters), problems, self.finding, seen, delays_ns, began_ns)
