"""Mission editor of the operator's web page: which settings can be changed before the start, and how the changes are checked.

The agents' own loading code checks the changes.
"""

from __future__ import annotations

from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.config.launchplaces import check_launch_places
from radron.agent.config.loading import convert, without_files
from radron.agent.config.mission import MissionConfig
from radron.agent.config.writing import as_toml
from radron.agent.errors import ConfigError, RadronError
from radron.protocol.units import DroneId
from radron.station.picture.frame import Checked, Editor, Field, Flaw, Launch, Point, Value
from radron.station.picture.picture import corners
from radron.station.picture.swarmlog import SwarmLog

KEYS = (
    "name",
    "nuclide",
    "area.fence_margin_m",
    "area.floor_m",
    "area.ceiling_m",
    "ground.height_m",
    "fusion.ground",
    "survey.strategy",
    "survey.height_m",
    "survey.search_speed_mps",
    "survey.least_activity_bq",
    "survey.duration_s",
    "survey.then",
    "encirclement.radius_m",
    "encirclement.nearest_m",
    "encirclement.height_m",
    "encirclement.speed_mps",
    "track.duration_s",
    "limits.speed_mps",
    "limits.separation_m",
    "safety.alone",
    "safety.agent_lost",
    "safety.return_height_m",
    "safety.battery_reserve",
)
AREA, LAUNCHES = "area.polygon_m", "drones"  # edited on the map
_WHERE = "mission"


class Draft(Struct, frozen=True, forbid_unknown_fields=True):
    """Changes of a mission that an operator has entered on the web page, to be checked before they are uploaded to the drones.

    ``area``: corners of the search area. ``launches``: launch place of each drone. ``values``: new values by key of the mission
    file. ``number``: number of this set of changes, repeated in the answer to the page.
    """

    area: Annotated[tuple[Point, ...], Meta(max_length=256)]
    launches: Annotated[dict[DroneId, Launch], Meta(max_length=64)]
    values: Annotated[dict[Annotated[str, Meta(max_length=64)], Value], Meta(max_length=len(KEYS))]
    number: int = 0  # of the draft, repeated in the answer


def editor(mission: MissionConfig) -> Editor:
    """Return the content of the web page's mission editor for a mission: area, launch places and settings that can be changed."""
    launches = {drone.id: (drone.origin_m[0], drone.origin_m[1], drone.yaw_deg) for drone in mission.drones}
    return Editor(area=mission.area.polygon_m, fields=tuple(_field(mission, key) for key in KEYS), launches=launches)


def drafted(mission: MissionConfig, draft: Draft) -> MissionConfig | tuple[Flaw, ...]:
    """Return a mission with an operator's changes if the agents' checks accept it; else the flaws.

    There is at most one flaw for each field.
    """
    content: dict[str, Any] = msgspec.to_builtins(without_files(mission))  # without megabytes to be converted for each key
    changes: dict[str, object] = {AREA: draft.area, LAUNCHES: _launched(content[LAUNCHES], draft.launches), **draft.values}
    flaws = [flaw for key, value in changes.items() if (flaw := _flaw_of(content, key, value)) is not None]
    if flaws:
        return tuple(flaws)
    for key, value in changes.items():
        content = _with(content, key, value)
    try:
        changed = convert(content, MissionConfig, _WHERE)
        ground = replace(changed.ground, grid_data=mission.ground.grid_data)
        changed = replace(changed, ground=ground, responses=mission.responses)
        changed.check(_WHERE)
        check_launch_places(changed, _WHERE)
        SwarmLog(changed, None)  # the checks of the estimator and of the ground
    except RadronError as error:
        text = _bare(str(error))
        return (Flaw(_named(text), text),)
    return changed


def told(result: MissionConfig | tuple[Flaw, ...], number: int) -> Checked:
    """Return the answer to an operator's changes of a mission: the flaws, or the new mission with its id, fence and file.

    A grid of ground elevations and tables of response stay in their own files beside the mission file. ``number``: number of the
    changes.
    """
    if isinstance(result, tuple):
        return Checked(number=number, flaws=result)
    fence = corners(Polygon(result.area.polygon_m).buffer(result.area.fence_margin_m))
    file = as_toml(without_files(result))
    return Checked(number=number, id=result.mission_id, fence=fence, file=file)


def _launched(drones: Any, launches: dict[str, Launch]) -> list[dict[str, object]]:
    moved = []
    for drone in drones:
        x, y, yaw_deg = launches.get(drone["id"], (*drone["origin_m"][:2], drone["yaw_deg"]))
        moved.append({**drone, "origin_m": (x, y, drone["origin_m"][2]), "yaw_deg": yaw_deg})
    return moved


def _flaw_of(content: dict[str, Any], key: str, value: object) -> Flaw | None:
    """Return the flaw of one changed value by itself; None without a flaw."""
    if key not in (AREA, LAUNCHES, *KEYS):
        return Flaw("", f"unknown key {key[:64]!r}")
    if value is None and not _may_be_empty(key):
        return Flaw(key, f"{key}: a value is needed")
    try:
        convert(_with(content, key, value), MissionConfig, _WHERE)
    except ConfigError as error:
        return Flaw(key, _bare(str(error)))
    return None


def _with(content: dict[str, Any], key: str, value: object) -> dict[str, Any]:
    if key == "nuclide" and isinstance(value, str) and "," in value:
        value = [name.strip() for name in value.split(",")]
    section, _, name = key.rpartition(".")
    return {**content, section: {**content[section], name: value}} if section else {**content, name: value}


def _bare(text: str) -> str:
    return text.removeprefix(f"{_WHERE}: ")


def _named(text: str) -> str:
    """Return the first key in a text; a key without a section counts only at the text's beginning. Empty without a key."""
    found = [(text.find(key), key) for key in (*KEYS, AREA, LAUNCHES) if (key in text if "." in key else text.startswith(key))]
    return min(found, default=(0, ""))[1]


def _field(mission: MissionConfig, key: str) -> Field:
    section, _, name = key.rpartition(".")
    owner = getattr(mission, section) if section else mission
    kind = get_type_hints(type(owner))[name]
    parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    choices = next((get_args(part) for part in parts if get_origin(part) is Literal), ())
    value = mission.nuclide_text if key == "nuclide" else getattr(owner, name)
    return Field(key, value, number=str not in parts and not choices, optional=_may_be_empty(key), choices=choices)


def _may_be_empty(key: str) -> bool:
    """Return whether a missing key means None in the mission file: TOML has no null."""
    kind: type[Struct] = MissionConfig
    *sections, name = key.split(".")
    for section in sections:
        kind = get_type_hints(kind)[section]
    return any(field.name == name and field.default is None for field in msgspec.structs.fields(kind))
