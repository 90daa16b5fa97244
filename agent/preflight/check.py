"""The preflight check: everything is connected, nothing is commanded, and each finding is "ok", "not yet" or "failed"."""

from __future__ import annotations

import asyncio
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.detector.channels import Channels
from radron.agent.detector.drivers import open_detector
from radron.agent.detector.files.calibration import PIXELS, load_flight_calibration
from radron.agent.detector.readout import Detector
from radron.agent.errors import DetectorError, RadronError
from radron.agent.outputs import try_folder
from radron.agent.pilot import Pilot
from radron.agent.preflight.background import Background
from radron.agent.preflight.chrony import NAME as CHRONY
from radron.agent.preflight.chrony import chrony_finding
from radron.agent.preflight.corrections import Corrections
from radron.agent.preflight.layers import layers_finding
from radron.agent.preflight.layout import layout_finding
from radron.agent.preflight.software import software_finding
from radron.agent.sensing.sighting_feed import SightingsFeed
from radron.agent.shell.identity import INSECURE, own_identity, validity
from radron.agent.shell.links import mesh_config, without
from radron.agent.shell.missionstore import mission_in_force
from radron.agent.shell.revoked import RevokedFile
from radron.agent.shell.startable import camera_missing
from radron.agent.shell.statestore import StateFile, unreadable
from radron.agent.vehicle.demands import demands_of
from radron.agent.vehicle.interface import Finding
from radron.agent.vehicle.px4 import Px4Vehicle
from radron.protocol.codec import decode_from
from radron.protocol.codes import Code
from radron.protocol.errors import ProtocolError
from radron.protocol.identity import utc
from radron.protocol.mesh.diagnosis import refusals
from radron.protocol.mesh.session import Mesh
from radron.protocol.messages import Status
from radron.protocol.signing import Verifier

CLOSE_S = 1.2
_OLDEST_CLOCK_S = 1_735_689_600.0  # 2025: a computer without a clock battery begins in 1970 or at its image's date
_CLOCKS_S = 0.5  # allowed difference of two drones' clocks, by which poses and cones are stamped
_LEAST_FREE_MB = 200
_LINKS_S = 3.0  # between two looks at why there is no contact


class Preflight:
    """The preflight check of one drone: it connects everything, commands nothing, and collects findings.

    ``findings`` may be read at any time; after the check they stay as at its end.
    """

    def __init__(
        self,
        drone: DroneConfig,
        mission: MissionConfig,
        background: Background | None = None,
        corrections: Corrections | None = None,
    ) -> None:
        """Set up the check.

        ``background``: also count the camera's background; ``corrections``: also set wrong parameters of the autopilot.
        """
        self._background, self._corrections = background, corrections
        self._drone = drone
        self._force = mission_in_force(drone, mission)
        self._mission = mission = self._force.mission
        self._mission_finding, self._state_finding, self._space_finding = self._flyable(), self._state(), self._space()
        self._vehicle_findings = [Finding("autopilot", "not yet", f"connecting to {drone.vehicle.address}")]
        self._camera = Finding("camera", "not yet", "no readout so far")
        self._chrony = Finding(CHRONY, "not yet", "asking")
        self._seen: set[str] = set()  # drones reported by the sensor for relative observations
        self._sightings: Finding | None = None  # None: there is no such sensor
        if drone.sightings.address is not None:
            self._sightings = Finding("sightings", "not yet", f"connecting to {drone.sightings.address}")
        self._mesh_finding = Finding("mesh", "not yet", "opening")
        self._mesh: Mesh | None = None
        self._verifier: Verifier | None = None  # of statuses; None: the swarm has no certificates
        self._refusals: dict[str, str] = {}  # by endpoint, why certificates prevent a link
        self._statuses: dict[str, tuple[Status, float]] = {}  # with the delay of its stamp, seconds
        self._last: list[Finding] | None = None  # None: the check has not ended

    @property
    def findings(self) -> list[Finding]:
        """The present findings of the preflight check, and after its end the last ones."""
        return self._present() if self._last is None else self._last

    def _present(self) -> list[Finding]:
        layer = layers_finding(self._mission, self._drone.id)
        software = software_finding(self._drone.updates)
        return [
            self._mission_finding,
            *([] if layer is None else [layer]),
            *([] if software is None else [software]),
            self._certificate(),
            *self._revoked(),
            self._calibration(),
            self._state_finding,
            self._space_finding,
            self._clock(),
            self._chrony,
            self._camera,
            *([] if self._sightings is None else [self._sightings]),
            *self._vehicle_findings,
            self._mesh_finding,
            *(self._peer(member.id) for member in self._mission.drones if member.id != self._drone.id),
        ]

    async def run(self, wait_s: float, show: Callable[[list[Finding]], None]) -> bool:
        """Check until no finding is "not yet" or is being corrected, for ``wait_s`` at most. Return whether all are "ok".

        show: called with the present findings, several times a second.
        """
        checks = (self._check_mesh, self._check_vehicle, self._check_camera, self._check_sightings, self._check_chrony)
        tasks = [asyncio.create_task(check()) for check in checks]
        deadline_s = time.monotonic() + wait_s
        try:
            while time.monotonic() < deadline_s and any(map(self._may_change, self.findings)):
                show(self.findings)
                await asyncio.sleep(0.2)
        finally:
            self._last = self._present()  # before its links close: afterwards every drone would count as missing
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        show(self._last)
        return all(finding.verdict == "ok" for finding in self._last)

    def _may_change(self, finding: Finding) -> bool:
        if finding.verdict == "failed" and self._corrections is not None:
            return self._corrections.tries(finding.name)
        return finding.verdict == "not yet"

    async def _check_mesh(self) -> None:
        try:
            known = frozenset(one.member for one in RevokedFile(self._drone.state, self._drone.id).load())
            config = without(known - {self._drone.id}, mesh_config(self._drone, self._mission), self._drone)
            self._verifier = Verifier(config.identity.authority) if config.identity is not None else None
            self._mesh = await Mesh.open(config, self._mission.swarm, self._drone.id, receive=self._receive)
        except (RadronError, ProtocolError) as error:
            self._mesh_finding = Finding("mesh", "failed", str(error))
            return
        links = "encrypted" if config.identity is not None else "not encrypted"
        self._mesh_finding = Finding("mesh", "ok", f"{config.listen}, {links}")
        try:
            while True:
                endpoints = self._drone.mesh.endpoints
                away = [endpoints[member.id] for member in self._mission.drones if member.id in self._away & endpoints.keys()]
                self._refusals = await refusals(config.identity, away, time.time_ns())
                await asyncio.sleep(_LINKS_S)
        finally:
            async with asyncio.timeout(CLOSE_S):
                await self._mesh.close()

    @property
    def _away(self) -> frozenset[str]:
        """The drones with which there is no contact."""
        alive = self._mesh.alive if self._mesh is not None else frozenset[str]()
        return frozenset(member.id for member in self._mission.drones) - alive - {self._drone.id}

    def _receive(self, key: str, payload: bytes) -> None:
        try:
            message = decode_from(key, payload)
        except ProtocolError:
            return
        if isinstance(message, Status) and (self._verifier is None or self._verifier.accepts_status(message)):
            self._statuses[message.drone] = message, (time.time_ns() - message.stamp_ns) * 1e-9

    def _peer(self, name: str) -> Finding:
        endpoint = self._drone.mesh.endpoints.get(name, "no endpoint given")
        if name in self._away and endpoint in self._refusals:
            return Finding(name, "failed", self._refusals[endpoint])
        if self._mesh is None or name not in self._mesh.alive:
            return Finding(name, "not yet", f"no contact ({endpoint})")
        if name not in self._statuses:
            return Finding(name, "not yet", "in contact, no status so far")
        status, behind_s = self._statuses[name]
        if status.mission != self._mission.mission_id:
            return Finding(name, "failed", f"has another mission: {status.mission}")
        if abs(behind_s) > _CLOCKS_S:
            return Finding(name, "failed", f"its clock differs by {behind_s:+.1f} s from ours: synchronise both by one server")
        notices = "".join(f"; {text}" for text in status.texts.notices if text.code == Code.UPDATE_FAILED)
        return Finding(name, "ok", f"{status.stage}, the same mission {status.mission}{notices}")

    async def _check_vehicle(self) -> None:
        vehicle = Px4Vehicle(demands_of(self._mission, self._drone, sets=False))
        correcting: asyncio.Task[None] | None = None
        try:
            await vehicle.connect()
            if self._corrections is not None:
                correcting = asyncio.create_task(self._corrections.run(vehicle))
            while True:
                layout = layout_finding(self._mission, self._drone.id, vehicle.launch)
                self._vehicle_findings = [*await vehicle.findings(), *([layout] if layout is not None else [])]
                await asyncio.sleep(0.2)
        except RadronError as error:
            self._vehicle_findings = [Finding("autopilot", "failed", str(error))]
        finally:
            if correcting is not None:
                correcting.cancel()
            await vehicle.close()

    async def _check_camera(self) -> None:
        detector: Detector | None = None
        try:
            detector = open_detector(self._drone.detector)
            if detector is None:
                missing = camera_missing(self._drone, self._mission)
                text = "none configured, and none needed: the mission's hypothesis is given"
                self._camera = Finding("camera", "ok", text) if missing is None else Finding("camera", "failed", missing)
                return
            watching = asyncio.create_task(self._watch_camera(detector))
            table = self._mission.table(self._drone.id)
            channels = None if table is None else Channels(self._drone.detector, table)
            async for readout in detector.readouts():
                if channels is not None:
                    channels.detections(readout)
                elif readout.counts is not None:
                    raise DetectorError("it sends counts instead of pixel hits; correct detector.kind in mission and drone file")
                if self._background is not None:
                    self._camera = self._background.take(readout)
                else:
                    seen = f"{len(readout.hits)} pixel hits" if readout.counts is None else f"{readout.counts.sum()} counts"
                    self._camera = Finding("camera", "ok", f"{seen} in {readout.live_time_s:.1f} s")
            watching.cancel()
        except RadronError as error:
            self._camera = Finding("camera", "failed", str(error))
        finally:
            if detector is not None:
                await detector.close()

    async def _check_chrony(self) -> None:
        while True:
            self._chrony = await chrony_finding(alone=len(self._mission.drones) == 1)
            await asyncio.sleep(1.0)

    async def _watch_camera(self, detector: Detector) -> None:
        while True:
            if detector.problems:
                self._camera = Finding("camera", "not yet", detector.problems[0])
            await asyncio.sleep(0.2)

    async def _check_sightings(self) -> None:
        if self._drone.sightings.address is None:
            return
        try:
            feed = SightingsFeed(self._drone.sightings.address)
        except RadronError as error:
            self._sightings = Finding("sightings", "failed", str(error))
            return
        reading = asyncio.create_task(self._read_sightings(feed))
        try:
            while True:
                names = ", ".join(sorted(self._seen)) or "none"
                problem = feed.problems[0] if feed.problems else None
                self._sightings = Finding("sightings", "not yet" if problem else "ok", problem or f"drones seen so far: {names}")
                await asyncio.sleep(0.2)
        finally:
            reading.cancel()
            await feed.close()

    async def _read_sightings(self, feed: SightingsFeed) -> None:
        async for seen in feed.sightings():
            self._seen.update(one.target for one in seen)

    def _flyable(self) -> Finding:
        """Whether a pilot can be built for the mission, which is the only complete check of nuclide, estimator and survey."""
        if self._force.fault is not None:
            return Finding("mission", "failed", self._force.fault)
        try:
            Pilot(self._mission, replace(self._drone, calibration=None), boot="0" * 16, nonce_key=b"")
        except RadronError as error:
            return Finding("mission", "failed", str(error))
        text = f"{self._mission.name}, {self._mission.mission_id}, {len(self._mission.drones)} drones, {_over(self._mission)}"
        return Finding("mission", "ok", text if self._force.notice is None else f"{text}; {self._force.notice}")

    def _state(self) -> Finding:
        if self._drone.state is None:
            return Finding("state", "ok", "not kept: no folder configured, so an agent that restarts in flight does not resume")
        file = StateFile(self._drone.state, self._drone.id)
        try:
            try_folder(file.path.parent)
        except OSError as error:
            return Finding("state", "failed", f"{file.path.parent}: cannot be written to: {error.strerror}")
        try:
            memory = file.load().memory
        except (OSError, msgspec.MsgspecError) as error:
            return Finding("state", "failed", unreadable(file, error))
        if memory is not None and memory.mission != self._mission.mission_id:
            return Finding("state", "ok", f"{file.path} (of another mission, {memory.mission}: will be replaced)")
        return Finding("state", "ok", str(file.path))

    def _calibration(self) -> Finding:
        folder = self._drone.calibration
        response = self._mission.response(self._drone.id)
        if response is not None:
            return Finding("calibration", "ok", f"table of response {response.name}, digest {response.digest}")
        if folder is None:
            return Finding("calibration", "ok", "that of the nominal camera: no folder configured")
        try:
            calibration = load_flight_calibration(Path(folder))
        except RadronError as error:
            return Finding("calibration", "failed", str(error))
        bad = f"; {calibration.bad_pixels:,} of {PIXELS:,} pixels are masked" if calibration.bad_pixels else ""
        return Finding("calibration", "ok", folder + bad)

    def _space(self) -> Finding:
        folder = self._drone.recorder.folder
        if folder is None:
            return Finding("flight records", "ok", "none: no recorder.folder configured")
        try:
            try_folder(Path(folder))
            free_mb = shutil.disk_usage(folder).free // 1_000_000
        except OSError as error:
            return Finding("flight records", "failed", f"{folder}: cannot be written to: {error.strerror}")
        if free_mb < _LEAST_FREE_MB:
            return Finding("flight records", "failed", f"{free_mb} MB free at {folder}: at least {_LEAST_FREE_MB} are needed")
        return Finding("flight records", "ok", f"{free_mb} MB free at {folder}, {self._drone.recorder.limit_mb} may be used")

    def _certificate(self) -> Finding:
        try:
            identity = own_identity(self._drone)
        except (RadronError, ProtocolError) as error:
            return Finding("certificate", "failed", str(error))
        if identity is None:
            return Finding("certificate", "ok", f"none: {INSECURE}")
        state = validity(identity, time.time_ns())
        return Finding("certificate", "ok", state.text) if state.fault is None else Finding("certificate", "failed", state.fault)

    def _revoked(self) -> list[Finding]:
        """Members revoked by the authority or an operator."""
        file = RevokedFile(self._drone.state, self._drone.id)
        known = file.load()
        if file.problem is not None:
            return [Finding("revoked", "failed", file.problem)]
        told = [f"{one.member} by {one.station}, {utc(one.stamp_ns):%Y-%m-%d %H:%M} UTC" for one in known]
        with suppress(RadronError, ProtocolError):  # reported by the finding of the certificate
            identity = own_identity(self._drone)
            told += [f"{name} by the authority" for name in sorted(identity.revoked.names if identity is not None else ())]
        is_itself = any(one.member == self._drone.id for one in known)
        return [Finding("revoked", "failed" if is_itself else "ok", ", ".join(told))] if told else []

    def _clock(self) -> Finding:
        now_s = time.time()
        text = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(now_s))
        if now_s < _OLDEST_CLOCK_S:
            return Finding("clock", "failed", f"{text}: set it, or synchronise it to a time server")
        return Finding("clock", "ok", text)


def _over(mission: MissionConfig) -> str:
    """Return the ground that the mission states, and what this means for its sources."""
    if mission.fusion.ground == "none":
        return 'over an empty ground (fusion.ground = "none")'
    lowest_m, highest_m = mission.source_height_m
    return "over soil" if lowest_m == highest_m else "over soil: the errors of sources above the ground are larger than stated"
