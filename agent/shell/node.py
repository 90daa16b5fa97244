"""The process of one drone: Zenoh, PX4 and the camera connected to the pilot, in one event loop.

All calls of the pilot are made in the loop's thread: messages, telemetry and readouts as they arrive, a step every 50 ms.
Setpoints are only sent by the step that computed them, so that the autopilot notices when the steps stop.

An exception in a handler of messages, telemetry or readouts is logged, once for each kind, and counted; the flight continues. An
exception in the pilot's step leaves an unknown state behind: it ends the agent, the autopilot's failsafe takes over, and the
service manager restarts the agent, which then rejoins the flight.
"""

from __future__ import annotations

import asyncio
import gc
import os
import time
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator
from functools import partial

import msgspec

from radron.agent.config.drone import DetectorConfig, DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.detector.drivers import open_detector
from radron.agent.detector.readout import Detector, shed
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.ownclock import OwnClock
from radron.agent.pilot import Pilot
from radron.agent.sensing.sighting_feed import SightingsFeed
from radron.agent.shell.aboard import aboard
from radron.agent.shell.faultbarrier import FaultBarrier
from radron.agent.shell.folding import Folding
from radron.agent.shell.heartbeat import RELOADING, Heartbeat
from radron.agent.shell.identity import INSECURE, Validity, validity
from radron.agent.shell.links import mesh_config, without
from radron.agent.shell.logs import Logger
from radron.agent.shell.memory import MemoryWatch
from radron.agent.shell.missionstore import InForce
from radron.agent.shell.patience import Patience
from radron.agent.shell.problems import LateSteps, Problems, no_contact
from radron.agent.shell.revoked import RevokedFile, exclude, turn_s
from radron.agent.shell.selfreport import SelfReport, Updates, report_of
from radron.agent.shell.startable import camera_missing
from radron.agent.shell.statestore import State, StateStore
from radron.agent.shell.uploads import UploadedMission
from radron.agent.vehicle.demands import demands_of
from radron.agent.vehicle.interface import GnssFix
from radron.agent.vehicle.px4 import Px4Vehicle
from radron.protocol.codec import encode
from radron.protocol.codes import Code
from radron.protocol.identity import Identity
from radron.protocol.keys import key_of
from radron.protocol.mesh.recovery import recover
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Stage
from radron.protocol.stages import ON_GROUND
from radron.protocol.texts import CodedText, coded

PERIOD_S = 0.05
ADVANCE_S = 0.02  # between two slices of work on the log, however many bursts of messages come
LOOK_S = 0.5  # between two checks for problems
CLOSE_S = 1.2
MOST_HITS = 20_000  # in a readout; ten times as many, of a noisy camera, would block the loop for too long
COUNTERS_S = 10.0
DetectorOf = Callable[[DetectorConfig, OwnClock], Detector | None]


class Node:
    """The process of one drone, from its start to its end: network, autopilot and camera are connected to the pilot program."""

    def __init__(
        self,
        drone: DroneConfig,
        filed: MissionConfig,
        force: InForce,
        heartbeat: Heartbeat,
        log: Logger,
        detector_of: DetectorOf = open_detector,
        patience: Patience | None = None,
    ) -> None:
        """Prepare the process; nothing is connected yet.

        ``filed``: the mission in the mission file; ``force``: the mission flown. ``heartbeat``: reports every step.
        ``detector_of``: opens the camera; a test replaces it. ``patience``: waits for the autopilot; None: ends without it.
        """
        self._drone, self._clock = drone, OwnClock()
        self._force, self._mission = force, force.mission
        self._uploaded = UploadedMission(drone, filed, log)
        self._heartbeat, self._log = heartbeat, log
        self._detector_of, self._patience = detector_of, patience or Patience(heartbeat)
        self._barrier = FaultBarrier(log)
        self._memory = MemoryWatch()
        self._store = StateStore(drone.state, drone.id, log)
        self._revoked_file = RevokedFile(drone.state, drone.id)
        self._stage: Stage | None = None
        self._has_jumped = False  # the localisation, in flight, without an announcement
        self._late = LateSteps()
        self._advanced_s = float("-inf")  # when the log was last worked on
        self._tasks: list[asyncio.Task[None]] = []
        self._closers: list[Callable[[], Coroutine[None, None, None]]] = []
        self.counters: Counter[str] = Counter()
        self._pilot: Pilot | RecordedPilot
        self._problems: Problems
        self._folding: Folding
        self._mesh: Mesh
        self._vehicle: Px4Vehicle
        self._detector: Detector | None = None
        self._sightings: SightingsFeed | None = None
        self._recorder: FlightRecorder | None = None
        self._unrecorded: CodedText | None = None  # why a wanted recorder is missing
        self._identity: Identity | None = None  # None: links are not encrypted
        self._self_report, self._updates = SelfReport.here(), Updates(drone.updates)

    async def run(self) -> None:
        """Fly until cancelled, or until a new mission or a rebooted autopilot needs a new start.

        Raises:
            RadronError, ProtocolError: an error for the user to fix: no vehicle, a port in use, no camera module.
            Exception: the pilot's step failed.
        """
        try:
            await self._open()
            await self._fly()
        finally:
            self._heartbeat.rest()
            await self._close()

    async def _open(self) -> None:
        """Open everything in order; after a failure ``run`` closes the parts already open."""
        boot = os.urandom(8).hex()
        saved = self._store.load()
        links = mesh_config(self._drone, self._mission)
        self._identity = links.identity
        made = aboard(self._drone, self._force, boot, saved, self._identity, self._log)
        self._pilot, self._recorder, self._folding = made.pilot, made.recorder, made.folding
        self._unrecorded, self._problems = made.unrecorded, Problems(made.pilot, self._log)
        for before in self._revoked_file.passed_on(time.time_ns()):
            self._pilot.receive(key_of(self._mission.swarm, before), encode(before), self._now_ns())
        contained = self._barrier.call
        self._detector = self._detector_of(self._drone.detector, self._clock)
        if self._detector is not None:
            self._closers.append(self._detector.close)
        if self._drone.sightings.address is not None:
            self._sightings = SightingsFeed(self._drone.sightings.address, self._clock.now_ns, self._clock)
            self._closers.append(self._sightings.close)
        revoked = self._revoked()
        self._mesh = await Mesh.open(
            without(revoked, links, self._drone),
            self._mission.swarm,
            self._drone.id,
            receive=contained("messages", lambda key, payload: self._pilot.receive(key, payload, self._now_ns()), None),
            drained=contained("log entries", self._advance, None),
            answer=contained("log queries", self._pilot.log_answer, []),
            members=frozenset(member.id for member in self._mission.drones),
        )
        self._closers += [self._mesh.close, self._uploaded.close]
        self._log.info("mesh is up", boot=boot, mission=self._mission.mission_id, encrypted=self._identity is not None)
        demands = demands_of(self._mission, self._drone, sets=True)
        launch = saved.launch_in(self._mission.mission_id)
        self._vehicle = Px4Vehicle(demands, launch, self._clock.now_ns, self._frame_is_exact, utc=self._clock)
        self._closers.append(self._vehicle.close)
        self._vehicle.on_state(contained("telemetry", self._pilot.observe_vehicle, None))
        self._publish = contained("publications", self._mesh.publish, None)
        if self._wants_fixes:
            self._vehicle.on_fix(contained("fixes", self._take_fix, None))
        report = partial(report_of, boot, self._pilot, self._mesh, self._vehicle)
        self._start("the report", partial(self._self_report.run, report))
        self._start("the estimator's process", self._folding.run)
        await self._patience.until(self._vehicle.connect)  # the mesh stays up meanwhile
        self._log.info("vehicle is connected", address=self._drone.vehicle.address)
        if self._detector is not None:
            self._start("the camera", partial(self._read, self._detector))
        if self._sightings is not None:
            self._start("the sightings sensor", partial(self._see, self._sightings))
        self._start("recovery of the log", self._recover)
        self._start("the links of revoked members", partial(self._exclude, revoked, links))
        self._send_command = contained("commands", self._vehicle.command, None)
        gc.collect()
        gc.freeze()  # a full collection would take 0.1 s in flight, and these objects stay
        self._heartbeat.tell("READY=1")

    async def _close(self) -> None:
        """Close everything that is open, concurrently and within ``CLOSE_S``."""
        for task in self._tasks:
            task.cancel()
        closing = [*self._tasks, *(close() for close in self._closers)]
        if self._recorder is not None:
            closing.append(asyncio.to_thread(self._recorder.close))
        try:
            async with asyncio.timeout(CLOSE_S):
                outcomes = await asyncio.gather(*closing, return_exceptions=True)
        except TimeoutError:
            self._log.error("not everything could be closed in time")
            return
        for outcome in outcomes:
            if isinstance(outcome, Exception):
                self._log.error("not closed cleanly", error=repr(outcome))

    async def _fly(self) -> None:
        """Make a step every 50 ms by absolute deadlines. Missed steps are skipped and counted, never made up for.

        Ends when the agent is to start anew, only on the ground: with a new mission, or after a reboot of the autopilot that
        followed a flight. After such a reboot the vehicle's local frame has changed, and the launch place is measured again.
        """
        loop = asyncio.get_running_loop()
        due_s = look_s = counters_s = loop.time()
        while not self._uploaded.is_kept and not self._lost_its_frame:
            now_s = loop.time()
            if now_s >= look_s:
                look_s = now_s + LOOK_S
                self._look()
            if now_s >= counters_s:
                counters_s = now_s + COUNTERS_S
                self._log_counters()
            self._step()
            due_s += PERIOD_S
            behind_s = loop.time() - due_s
            if behind_s > 0.0:
                missed = int(behind_s / PERIOD_S) + 1
                due_s += missed * PERIOD_S
                self.counters["steps_left_out"] += missed
                self._late.note(behind_s)
            await asyncio.sleep(due_s - loop.time())
        self._heartbeat.tell(RELOADING)

    @property
    def _lost_its_frame(self) -> bool:
        if not self._vehicle.has_rebooted or self._pilot.stage not in ON_GROUND:
            return False
        launch = self._vehicle.launch_to_keep  # an unflown vehicle measures its launch place anew anyway
        return launch is not None and launch.flown

    def _log_counters(self) -> None:
        tasks = len(asyncio.all_tasks())
        counters = {"node": self.counters, "mesh": self._mesh.counters, "pilot": self._pilot.counters}
        self._log.debug("counters", pid=os.getpid(), tasks=tasks, **counters)

    def _now_ns(self) -> int:
        """Return the own time; the pilot learns of a clock step before it is given the time."""
        now_ns = self._clock.now_ns()
        self._pilot.observe_clock(self._clock.look(), now_ns)
        return now_ns

    def _advance(self) -> None:
        """Work new log entries into the hypothesis before the next step."""
        now_s = time.monotonic()
        if now_s - self._advanced_s >= ADVANCE_S:
            self._pilot.advance(self._now_ns())
            self._advanced_s = time.monotonic()

    def _step(self) -> None:
        """Make one step and send its results. Nothing computed before a stall is sent."""
        self._heartbeat.check()
        before = self._pilot.memory
        step = self._pilot.step(self._now_ns())
        self._heartbeat.beat()
        self._send_command(step.command)
        for key, payload in step.publications:
            self._publish(key, payload)
        if self._pilot.memory is not before:
            self._save()
        stage = self._pilot.stage
        if stage is not self._stage:
            self._log.info("stage", stage=str(stage), before=str(self._stage))
            memory = self._pilot.memory
            if memory is not None and memory.response is not None:
                self._log.info("identified response of the vehicle", **msgspec.structs.asdict(memory.response))
            self._heartbeat.tell(f"STATUS={stage}")
            self._stage = stage

    async def _read(self, detector: Detector) -> None:
        observe = self._barrier.call("readouts", self._pilot.observe_detector, [])
        async for readout in detector.readouts():
            self._self_report.readout()
            for key, payload in observe(shed(readout, MOST_HITS)):
                self._publish(key, payload)

    async def _see(self, sensor: SightingsFeed) -> None:
        observe = self._barrier.call("sightings", self._pilot.observe_sightings, [])
        async for seen in sensor.sightings():
            for key, payload in observe(seen):
                self._publish(key, payload)

    def _take_fix(self, fix: GnssFix) -> None:
        for key, payload in self._pilot.observe_fix(fix):
            self._publish(key, payload)

    @property
    def _wants_fixes(self) -> bool:
        """Whether fixes are useful: this drone's frame is estimated, and the mission has a geodetic datum."""
        return not self._frame_is_exact and self._mission.datum is not None

    @property
    def _frame_is_exact(self) -> bool:
        return next(member.is_exact for member in self._mission.drones if member.id == self._drone.id)

    async def _recover(self) -> None:
        members = [member.id for member in self._mission.drones]
        phase = members.index(self._drone.id) / len(members)
        counted, peers = self._pilot.counters, lambda: self._mesh.alive & set(members)
        await recover(peers, self._pilot.log_summary, self._mesh.ask, phase, lambda: counted["dropped_put_off"])

    def _revoked(self) -> frozenset[str]:
        return frozenset(one.member for one in self._pilot.revocations) - {self._drone.id}

    async def _exclude(self, revoked: frozenset[str], links: MeshConfig) -> None:
        async def reopen(names: frozenset[str]) -> None:
            if self._identity is not None and self._identity.own.not_after_ns < time.time_ns():
                self._log.error(
                    "revoked members keep their links: this drone's certificate has ended, and it could make none anew"
                )
                return
            self._log.warning("mesh is opened anew", without=sorted(names))
            await self._mesh.reopen(without(names, links, self._drone))
            self._log.info("mesh is up again", alive=sorted(self._mesh.alive))

        members = [member.id for member in self._mission.drones]
        await exclude(self._revoked, revoked, reopen, turn_s(members.index(self._drone.id), len(members)))

    def _start(self, kind: str, work: Callable[[], Coroutine[None, None, None]]) -> None:
        self._tasks.append(asyncio.create_task(self._barrier.work(kind, work), name=kind))

    def _look(self) -> None:
        """Pass changed problems on to the pilot, take an uploaded mission, and save the state for a restart."""
        self._uploaded.look(self._pilot.taking, self._mesh.fetch_mission, self._pilot.decline)
        self._updates.look(self._pilot.stage)
        expiry = validity(self._identity, time.time_ns()) if self._identity is not None else None
        self._problems.tell(self._warnings(), self._faults(expiry), self._notices(expiry))
        self._revoked_file.save(self._pilot.revocations)
        self._save()

    def _save(self) -> None:
        memory, launch = self._pilot.memory, self._vehicle.launch_to_keep
        # After an unannounced jump an agent restarted on the ground could not detect that its frame has changed.
        self._has_jumped = self._has_jumped or (memory is not None and memory.epoch_offset != 0)
        if launch is not None:
            flown = launch.flown and not (self._has_jumped and memory is None)
            booted_ns = None if launch.booted_ns is None else self._clock.of(launch.booted_ns)
            launch = msgspec.structs.replace(launch, mission=self._mission.mission_id, flown=flown, booted_ns=booted_ns)
        self._store.save(State(memory=memory, launch=launch))

    def _warnings(self) -> Iterator[CodedText | None]:
        yield from no_contact(self._drone, self._mission, self._mesh.alive)
        for part in (self._mesh, self._sightings, self._recorder, self._barrier, self._memory):
            yield from part.problems if part is not None else ()
        if self._detector is None:
            yield camera_missing(self._drone, self._mission)
        else:  # may be a driver of another package
            yield from coded(Code.CAMERA_DRIVER, self._detector.problems)
        yield from self._late.problems

    def _faults(self, expiry: Validity | None) -> Iterator[CodedText | None]:
        """Yield the faults that prevent a start."""
        yield from self._vehicle.problems
        yield from (self._unrecorded, self._store.problem, self._revoked_file.problem)
        yield expiry.fault if expiry is not None else None
        yield from (self._force.fault, self._updates.problem, self._folding.problem)
        yield from self._mesh.differing

    def _notices(self, expiry: Validity | None) -> Iterator[CodedText | None]:
        yield self._updates.notice
        yield INSECURE if expiry is None else expiry.notice
        yield from (self._vehicle.exposure, self._force.notice)
