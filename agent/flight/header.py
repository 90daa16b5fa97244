"""The header of a flight's records: all inputs from which its pilot was constructed."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
from msgspec import Struct

from radron.agent.computing import Computing
from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.detector.files.calibration import calibration_files
from radron.agent.errors import ConfigError, FlightRecordError
from radron.agent.fusion.countstables import tables_version
from radron.agent.fusion.registry import deferred_named, estimator_named
from radron.agent.mission.memory import Memory
from radron.agent.mission.rules import Rules
from radron.agent.mission.uploads import Origin
from radron.agent.pilot import Pilot
from radron.protocol.signing import Trust
from radron.protocol.versions import PROTOCOL

_PACKAGES = ("radron", "numpy", "scipy", "osqp", "shapely", "msgpack", "msgspec")


class Recording(Struct, frozen=True, kw_only=True):
    """The part of a flight record's header that can be read in each version of the protocol. Version 1 did not name itself."""

    protocol: int = 1
    versions: dict[str, str] = {}

    def check_protocol(self, file: Path) -> None:
        """Raise FlightRecordError if the messages in the record are of another version of the protocol than this release's."""
        if self.protocol == PROTOCOL:
            return
        text = f"{file}: recorded with version {self.protocol} of the protocol, here {PROTOCOL}"
        if self.protocol < PROTOCOL:
            raise FlightRecordError(f"{text}: no release reads it")
        raise FlightRecordError(f"{text}: read it with the radron that recorded it ({self.versions.get('radron', 'unknown')})")


class FlightHeader(Struct, frozen=True, kw_only=True):
    """The header of a flight's record: all inputs from which the flight's pilot program was made, so that a replay can make it
    again.

    ``calibration``: contents of the camera's calibration files by name, empty for the nominal camera. ``versions``: of the
    packages used. ``protocol``: version of the messages. ``certificate``: of the drone (DER), empty in a swarm without
    certificates; ``authority``: certificate of the swarm's authority (PEM). ``nonce_key``: key of this run's nonces (numbers that
    commands must carry); worthless once the run has ended. ``origin``: of a mission that an operator has uploaded; None: the
    mission is from the mission file. ``deferred``: whether a slow estimator was computed in another process. ``tells_obeyed``,
    ``tells_codes``, ``judges_exposures``: see ``Rules``; False in older records. ``tables``: version of the tables of a camera's
    counts; empty in older records.
    """

    mission: MissionConfig
    drone: DroneConfig
    boot: str
    started_ns: int
    memory: Memory | None = None
    calibration: dict[str, str] = {}
    versions: dict[str, str] = {}
    protocol: int
    certificate: bytes = b""
    authority: str = ""
    nonce_key: bytes = b""
    origin: Origin | None = None
    deferred: bool = False
    tells_obeyed: bool = False
    tells_codes: bool = False
    judges_exposures: bool = False
    tables: str = ""

    @classmethod
    def of(
        cls,
        mission: MissionConfig,
        drone: DroneConfig,
        boot: str,
        started_ns: int,
        memory: Memory | None = None,
        trust: Trust | None = None,
        origin: Origin | None = None,
        *,
        nonce_key: bytes,
        deferred: bool = False,
    ) -> FlightHeader:
        """Return the header for a flight that begins at ``started_ns`` (UTC), with the contents of the calibration files.

        Raises:
            ConfigError: a calibration file cannot be read.
        """
        calibration = {}
        for path in calibration_files(Path(drone.calibration)) if drone.calibration else ():
            try:
                calibration[path.name] = path.read_text(encoding="utf-8")
            except (OSError, UnicodeDecodeError) as error:
                raise ConfigError(f"{path}: cannot be read: {error}") from None
        return cls(
            mission=mission,
            drone=drone,
            boot=boot,
            started_ns=started_ns,
            memory=memory,
            calibration=calibration,
            versions=_versions(),
            protocol=PROTOCOL,
            certificate=trust.certificate if trust is not None else b"",
            authority=trust.authority_pem if trust is not None else "",
            nonce_key=nonce_key,
            origin=origin,
            deferred=deferred,
            tells_obeyed=True,
            tells_codes=True,
            judges_exposures=True,
            tables=tables_version(),
        )

    def check_tables(self, file: Path) -> None:
        """Raise FlightRecordError if the source estimates were computed with other tables of camera counts than this
        release has.
        """
        if self.tables not in ("", tables_version()):
            release = self.versions.get("radron", "unknown")
            text = f"{file}: recorded with other tables of what a camera counts"
            raise FlightRecordError(f"{text}: replay it with the radron that recorded it ({release})")

    def pilot(self, folder: Path, trust: Trust | None = None) -> Pilot:
        """Return the pilot program as it was made at the beginning of the flight.

        ``folder``: where the calibration files may be written; ``trust``: its keys and certificates.
        """
        files = [folder / Path(name).name for name in self.calibration]
        for file, text in zip(files, self.calibration.values(), strict=True):
            file.write_text(text, encoding="utf-8")
        calibration = None if not files else str(files[0] if len(files) == 1 else folder)
        drone = msgspec.structs.replace(self.drone, calibration=calibration)
        computing = Computing(deferred_named if self.deferred else estimator_named)
        inputs = self.mission, drone, self.boot, (), self.memory, trust
        return Pilot(
            *inputs,
            nonce_key=self.nonce_key,
            computing=computing,
            rules=Rules(self.tells_obeyed, self.tells_codes, self.judges_exposures),
        )


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from a source tree
            found[package] = "unknown"
    return found
