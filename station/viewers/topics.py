"""The topics that Foxglove shows: its own schemas as Protocol Buffers, and tables of numbers as JSON for its plots."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator, Sequence

import msgspec
from foxglove import Schema
from foxglove.messages import FrameTransforms, GeoJson, Grid, LocationFix, Log, PoseInFrame, PosesInFrame, SceneUpdate
from msgspec import Struct

MISSION = "mission"  # Foxglove's name of the mission frame
BODY, LOCAL = "{drone}", "{drone}/local"  # names of a drone's body frame and of its local frame

TRANSFORMS = "/tf"
AREA, SWARM_SCENE, SOURCE_SCENE, CONES = "/scene/area", "/scene/drones", "/scene/source", "/scene/cones"
POSTERIOR, DOSE = "/posterior", "/dose"
SOURCE, SEARCH, LOG, EVENTS = "/source", "/search", "/log", "/events"
OTHERS, SOURCE_FIX, MAP = "/source/others", "/source/fix", "/map"
POSE, PLAN, FIX, STATE, COUNTS, SPECTRUM = "/{}/pose", "/{}/plan", "/{}/fix", "/{}/state", "/{}/counts", "/{}/spectrum"


class Table(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Base of the messages of plain fields (numbers, texts and lists) for Foxglove's plots.

    Unknown values are left out, as Foxglove reads no null.
    """


class DroneTable(Table, frozen=True, kw_only=True, omit_defaults=True):
    """State of a drone for Foxglove's plots, with the meanings of ``DroneFrame``. ``heard``: whether the drone is in contact."""

    stage: str
    heard: bool
    speed_mps: float
    battery: float | None = None
    age_s: float | None = None
    sigma_m: float | None = None
    clock_s: float | None = None
    apart_m: float | None = None
    hits_ps: float | None = None
    photopeak_ps: float | None = None
    coincidences_ps: float | None = None
    recognised: str | None = None
    problems: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()
    problem_codes: tuple[str, ...] = ()
    notice_codes: tuple[str, ...] = ()


class CountsTable(Table, frozen=True, kw_only=True, omit_defaults=True):
    """Photon counts of one exposure (counting interval of a camera) for Foxglove's plots.

    ``end_s``: end of the interval, seconds UTC. ``singles``, ``coincident``: events in each energy bin, as single clusters of
    pixels and as pairs of simultaneous clusters.
    """

    end_s: float
    live_time_s: float
    hits: int
    photopeak: int
    coincidences: int
    singles: tuple[int, ...]
    coincident: tuple[int, ...]


class SpectrumTable(Table, frozen=True, kw_only=True, omit_defaults=True):
    """Gamma spectrum of the last seconds for Foxglove's plots: number of events by energy.

    Single clusters of pixels and pairs of simultaneous clusters are counted together. ``energy_kev``: middles of the bins.
    """

    live_time_s: float
    energy_kev: tuple[float, ...]
    counts: tuple[int, ...]


class SourceTable(Table, frozen=True, kw_only=True, omit_defaults=True):
    """An estimated source for Foxglove's plots, in the mission frame, with the meanings of ``SourceFrame``."""

    number: int
    x_m: float
    y_m: float
    z_m: float
    rms_m: float
    covariance_m2: tuple[float, ...]
    region_long_m: float
    region_short_m: float
    region_direction_rad: float
    vx_mps: float
    vy_mps: float
    cones: int
    nuclide: str
    activity_bq: float | None = None
    activity_sigma_bq: float | None = None
    dose_usvph: float | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None


class SearchTable(Table, frozen=True, kw_only=True, omit_defaults=True):
    """State of the search for a source that has not been found yet, for Foxglove's plots.

    ``none``: probability that there is no source. ``excluded_bq``: activity above which a source is excluded.
    """

    none: float
    excluded_bq: float | None = None


class LogTable(Table, frozen=True, kw_only=True, omit_defaults=True):
    """Size and digest (hash) of the log, and the drones' conclusion of the search, for Foxglove."""

    entries: int
    digest: str
    finding: str


class Topic(typing.NamedTuple):
    """A topic (named stream of messages) with the schema of its messages.

    ``encoding``: ``json`` or ``protobuf``, as MCAP and Foxglove's WebSocket protocol name it.
    """

    name: str
    encoding: str
    schema: Schema


def topics(drones: Sequence[str], on_earth: bool) -> list[Topic]:
    """Return all topics of a swarm for Foxglove. ``on_earth``: with geographic positions, for a mission with a datum."""
    own: dict[str, Schema] = {
        TRANSFORMS: FrameTransforms.get_schema(),
        **{name: SceneUpdate.get_schema() for name in (AREA, SWARM_SCENE, SOURCE_SCENE, CONES)},
        POSTERIOR: Grid.get_schema(),
        DOSE: Grid.get_schema(),
        EVENTS: Log.get_schema(),
    }
    tables: dict[str, type[Table]] = {SOURCE: SourceTable, OTHERS: SourceTable, SEARCH: SearchTable, LOG: LogTable}
    for drone in drones:
        own[POSE.format(drone)] = PoseInFrame.get_schema()
        own[PLAN.format(drone)] = PosesInFrame.get_schema()
        tables |= {STATE.format(drone): DroneTable, COUNTS.format(drone): CountsTable, SPECTRUM.format(drone): SpectrumTable}
    if on_earth:
        own |= {MAP: GeoJson.get_schema(), SOURCE_FIX: LocationFix.get_schema()}
        own |= {FIX.format(drone): LocationFix.get_schema() for drone in drones}
    return [
        *(Topic(name, schema.encoding, schema) for name, schema in own.items()),
        *(Topic(name, "json", _schema_of(table)) for name, table in tables.items()),
    ]


def _schema_of(table: type[Table]) -> Schema:
    """Return the JSON schema of a table; not msgspec's: Foxglove reads neither references nor alternatives."""
    hints = typing.get_type_hints(table)
    properties = {name: next(_properties(hints[name])) for name in table.__struct_fields__}
    name = f"radron.{table.__name__.removesuffix('Table')}"
    schema = {"title": name, "type": "object", "properties": properties}
    return Schema(name=name, encoding="jsonschema", data=msgspec.json.encode(schema))


def _properties(hint: object) -> Iterator[dict[str, object]]:
    kinds: dict[object, str] = {str: "string", bool: "boolean", int: "number", float: "number"}
    if hint in kinds:
        yield {"type": kinds[hint]}
    elif typing.get_origin(hint) is types.UnionType:
        yield from (found for part in typing.get_args(hint) if part is not types.NoneType for found in _properties(part))
    else:
        yield {"type": "array", "items": next(_properties(typing.get_args(hint)[0]))}
