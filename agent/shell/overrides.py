"""Loading of a drone file: with overrides from the environment, and with paths relative to its own folder.

``RADRON_`` and the key's path in upper case, with ``__`` for the dot: ``RADRON_ID``, ``RADRON_MESH__LISTEN``,
``RADRON_VEHICLE__ADDRESS``. A value is read as TOML, otherwise as a string. So one file serves many containers.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.config.loading import convert, load_mission, read_toml
from radron.agent.config.mission import MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.shell.startable import check_for_drone

PREFIX = "RADRON_"
# Variables of other commands, whose environment an agent may be started in: the simulation's, and an operator's.
NOT_OURS = ("RADRON_SIM_", "RADRON_PKI_PASSPHRASE", "RADRON_IDENTITY")


def load_drone(path: Path, environment: Mapping[str, str]) -> tuple[DroneConfig, MissionConfig]:
    """Read a drone file, with overrides from environment variables, and the mission file that it names.

    Raises:
        ConfigError: unreadable, not TOML, unknown keys, values out of range, in the file or in the environment; no mission given;
            a mission without this drone, with an unknown estimator, or with unusable launch places or ground model.
    """
    drone = load_drone_file(path, environment)
    if drone.mission is None:
        raise ConfigError(f"{path}: the key 'mission' is missing: the path of the mission file")
    mission = load_mission(Path(drone.mission))
    check_for_drone(mission, drone.id, drone.mission)
    return drone, mission


def load_drone_file(path: Path, environment: Mapping[str, str]) -> DroneConfig:
    """Read a drone file, with overrides from environment variables, without its mission file. Raises ConfigError as
    ``load_drone``.
    """
    return _with_paths_from(path.absolute().parent, _converted(path, environment))


def _converted(path: Path, environment: Mapping[str, str]) -> DroneConfig:
    document = read_toml(path)
    names = sorted(name for name in environment if name.startswith(PREFIX) and not name.startswith(NOT_OURS))
    overrides = {name: environment[name] for name in names}
    for name, text in overrides.items():
        _put(document, name, _value(text))
    try:
        return convert(document, DroneConfig, str(path))
    except ConfigError as error:
        raise ConfigError(_blaming(str(error), str(path), overrides)) from None


def _keys(name: str) -> list[str]:
    return name.removeprefix(PREFIX).lower().split("__")


def _value(text: str) -> object:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


def _put(document: dict[str, Any], name: str, value: object) -> None:
    *sections, key = _keys(name)
    for section in sections:
        document = document.setdefault(section, {})
        if not isinstance(document, dict):
            raise ConfigError(f"environment variable {name}: {section!r} is not a section")
    document[key] = value


def _blaming(text: str, path: str, overrides: Mapping[str, str]) -> str:
    """Return the error's text, with the variable's name instead of the file's if the key comes from the environment."""
    message = text.removeprefix(f"{path}: ")
    named = re.match(r"(?:unknown key '|the key ')?([A-Za-z0-9_.-]+)", message)
    for name in overrides:
        if named and named.group(1).rstrip(".:") == ".".join(_keys(name)):
            return f"environment variable {name}: {message}"
    return text


def _with_paths_from(folder: Path, drone: DroneConfig) -> DroneConfig:
    """Resolve relative paths against this folder."""

    def absolute(path: str | None) -> str | None:
        return None if path is None else str(folder / path)

    detector = replace(drone.detector, file=absolute(drone.detector.file), pixet_folder=absolute(drone.detector.pixet_folder))
    return replace(
        drone,
        mission=absolute(drone.mission),
        state=absolute(drone.state),
        updates=absolute(drone.updates),
        calibration=absolute(drone.calibration),
        mesh=replace(drone.mesh, identity=absolute(drone.mesh.identity)),
        detector=detector,
        recorder=replace(drone.recorder, folder=absolute(drone.recorder.folder)),
    )
