"""Messages from the station to the operator's web page: the state of the swarm, and map layers that change less often.

Mission frame, metres, radians counter-clockwise from east, seconds; times in milliseconds UTC, which JavaScript counts exactly.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

Point = tuple[float, float]
Launch = tuple[float, float, float]  # x, y (m), heading (degrees)
Value = float | Annotated[str, Meta(max_length=200)] | None


class DroneFrame(Struct, frozen=True, kw_only=True):
    """State of one drone for the operator's web page.

    ``place``: (x, y, z) in the mission frame, metres; None if unknown. ``sigma_m``: horizontal 1-sigma error by the drone's own
    estimate. ``age_s``: time since its last message; None: never heard. ``alive``: the drone is connected. ``rates_ps``: hits,
    full-energy events and coincidences (pairs of simultaneous clusters of pixels) per second. ``clock_s``: error of its clock,
    positive if ahead. ``other_mission``: id of the drone's mission, if different from the mission shown. ``same_log``: whether
    the digest (hash) of the drone's log equals one of the station's digests of the last seconds. ``apart_m``: distance between
    the drone's and the station's source estimates; None: no recent estimate from the drone.
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
    problem_codes: tuple[str, ...] = ()
    notice_codes: tuple[str, ...] = ()


class SourceFrame(Struct, frozen=True, kw_only=True):
    """One estimated radioactive source for the operator's web page.

    ``covariance_m2``: error covariance of the position (xx, xy, xz, yy, yz, zz). ``region``: ellipse that contains the source
    with a probability of 90 %: semi-axes (m) and direction of the long axis (rad). ``dose_usvph``: ambient dose equivalent rate
    at 1 m; None for an unknown activity or nuclide. ``number``: number in the source's name, which stays constant over time.
    ``bearing_deg``: direction from the centre of the area to a source beyond the fence; None for a source within.
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
    """State of the search for a source that has not been found yet, for the operator's web page.

    ``none``: probability that there is no source. ``excluded_bq``: activity above which a source in the area is excluded. An
    estimator of several sources continues the search beside the sources found; the fields then refer to a further source.
    ``nuclides_bq``: exclusion limit for each nuclide. ``left``: share of the area where a further source may still be. ``glare``:
    share of the area where the sources found outshine a further source.
    """

    none: float
    excluded_bq: float | None
    nuclides_bq: dict[str, float] | None = None
    left: float = 0.0
    glare: float = 0.0


class Frame(Struct, frozen=True, kw_only=True):
    """State of the whole swarm at one time, for the operator's web page.

    ``warnings``: problems of the station's link and log. ``revoked``: names of members whose rights have been withdrawn.
    """

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
    warning_codes: tuple[str, ...] = ()
    revoked: tuple[str, ...] = ()


class Raster(Struct, frozen=True, kw_only=True):
    """A raster layer of the map on the operator's web page: probability density of the source, or dose rate.

    ``values``: values of the cells row by row from the south-west corner, as bytes from 0 to 255 in base64. ``origin``:
    south-west corner. ``cell_m``: edge of a cell. ``scale``: for the layer ``belief``, the probability density (per m2) of the
    value 255; for the layer ``dose``, the largest dose rate (uSv/h). The values of ``dose`` are logarithmic: uSv/h = 1e-3 *
    10^(value / 32), 0: less.
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
    """Gamma spectrum of one drone's camera over the last seconds, for the operator's web page.

    ``live_s``: live time of the counts. ``singles``: number of single clusters (adjacent pixels hit by one particle) in each
    energy bin. ``coincidences``: number of pairs of simultaneous clusters, by the sum of their energies.
    """

    id: str
    live_s: float
    singles: tuple[int, ...]
    coincidences: tuple[int, ...]


class Spectra(Struct, frozen=True, kw_only=True):
    """The gamma spectra of all drones' cameras over the last seconds."""

    kind: str = "spectra"
    at_ms: int
    drones: tuple[DroneSpectrum, ...]


class ConeCurve(Struct, frozen=True, kw_only=True):
    """A Compton cone on the map: the curves where its more probable reading meets the ground."""

    at_ms: int
    drone: str
    curves: tuple[tuple[Point, ...], ...]


class Event(Struct, frozen=True, kw_only=True):
    """An event of the timeline on the operator's web page, such as a found source or a command.

    ``level``: ``info`` or ``warning``. ``text``: key of a text in the page's language files, into which ``values`` are inserted.
    """

    kind: str = "event"
    at_ms: int
    text: str
    values: dict[str, str]
    level: str = "info"


class Field(Struct, frozen=True):
    """A setting of the mission file that can be changed on the operator's web page.

    ``number``: the value is a number. ``choices``: allowed texts; empty: any text. ``optional``: the value may be empty.
    """

    key: str
    value: Value
    number: bool
    optional: bool
    choices: tuple[str, ...]


class Editor(Struct, frozen=True, kw_only=True):
    """Content of the mission editor on the operator's web page: corners of the area, settings, and launch place of each drone."""

    area: tuple[Point, ...]
    fields: tuple[Field, ...]
    launches: dict[str, Launch]


class Flaw(Struct, frozen=True):
    """Why an operator's changes of a mission are not acceptable, in one line.

    ``field``: key in the mission file; empty: no single key.
    """

    field: str
    text: str


class TileLevels(Struct, frozen=True, array_like=True):
    """Lowest and highest zoom level of the map's tiles, and the attribution of their data."""

    low: int
    high: int
    attribution: str


class Checked(Struct, frozen=True, kw_only=True):
    """Answer to an operator's changes of a mission: their flaws, or the new mission's id, fence and file."""

    kind: str = "checked"
    number: int
    flaws: tuple[Flaw, ...] = ()
    id: str = ""
    fence: tuple[Point, ...] = ()
    file: str = ""


class MissionFrame(Struct, frozen=True, kw_only=True):
    """Everything about a mission that the operator's web page shows and that does not change in flight.

    ``area``, ``fence``: corners. ``datum_deg``: latitude and longitude of the origin. ``energies_kev``: edges of the spectra's
    bins. ``commands``: allowed commands. ``editor``: content of the mission editor; None: no upload allowed. ``report``,
    ``layer``: whether available. ``tiles``: zoom levels of the background images; None: no images.
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
