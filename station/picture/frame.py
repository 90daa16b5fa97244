"""What the page gets: one frame of the swarm at a time, and the layers of the map that change less often.

Mission frame, metres, radians counter-clockwise from east, seconds; times in milliseconds UTC, which JavaScript counts exactly.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

Point = tuple[float, float]
Launch = tuple[float, float, float]  # x, y (m), heading (degrees)
Value = float | Annotated[str, Meta(max_length=200)] | None


class DroneFrame(Struct, frozen=True, kw_only=True):
    """One drone. ``place``: (x, y, z), None where nobody knows it; ``sigma_m``: of it, horizontal, 1 sigma, by the drone itself.

    ``age_s``: since it was heard last, None: never. ``rates_ps``: hits, full-energy events and coincidences per second.
    ``other_mission``: id of the mission that it has, if that is not the one shown. ``same_log``: whether it tells a log that the
    station has had in the last seconds; ``apart_m``: how far it puts the source from where the station does, None: it has told no
    estimate lately.
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
    one (rad) of the ellipse that holds the source with a probability of 90 %; ``dose_usvph``: ambient dose equivalent rate at
    1 m, None for an unknown activity or nuclide; ``number``: by which it is named, the same from frame to frame;
    ``bearing_deg``: from the area's centre to a source beyond the fence, None of one within.
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
    """The search before there is a hypothesis. ``none``: probability that there is no source; ``excluded_bq``: stronger ones are
    excluded.

    Of a search for several sources also beside those that are found, and of a further one: ``nuclides_bq``: by nuclide, the
    activity from which on it is excluded; ``left``, ``glare``: shares of the area where it may hide, and where those outshine it.
    """

    none: float
    excluded_bq: float | None
    nuclides_bq: dict[str, float] | None = None
    left: float = 0.0
    glare: float = 0.0


class Frame(Struct, frozen=True, kw_only=True):
    """The swarm at one time. ``warnings``: of the station's link and log; ``revoked``: members whose messages do not count."""

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

    ``origin``: of the south-west corner; ``cell_m``: edge of a cell; ``scale``: value that 255 stands for (``belief``:
    probability density per m2), or by which the page finds levels (``dose``: uSv/h = 1e-3 * 10^(value / 32), 0: less).
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

    ``live_s``: in which they were counted.
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
    """Where a Compton cone meets the ground, by its more probable reading: pieces of curves."""

    at_ms: int
    drone: str
    curves: tuple[tuple[Point, ...], ...]


class Event(Struct, frozen=True, kw_only=True):
    """Something that happened. ``level``: ``info``, ``warning``. ``text``: a key of the page's texts, with ``values`` for it."""

    kind: str = "event"
    at_ms: int
    text: str
    values: dict[str, str]
    level: str = "info"


class Field(Struct, frozen=True):
    """A key of the mission file that the page may change. ``choices``: of a text, empty: any; ``optional``: it may be empty."""

    key: str
    value: Value
    number: bool
    optional: bool
    choices: tuple[str, ...]


class Editor(Struct, frozen=True, kw_only=True):
    """What a page needs to change a mission: corners of the area, values, and launch places by drone."""

    area: tuple[Point, ...]
    fields: tuple[Field, ...]
    launches: dict[str, Launch]


class Flaw(Struct, frozen=True):
    """Why a draft is no mission, in one line. ``field``: its key in the mission file; empty: no single one."""

    field: str
    text: str


class TileLevels(Struct, frozen=True, array_like=True):
    """Lowest and highest zoom level of the map's tiles, and whose data they are."""

    low: int
    high: int
    attribution: str


class Checked(Struct, frozen=True, kw_only=True):
    """What a draft of a mission is: with flaws, or a mission with this id, fence and file."""

    kind: str = "checked"
    number: int
    flaws: tuple[Flaw, ...] = ()
    id: str = ""
    fence: tuple[Point, ...] = ()
    file: str = ""


class MissionFrame(Struct, frozen=True, kw_only=True):
    """What does not change in a flight. ``energies_kev``: edges of the spectra's bins. ``commands``: that the page may give;
    ``editor``: None: it may upload no mission; ``report``, ``layer``: whether there is one; ``tiles``: None: none.
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
