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
from radron.agent.mission.uploads import Origin
from radron.agent.pilot import Pilot
from radron.protocol.keys import VERSION
from radron.protocol.signing import Trust

_PACKAGES = ("radron", "numpy", "scipy", "osqp", "shapely", "msgpack", "msgspec")


class Recording(Struct, frozen=True, kw_only=True):
    """The part of a header that is readable in each version of the protocol. Version 1 did not name itself."""

    protocol: int = 1
    versions: dict[str, str] = {}

    def check_protocol(self, file: Path) -> None:
        """Raise FlightRecordError if the messages are of another version of the protocol."""
        if self.protocol == VERSION:
            return
        text = f"{file}: recorded with version {self.protocol} of the protocol, here {VERSION}"
        if self.protocol < VERSION:
            raise FlightRecordError(f"{text}: no release reads it")
        raise FlightRecordError(f"{text}: read it with the radron that recorded it ({self.versions.get('radron', 'unknown')})")


class FlightHeader(Struct, frozen=True, kw_only=True):
    """``calibration``: contents of the camera's calibration files by name, empty for the nominal camera. ``versions``: of the
    packages used. ``protocol``: version of the messages. ``certificate``: of the drone (DER), empty in a swarm without;
    ``authority``: of the swarm (PEM). ``nonce_key``: of this boot's nonces; worthless once it has ended. ``origin``: of a mission
    that an operator has uploaded; None: of the mission file. ``deferred``: whether a slow estimator was computed in another
    process. ``tells_obeyed``: whether the statuses state the last order obeyed; in older records they do not.
    ``judges_exposures``: whether exposures that overlap or are too long do not count; in older records they did. ``tables``:
    version of the tables of a camera's counts; empty in older records.
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
        """Header of a flight that begins at ``started_ns`` (UTC).

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
            protocol=VERSION,
            certificate=trust.certificate if trust is not None else b"",
            authority=trust.authority_pem if trust is not None else "",
            nonce_key=nonce_key,
            origin=origin,
            deferred=deferred,
            tells_obeyed=True,
            judges_exposures=True,
            tables=tables_version(),
        )

    def check_tables(self, file: Path) -> None:
        """Raise FlightRecordError if the estimates were computed with other tables of a camera's counts."""
        if self.tables not in ("", tables_version()):
            release = self.versions.get("radron", "unknown")
            text = f"{file}: recorded with other tables of what a camera counts"
            raise FlightRecordError(f"{text}: replay it with the radron that recorded it ({release})")

    def pilot(self, folder: Path, trust: Trust | None = None) -> Pilot:
        """The pilot as it was constructed; ``folder``: where the calibration may be written; ``trust``: its signatures."""
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
            tells_obeyed=self.tells_obeyed,
            judges_exposures=self.judges_exposures,
        )


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from a source tree
            found[package] = "unknown"
    return found
