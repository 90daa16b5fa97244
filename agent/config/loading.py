"""Configuration files (TOML) into their types, with errors that name the file, the key and the allowed values."""

from __future__ import annotations

import difflib
import re
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from radron.agent.config.buildings import read_buildings
from radron.agent.config.drone import PARAMETER
from radron.agent.config.mission import MAX_GRID_BYTES, MissionConfig
from radron.agent.config.responses import check_tables, read_responses
from radron.agent.errors import ConfigError
from radron.agent.inputs import read_bytes, read_text
from radron.protocol.units import STATION

T = TypeVar("T")


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file into a dictionary. Raise ConfigError if the file is unreadable or not TOML."""
    try:
        return tomllib.loads(read_text(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:  # not only TOMLDecodeError: also a number of thousands of digits
        raise ConfigError(f"{path}: not TOML: {error}") from None
    except RecursionError:
        raise ConfigError(f"{path}: not TOML: nested too deeply") from None


def merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Return one parsed document with the values of another in place of the first one's, section by section.

    base: the document, such as defaults; over: the values that replace. Keys that only ``base`` has keep their values.
    """
    whole = dict(base)
    for key, value in over.items():
        old = whole.get(key)
        whole[key] = merged(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return whole


def load_toml(path: Path, kind: type[T]) -> T:
    """Read a TOML file into a configuration type such as ``DroneConfig``, and check its keys and values.

    Raises:
        ConfigError: the file is unreadable or not TOML, has an unknown key (the text names the nearest known one), or a value out
            of range.
    """
    return convert(read_toml(path), kind, str(path))


def load_mission(path: Path) -> MissionConfig:
    """Read and check a mission file, together with the elevation grid and the buildings file that it names. Raises
    ConfigError.
    """
    mission = load_toml(path, MissionConfig)
    mission.check(str(path))
    return with_files(mission, path.parent)


def mission_content(mission: MissionConfig) -> bytes:
    """Return a mission as bytes for the upload to the drones: complete, with the content of its elevation grid."""
    return msgspec.msgpack.encode(mission)


def read_content(content: bytes, mission_id: str) -> MissionConfig:
    """Return the mission that was uploaded to this drone as bytes, checked as a mission file is.

    mission_id: hash under which it was uploaded; the content must give the same hash here. Raises ConfigError in one line.
    """
    where = f"mission {mission_id}"
    try:
        mission = msgspec.msgpack.decode(content, type=MissionConfig)
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise ConfigError(f"{where}: {_explain(str(error), MissionConfig)}; give all the same version of radron") from None
    if mission.mission_id != mission_id:
        raise ConfigError(f"{where}: is read as {mission.mission_id} here; give all the same version of radron")
    mission.check(where)
    check_tables(mission, where)
    return mission


def with_files(mission: MissionConfig, folder: Path) -> MissionConfig:
    """Return the mission together with its elevation grid, buildings and tables of response, read from files in ``folder``.

    Raises ConfigError as ``with_ground_grid``, ``read_responses`` and ``read_buildings`` do.
    """
    mission = with_ground_grid(mission, folder)
    mission = replace(mission, responses=read_responses(mission, folder))
    check_tables(mission, str(folder))
    buildings, datum = mission.buildings, mission.datum
    if buildings.file is None:
        return mission
    place = None if datum is None else (datum.latitude_deg, datum.longitude_deg, datum.altitude_m)
    known = read_buildings(folder / buildings.file, buildings, place)
    known.check(f"buildings.file: {buildings.file}")
    return replace(mission, buildings=known)


def without_files(mission: MissionConfig) -> MissionConfig:
    """Return the mission as its file has it: without the content of its elevation grid and its tables of response."""
    return replace(mission, ground=replace(mission.ground, grid_data=None), responses=())


def with_ground_grid(mission: MissionConfig, folder: Path) -> MissionConfig:
    """Return the mission with the content of its elevation grid, read from ``folder`` unless the mission contains it already.

    Raises:
        ConfigError: the file cannot be read, or is too large.
    """
    ground = mission.ground
    if ground.grid is None or ground.grid_data is not None:
        return mission
    path = folder / ground.grid
    data = read_bytes(path, MAX_GRID_BYTES, f"ground.grid: {path}", "crop it to the area, or compress it (GeoTIFF)")
    return replace(mission, ground=replace(ground, grid_data=data))


def convert(document: object, kind: type[T], where: str) -> T:
    """Convert a parsed document (dictionaries and lists) to a configuration type.

    Raise ConfigError with ``where`` (the file's name), the key and the allowed values if the document does not fit.
    """
    try:
        return msgspec.convert(document, kind)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {_explain(str(error), kind)}") from None


def _explain(text: str, kind: type) -> str:
    """msgspec's error message with the key before it and the allowed values after it."""
    message, _, place = text.partition(" - at ")
    path = place.strip("`").replace("key` in `$.", "a key of ").removeprefix("$").lstrip(".")
    unknown = re.match(r"Object contains unknown field `(.+)`", message)
    if unknown:
        key = unknown.group(1)
        allowed = _keys(_type_at(kind, path))
        near = difflib.get_close_matches(key, allowed, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        return f"unknown key {_join(path, key)!r}{hint} (allowed: {', '.join(allowed)})"
    missing = re.match(r"Object missing required field `(.+)`", message)
    if missing:
        return f"the key {_join(path, missing.group(1))!r} is missing"
    if PARAMETER in message:
        return f"{path}: expected a name of PX4's, of up to 16 of A-Z, 0-9 and '_', such as COM_OF_LOSS_T"
    if "[A-Z][a-z]?-" in message and path.startswith("nuclide"):
        return f"{path}: expected a nuclide, such as Cs-137"
    if "matching regex" in message:
        return f"{path}: expected a name of up to 32 of a-z, 0-9 and '-' (for a drone not {STATION!r})"
    choice = _type_at(kind, path)
    if isinstance(choice, msgspec.inspect.LiteralType):
        return f"{path}: {message[0].lower()}{message[1:]} (allowed: {', '.join(map(repr, choice.values))})"
    return f"{path or 'the file'}: {message[0].lower()}{message[1:]}"


def _join(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


def _keys(kind: msgspec.inspect.Type) -> list[str]:
    return [field.encode_name for field in kind.fields] if isinstance(kind, msgspec.inspect.StructType) else []


def _type_at(kind: type, path: str) -> msgspec.inspect.Type:
    """The type at a path such as ``mission.drones[...].id`` of a config type; of a list that of its items."""
    current = msgspec.inspect.type_info(kind)
    for name in re.findall(r"[A-Za-z_]\w*", path):
        if isinstance(current, msgspec.inspect.StructType):
            field = next((field for field in current.fields if field.encode_name == name), None)
            if field is None:
                return msgspec.inspect.AnyType()
            current = _item(field.type)
    return current


def _item(kind: msgspec.inspect.Type) -> msgspec.inspect.Type:
    if isinstance(kind, msgspec.inspect.UnionType):
        return next((_item(part) for part in kind.types if isinstance(_item(part), msgspec.inspect.StructType)), kind)
    if isinstance(kind, msgspec.inspect.VarTupleType | msgspec.inspect.ListType):
        return _item(kind.item_type)
    return kind
