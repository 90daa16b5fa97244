"""The page's messages: one frame of the swarm at a time, and the layers of the map that change less often.

Mission frame, metres, radians counter-clockwise from east, seconds; times in milliseconds UTC, which JavaScript counts exactly.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

Point = tuple[float, float]
Launch = tuple[float, float, float]  # x, y (m), heading (degrees)
Value = float | Annotated[str, Meta(max_length=200)] | None


class DroneFrame(Struct, frozen=True, kw_only=True):
    """One drone. ``place``: (x, y, z), None if unknown; ``sigma_m``: horizontal, 1 sigma, by the drone itself.

    ``age_s``: since its last message, None: never heard. ``rates_ps``: hits, full-energy events and coincidences per second.
    ``other_mission``: id of the drone's mission, if that is not the mission shown. ``same_log``: whether the drone's log digest
    is among the station's of the last seconds; ``apart_m``: distance between the drone's and the station's source estimates,
    None: no recent estimate from the drone.
    """

    id: str
    stage: str = ""
    place: tuple[float, float, float] | None = None
    yaw: float = 0.0
    speed_mps: float = 0.0
    sigma_m: float | None = None
    battery: float | None = None
    age_s: float | None = None
    alive: bool = False
    stale: bool = True
    plan: tuple[Point, ...] = ()
    rates_ps: tuple[float, float, float] | None = None
    localization: str = ""
    clock_s: float | None = None
    same_log: bool = False
    apart_m: float | None = None
    recognised: str | None = None
    other_mission: str = ""
    problems: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()


class SourceFrame(Struct, frozen=True, kw_only=True):
    """A source of the hypothesis. ``covariance_m2``: xx, xy, xz, yy, yz, zz. ``region``: semi-axes (m) and direction of the long
    axis (rad) of the ellipse that holds the source with a probability of 90 %; ``dose_usvph``: ambient dose equivalent rate at
    1 m, None for an unknown activity or nuclide; ``number``: the source's name, the same from frame to frame; ``bearing_deg``:
    from the area's centre to a source beyond the fence, None for a source within.
    """

    place: tuple[float, float, float]
    covariance_m2: tuple[float, float, float, float, float, float]
    rms_m: float
    region: tuple[float, float, float]
    velocity_mps: Point
    cones: int
    nuclide: str
    activity_bq: float | None = None
    activity_sigma_bq: float | None = None
    dose_usvph: float | None = None
    position_deg: Point | None = None  # latitude and longitude
    number: int = 1
    bearing_deg: float | None = None


class SearchFrame(Struct, frozen=True, kw_only=True):
    """The search before a hypothesis. ``none``: probability of no source; ``excluded_bq``: stronger sources are excluded.

    A search for several sources goes on beside the sources found; these fields are then of a further source. ``nuclides_bq``:
    exclusion limit by nuclide; ``left``, ``glare``: shares of the area where a further source may still be, and where the sources
    found outshine it.
    """

    none: float
    excluded_bq: float | None
    nuclides_bq: dict[str, float] | None = None
    left: float = 0.0
    glare: float = 0.0


class Frame(Struct, frozen=True, kw_only=True):
    """The swarm at one time. ``warnings``: of the station's link and log; ``revoked``: names of the revoked members."""

    kind: str = "frame"
    at_ms: int
    drones: tuple[DroneFrame, ...]
    source: SourceFrame | None = None
    others: tuple[SourceFrame, ...] = ()  # further sources
    search: SearchFrame | None = None
    finding: str = ""
    digest: str = ""
    entries: int = 0
    warnings: tuple[str, ...] = ()
    revoked: tuple[str, ...] = ()


class Raster(Struct, frozen=True, kw_only=True):
    """A layer of the map: ``values`` of its cells row by row from the south-west, as bytes from 0 to 255 in base64.

    ``origin``: of the south-west corner; ``cell_m``: edge of a cell; ``scale``: value of 255 (``belief``: probability density
    per m2), or the scale of the page's levels (``dose``: uSv/h = 1e-3 * 10^(value / 32), 0: less).
    """

    kind: str
    at_ms: int
    origin: Point
    cell_m: float
    columns: int
    rows: int
    values: str
    scale: float


class DroneSpectrum(Struct, frozen=True):
    """Events of one camera in the last seconds, by bin: single clusters, and coincidences by the sum of their energies.

    ``live_s``: live time of the counts.
    """

    id: str
    live_s: float
    singles: tuple[int, ...]
    coincidences: tuple[int, ...]


class Spectra(Struct, frozen=True, kw_only=True):
    """The cameras' spectra."""

    kind: str = "spectra"
    at_ms: int
    drones: tuple[DroneSpectrum, ...]


class ConeCurve(Struct, frozen=True, kw_only=True):
    """The curves of a Compton cone on the ground, by its more probable reading, in pieces."""

    at_ms: int
    drone: str
    curves: tuple[tuple[Point, ...], ...]


class Event(Struct, frozen=True, kw_only=True):
    """An event of the timeline. ``level``: ``info``, ``warning``. ``text``: a key of the page's texts, with ``values`` for it."""

    kind: str = "event"
    at_ms: int
    text: str
    values: dict[str, str]
    level: str = "info"


class Field(Struct, frozen=True):
    """A key of the mission file open to changes. ``choices``: of a text, empty: any; ``optional``: may be empty."""

    key: str
    value: Value
    number: bool
    optional: bool
    choices: tuple[str, ...]


class Editor(Struct, frozen=True, kw_only=True):
    """The content of a page's mission editor: corners of the area, values, and launch places by drone."""

    area: tuple[Point, ...]
    fields: tuple[Field, ...]
    launches: dict[str, Launch]


class Flaw(Struct, frozen=True):
    """A flaw of a draft, in one line. ``field``: its key in the mission file; empty: no single key."""

    field: str
    text: str


class TileLevels(Struct, frozen=True, array_like=True):
    """Lowest and highest zoom level of the map's tiles, and the attribution of their data."""

    low: int
    high: int
    attribution: str


class Checked(Struct, frozen=True, kw_only=True):
    """The answer to a draft: flaws, or the mission's id, fence and file."""

    kind: str = "checked"
    number: int
    flaws: tuple[Flaw, ...] = ()
    id: str = ""
    fence: tuple[Point, ...] = ()
    file: str = ""


class MissionFrame(Struct, frozen=True, kw_only=True):
    """The page's data that does not change in a flight. ``energies_kev``: edges of the spectra's bins. ``commands``: allowed
    commands; ``editor``: None: no upload allowed; ``report``, ``layer``: whether available; ``tiles``: None: no tiles.
    """

    kind: str = "mission"
    id: str
    name: str
    swarm: str
    nuclide: str
    drones: tuple[str, ...]
    area: tuple[Point, ...]
    fence: tuple[Point, ...]
    datum_deg: Point | None
    replay: bool
    encrypted: bool
    energies_kev: tuple[float, ...]
    commands: tuple[str, ...] = ()
    editor: Editor | None = None
    report: bool = False
    layer: bool = False
    tiles: TileLevels | None = None
