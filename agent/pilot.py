"""The pilot program of one drone: messages, telemetry and readouts go in; messages and a vehicle command come out.

All times that the pilot is given are own time (``owntime``), and so are the stamps of telemetry, readouts, fixes and sightings.
Messages have stamps in UTC. The same pilot flies in lockstep, live and in a replay: once made, it does no I/O, reads no clock
and draws no random numbers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.computing import ALONE, Computing
from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.detector.readout import Readout
from radron.agent.frames.drift import Drift
from radron.agent.frames.swarm import SwarmFrames
from radron.agent.fusion.engine import Fusion
from radron.agent.fusion.estimator import Hypothesis, Outlook
from radron.agent.fusion.exchange import LogExchange
from radron.agent.fusion.posterior import Posterior
from radron.agent.fusion.proofs import Proofs
from radron.agent.localization.clocks import LIMIT_S, Clocks
from radron.agent.localization.ownpose import OwnPose, Whereabouts
from radron.agent.mission.commanding import Commanding, Verdict
from radron.agent.mission.executive import Executive
from radron.agent.mission.memory import Memory
from radron.agent.mission.news import News
from radron.agent.mission.orders import Orders
from radron.agent.mission.problems import Problems
from radron.agent.mission.reporter import Outbox
from radron.agent.mission.revoking import Revoking
from radron.agent.mission.rules import PRESENT, Rules
from radron.agent.mission.telling import Telling
from radron.agent.mission.worldmodel import WorldModel
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.reckoning import Reckoning
from radron.agent.sensing.numbering import Numbering
from radron.agent.sensing.observer import Observer
from radron.agent.sensing.own import own_detector
from radron.agent.sensing.positionsensors import NOT_LOGGED, PositionSensors
from radron.agent.vehicle.interface import GnssFix, SeenDrone, VehicleCommand, VehicleState
from radron.protocol.entries import Coverage, Entry
from radron.protocol.errors import ProtocolError
from radron.protocol.keys import parse_key
from radron.protocol.messages import AnyDroneMessage, Order, Stage, Ticket, Upload
from radron.protocol.revocations import Revocation, Revoked
from radron.protocol.signing import Trust, Verifier
from radron.protocol.texts import CodedText


class Step(Struct, frozen=True):
    """Result of one step of the pilot: messages to publish, as pairs of key and payload, and the command for the autopilot."""

    publications: list[tuple[str, bytes]]
    command: VehicleCommand


class Pilot:
    """The program that flies one drone through a mission, from the start command to the landing.

    It makes no I/O: the caller passes in measurements and messages, and gets messages and commands back. From a pixel hit to a
    setpoint, in the order of the methods below: ``observe_detector`` turns hits into log entries, ``_record`` signs, publishes
    and logs them, and ``receive`` logs the entries of other drones; ``advance`` updates the drones' frames and the source
    estimate (hypothesis) with the new entries; ``step`` plans the flight by them.
    """

    def __init__(
        self,
        mission: MissionConfig,
        drone: DroneConfig,
        boot: str,
        listeners: Sequence[str] = (),
        memory: Memory | None = None,
        trust: Trust | None = None,
        *,
        nonce_key: bytes,
        computing: Computing = ALONE,
        rules: Rules = PRESENT,
    ) -> None:
        """Set up the pilot program of one drone.

        Args:
            mission: the mission file's content, equal on every drone.
            drone: the drone file's content.
            boot: 16 hex digits, new at every start of the agent.
            listeners: estimators that fuse the log, too, without influence on the flight.
            memory: from the agent that flew this drone before; the flight continues if telemetry shows the drone in the air.
            trust: signs this drone's messages and verifies other drones' messages; None: in a swarm without certificates.
            nonce_key: 16 random bytes, new at every start of the agent: from them follow the nonces (random numbers) that
                commands need.
            computing: computations that depend on their inputs alone.
            rules: those of the release that wrote a record, for its replay.

        Raises:
            ConfigError: the mission does not contain the drone, or has it with another kind of detector.
            DetectorError: the camera's calibration cannot be read.
        """
        ids, member = [member.id for member in mission.drones], mission.member(drone.id)
        self._swarm, self._mission_id, self._id, self._boot = mission.swarm, mission.mission_id, drone.id, boot
        self._read, self.counters = computing.read, Counter[str]()
        estimators, frame_estimates = computing.estimators, computing.frame_estimates
        self._world = WorldModel(mission, listeners, estimators, frame_estimates, judges_exposures=rules.judges_exposures)
        others, epoch_offset = [name for name in ids if name != drone.id], memory.epoch_offset if memory is not None else 0
        self._clocks = Clocks(drone.id, others)
        self._utc = utc = self._clocks.utc
        memory = memory.in_utc() if memory is not None else None
        graph, speed_mps = self.frames.graph, mission.limits.speed_mps
        self._told = Stage.PREFLIGHT, False  # stage, and whether the search has ended
        self._own = OwnPose(member, graph, self._clocks, self.counters, speed_mps, Drift(mission), epoch_offset)
        history, self._numbers = self._own.history, Numbering(utc)
        self._observer = Observer(drone, mission, boot, history, self._numbers, self._own.carried, utc)
        self._sensors = PositionSensors(drone.id, others, self._mission_id, boot, history, self._numbers, self.counters, utc)
        self._detector, self._peers = own_detector(mission, drone, self._observer, self.counters), Peers(others)
        self._executive = Executive(mission, drone, self._world, self._own, self.counters, memory, self._clocks)
        self._problems = Problems(drone.id, self._mission_id, mission.safety.battery_reserve)
        verifier = Verifier(trust.authority, trust.revoked, computing.signed_root) if trust is not None else None
        self._orders = Orders(drone.id, self._mission_id, nonce_key, verifier, utc, rules.tells_obeyed)
        parts = self._executive, self._problems, self._own, self._peers, self.counters
        self._commanding = Commanding(self._mission_id, self._orders, *parts, utc)
        affected = self._world, self._executive, self._peers, self._problems, self.counters
        self._revoking = Revoking((drone.id, boot), trust, verifier, *affected, utc)
        self._proofs = Proofs(ids, (drone.id, self._mission_id, boot), trust, verifier, self._revoking.leaves_out)
        self._exchange = LogExchange(mission.swarm, drone.id, self.fusion.log, self.counters)
        self._outbox = Outbox(mission.swarm, self.counters)
        judged_by = self._peers, self._clocks, self._proofs, self._revoking, self._problems, self._outbox.sent
        self._news = News(drone.id, boot, *judged_by)
        seen = self._problems, self._world, self._own, self._clocks, self._detector, self._peers, self._proofs, self._executive
        told = mission, drone.id, boot, self._outbox, self.counters, self._orders, self._commanding, self._revoking
        self._telling = Telling(*told, *seen, tells_codes=rules.tells_codes)

    def observe_clock(self, ahead_ns: int, now_ns: int) -> None:
        """Take the time (ns) by which UTC, by the computer's clock, is ahead of the agent's own time, which never jumps.

        It is 0 at first, and another value after each step of the computer's clock. After a step the other drones are told at
        once: the next status has a stamp by the new time.
        """
        if ahead_ns == self._utc.ahead_ns:
            return
        step_ns = self._clocks.set_own(ahead_ns, now_ns)
        self._numbers.clock_step(step_ns, now_ns)
        if abs(step_ns) > 1e9 * LIMIT_S:  # less is drift, and not corrected by the peers
            self._telling.hurry(now_ns)

    def observe_vehicle(self, state: VehicleState) -> None:
        """Take the autopilot's newest telemetry. Telemetry not newer, not finite or out of range is counted and dropped."""
        if (vehicle := self._own.take(state)) is not None:
            self._executive.follow(vehicle)

    def observe_detector(self, readout: Readout) -> list[tuple[str, bytes]]:
        """Take the data of one interval from the detector. Return the resulting log entries as key and payload, to be
        published at once.
        """
        self._record(self._detector.observe(readout), readout.end_ns)
        return self._outbox.take()

    def observe_fix(self, fix: GnssFix) -> list[tuple[str, bytes]]:
        """Take a position by satellites. Return the resulting log entry as key and payload, to be published at once."""
        if (entry := self._sensors.fix(fix)) is not None:
            self._record([entry], fix.stamp_ns)
        return self._outbox.take()

    def observe_sightings(self, seen: Sequence[SeenDrone]) -> list[tuple[str, bytes]]:
        """Take relative observations of other drones. Return the resulting log entries as keys and payloads, to be published at
        once.
        """
        entries = [entry for sighting in seen if (entry := self._sensors.sighting(sighting)) is not None]
        logged = [entry for entry in entries if entry.sequence != NOT_LOGGED]
        self._record(logged, max((self._utc.own_ns(entry.stamp_ns) for entry in logged), default=0))
        for entry in entries:
            self._peers.see(replace(entry, stamp_ns=self._utc.own_ns(entry.stamp_ns)))
        return self._outbox.take()

    def _record(self, entries: Sequence[Entry], now_ns: int) -> None:
        """Sign entries of this drone, publish them, and log them, from the same bytes that the peers get."""
        sendable = [read for entry in entries if (read := self._outbox.sendable(entry)) is not None]
        for entry in self._proofs.signed(sendable, self._utc.of(now_ns)):
            if (payload := self._outbox.put(entry)) is not None:
                self._fold(entry, payload, now_ns)

    def _fold(self, entry: Entry, payload: bytes, now_ns: int) -> None:
        if not self._world.take(entry, payload, now_ns):
            self._revoking.recount(entry)
            return
        self._own.take_entry(entry)
        if isinstance(entry, Coverage):
            self._executive.take_coverage(entry, anew=entry.drone == self._id and entry.boot != self._boot)  # before a restart

    def receive(self, key: str, payload: bytes, now_ns: int) -> Verdict | None:
        """Take a message from the radio network. An invalid message is counted and dropped, never raised.

        Return the verdict on a command to this drone, or on a new revocation (withdrawal of a member's rights); None for all
        other messages.
        """
        try:
            address = parse_key(key)  # unchanged if the mesh has parsed it already
            message = self._read(address, payload)
        except ProtocolError:
            self.counters["rejected_malformed"] += 1
            return None
        if address.swarm != self._swarm:
            self.counters["dropped_other_swarm"] += 1
            return None
        if isinstance(message, Order):
            answered = self._commanding.uploads.answer
            verdict = self._commanding.judge(message, now_ns)
            if self._commanding.uploads.answer is not answered:
                self._telling.hurry(now_ns)  # before the shell begins anew
            return verdict
        if isinstance(message, Revocation | Revoked):
            return self._revoking.hear(message, now_ns)
        if (reason := self._dispatch(message, payload, now_ns)) is not None:
            self.counters[f"dropped_{reason}"] += 1
        return None

    def _dispatch(self, message: AnyDroneMessage, payload: bytes, now_ns: int) -> str | None:
        if isinstance(message, Entry):
            if not self._world.admission.admits(message, now_ns):
                return "put_off"
            for entry, content in self._proofs.proven(message, payload, now_ns):
                self._fold(entry, content, now_ns)
            return None
        dropped = self._news.hear(message, now_ns)
        if self._news.pressing:
            self._telling.hurry(now_ns)
        return dropped

    def log_summary(self) -> bytes:
        """Return a summary of this drone's observation log, by which other drones (``log_answer``) find the entries that it
        lacks.
        """
        return self._exchange.summary()

    def log_answer(self, request: bytes) -> list[tuple[str, bytes]]:
        """Return log entries that another drone lacks, as keys and payloads: a bounded number.

        request: the summary of that drone's log (``log_summary``).
        """
        return self._exchange.answer(request)

    def advance(self, now_ns: int) -> None:
        """Process new log entries, so that the source estimate includes them before the next step; many entries take several
        calls.
        """
        self._news.step(now_ns)
        self._numbers.note(now_ns)
        self._world.advance(now_ns, self._clocks.followed_ns(now_ns))

    def step(self, now_ns: int) -> Step:
        """Advance the mission by one step: process the log, choose the stage, plan the flight, and report. Call it at 20 Hz or
        more.
        """
        self._take_back(now_ns)
        self.advance(now_ns)
        before = self._told
        act = self._executive.step(now_ns, self._peers)
        self._told = self.stage, self.finding is not None
        if self._told != before:
            self._telling.hurry(now_ns)
        if act.plan is not None:
            self._outbox.put(self._utc.stamped(act.plan))
        entries: list[Entry] = [self._observer.coverage(*act.searched, self._executive.swath_m)] if act.searched else []
        if self._own.tells_frame:
            entries += self._observer.unseen(now_ns)
        self._record(entries, now_ns)
        self._telling.tell(now_ns)
        return Step(self._outbox.take(), act.command)

    def _take_back(self, now_ns: int) -> None:
        """Take back measurements with wrong times or places. Called in a step, whose record holds the signature for a replay."""
        if not self._clocks.is_doubted and (wrong := self._numbers.wrong()) is not None:
            self._sensors.begin_anew()
            self._record([self._observer.taken_back(now_ns, *wrong)], now_ns)
        if (span_ns := self._own.elsewhere()) is not None:
            self._observer.drop_until(span_ns[1])
            self._sensors.drop_until(span_ns[1])
            if (doubted := self._numbers.since(span_ns[0])) is not None:
                self._record([self._observer.retraction(now_ns, *doubted)], now_ns)

    def warn(self, problems: tuple[CodedText, ...]) -> None:
        """Set the warnings that the surrounding process (the shell) has for the operator. They replace its previous warnings."""
        self._problems.warned = problems

    def block(self, problems: tuple[CodedText, ...]) -> None:
        """Set the problems that the surrounding process (the shell) found, and that prevent a start. They replace its previous
        problems.
        """
        self._problems.blocked = problems

    def ticket(self, now_ns: int) -> Ticket:
        """Return the ticket for the next command to this drone (a nonce and a number that the command must carry), as in its
        status.
        """
        return self._orders.ticket(now_ns)

    def notice(self, notices: tuple[CodedText, ...]) -> None:
        """Set the notices of the surrounding process (the shell) to the operator, which are no problems of this flight.

        They replace its previous notices.
        """
        self._telling.notice(notices)

    @property
    def taking(self) -> Upload | None:
        """The uploaded mission that the surrounding process (the shell) must fetch, keep and restart with; None if there
        is none.
        """
        return self._commanding.uploads.taking

    def decline(self, reason: str) -> None:
        """Report to the operator the reason why an uploaded mission was refused."""
        self._commanding.uploads.decline(reason)

    @property
    def stage(self) -> Stage:
        """The present stage of the mission, such as preflight, survey or encirclement."""
        return self._executive.stage

    @property
    def memory(self) -> Memory | None:
        """State from which an agent that is restarted in flight continues. The same object is returned as long as nothing in it
        changes.
        """
        return self._executive.remembering.memory

    @property
    def frames(self) -> SwarmFrames:
        """The estimated local frames of all drones in the mission frame."""
        return self._world.frames

    @property
    def fusion(self) -> Fusion:
        """The observation log, together with the estimator by which the drone flies."""
        return self._world.fusion

    @property
    def listeners(self) -> Mapping[str, Fusion]:
        """Further estimators that use the observation log but do not influence the flight, by name."""
        return self._world.listeners

    @property
    def hypothesis(self) -> Hypothesis | None:
        """The source estimate by which the drone flies, in the mission frame; None before there is one."""
        return self.fusion.hypothesis

    @property
    def outlook(self) -> Outlook | None:
        """The posterior of the search: where a source may still be, see ``Outlook``; None without one."""
        return self.fusion.outlook

    def posteriors(self, now_ns: int) -> dict[str, Posterior]:
        """Return the posteriors of all estimators that have one, by name: of the flight's estimator, and of the further ones
        (listeners).
        """
        return self._world.posteriors(self._utc.of(now_ns))

    @property
    def pending(self) -> bool:
        """Whether frames and source estimate still lack entries of the log, because entries are processed in slices."""
        return self._world.pending

    @property
    def backlog_s(self) -> float:
        """Time (s) for which received entries have been waiting to be included in frames or source estimate."""
        return self._world.backlog_s

    @property
    def finding(self) -> CodedText | None:
        """The result of a search that ended without finding a source; None in all other cases."""
        return self._executive.finding

    @property
    def digest(self) -> str:
        """Hash over the content of the observation log, 32 hex digits; equal on drones with equal logs."""
        return self.fusion.digest

    @property
    def revocations(self) -> tuple[Revocation, ...]:
        """The members revoked during this flight (rights withdrawn). The same object is returned until a revocation is added."""
        return self._revoking.held

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Problems of this drone, as published in its last status."""
        return self._telling.told

    @property
    def whereabouts(self) -> Whereabouts | None:
        """This drone's estimate of its own position in the mission frame; None without one."""
        return self._own.whereabouts

    @property
    def reckoning(self) -> Reckoning | None:
        """Assumptions about the other drones under which the last plan was made; None while the agent is not in command."""
        return self._executive.reckoning
