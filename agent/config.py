"""Drone and mission files (TOML), checked on load.

A mission file is the same on every drone: it is hashed into the mission id, and drones of differing mission ids refuse to
start together. A drone file says what is particular to one vehicle.
"""

from __future__ import annotations

import difflib
import hashlib
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import replace
from shapely import Polygon
from shapely.validation import explain_validity

from agent.errors import ConfigError
from protocol.units import STATION, DroneId, Identifier, Latitude, Longitude

Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
Activity = Annotated[float, Meta(gt=0.0, le=1e15)]
NonNegative = Annotated[float, Meta(ge=0.0, le=1e6)]
Coordinate = Annotated[float, Meta(ge=-1e5, le=1e5)]
Degrees = Annotated[float, Meta(ge=-360.0, le=360.0)]
Point2 = tuple[Coordinate, Coordinate]
T = TypeVar("T")
GRID_BYTES = 2_000_000  # of an elevation grid: 1 km2 at 1 m, compressed


class _Section(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all sections: a key that is not known is an error, not a default."""


class AreaConfig(_Section, frozen=True, kw_only=True):
    """Where to search and where to stay. Mission frame, metres; heights above ground."""

    polygon_m: Annotated[tuple[Point2, ...], Meta(min_length=3, max_length=256)]
    fence_margin_m: NonNegative = 30.0
    floor_m: NonNegative = 1.5
    ceiling_m: Positive = 60.0


class SurveyConfig(_Section, frozen=True, kw_only=True):
    """The search before there is a hypothesis.

    ``strategy``: ``information`` flies to where most is learnt, at ``search_speed_mps``; ``lanes`` covers the area, at
    ``speed_mps`` (paper, Sec. V-A), and is flown where the estimator has no outlook, by the flocking law ``paper``, and in areas
    whose bounds enclose more than 9 ha.
    Nothing is found once every source of ``least_activity_bq`` or more is excluded (none: never), or when the search has lasted
    ``duration_s`` (none: as long as it takes). ``then`` the swarm returns, or goes on searching.
    """

    height_m: Positive = 3.0
    speed_mps: Positive = 3.0
    lane_spacing_m: Annotated[float, Meta(ge=0.5, le=1000.0)] = 10.0
    yaw_rate_rps: Annotated[float, Meta(ge=-6.3, le=6.3)] = 0.5
    strategy: Literal["information", "lanes"] = "information"
    search_speed_mps: Positive = 6.5
    least_activity_bq: Activity | None = 5e7
    duration_s: Positive | None = None
    then: Literal["return", "continue"] = "return"


class EncirclementConfig(_Section, frozen=True, kw_only=True):
    """The circular flight around the hypothesis (paper, Sec. V-C). ``law``: the paper's, or the smooth one.

    By the smooth law, and with an estimator that knows how sure it is, the radius is ``nearest_m`` and the hypothesis' RMS
    together, ``radius_m`` at most, and the height is in proportion to it, ``height_m`` at ``radius_m``.
    """

    law: Literal["paper", "smooth"] = "smooth"
    radius_m: Positive = 12.0
    nearest_m: Positive = 6.0
    speed_mps: Positive = 3.0
    height_m: Positive = 3.0
    steps: Annotated[int, Meta(ge=2, le=63)] = 30  # K
    step_s: Annotated[float, Meta(gt=0.0, le=2.0)] = 0.2  # Delta T
    bias_rad: Annotated[float, Meta(ge=0.0, le=1.6)] = 0.05  # beta


class LimitsConfig(_Section, frozen=True, kw_only=True):
    """What the vehicles can do, and how near they may come to each other."""

    speed_mps: Positive = 8.0
    acceleration_mps2: Positive = 4.0
    jerk_mps3: Positive = 20.0
    climb_mps: Positive = 2.0
    separation_m: Positive = 3.0


class PaperEstimatorConfig(_Section, frozen=True, kw_only=True):
    """Parameters of the paper's linear Kalman filter (Sec. IV-B).

    ``order``: which of a cone's two readings is used: the one with the smaller scattering angle, or the more probable one.
    """

    process_noise_m2ps: Positive = 2.0  # q
    measurement_variance_m2: Positive = 100.0  # rho
    cross_axis_factor: Positive = 1e4
    initial_cones: Annotated[int, Meta(ge=3, le=1000)] = 10  # M
    initial_baseline_m: NonNegative = 2.0  # between the apexes of the M cones
    initial_variance_m2: Positive = 100.0
    order: Literal["forward", "probable"] = "forward"


class BayesEstimatorConfig(_Section, frozen=True, kw_only=True):
    """Parameters of the Bayesian estimator: what is held possible of the source beforehand, and of the vehicles' poses."""

    grid_s: Annotated[float, Meta(ge=0.05, le=1.0)] = 0.1
    activity_bq: tuple[Activity, Activity] = (3e7, 3e12)  # up to what is lost of industrial radiography and teletherapy
    activity_levels: Annotated[int, Meta(ge=2, le=64)] = 12
    velocity_mps: Positive = 0.7  # 1 sigma of each axis of a source that moves
    velocity_s: Positive = 300.0  # correlation time of that velocity
    fast_velocity_mps: Positive = 2.0  # the same of one that moves fast
    fast_velocity_s: Positive = 5.0
    hurry_ps: Positive = 0.003  # rate at which a moving source becomes a fast one, or a fast one slow
    switch_ps: Positive = 0.00005  # rate at which one at rest begins to move, or a moving one stops
    bias_drift_m: NonNegative = 0.03  # by which a vehicle's position error wanders in a second (as the root of the time)
    bias_yaw_drift_deg: NonNegative = 0.3
    gain_sigma: NonNegative = 0.05  # relative, of what a camera counts against the others
    gain_drift: NonNegative = 0.003
    cell_m: Annotated[float, Meta(ge=0.5, le=100.0)] = 2.5  # of the grid of the search, at least
    most_cells: Annotated[int, Meta(ge=16, le=100_000)] = 4096
    background_levels: Annotated[tuple[Positive, ...], Meta(min_length=1, max_length=16)] = (0.8, 1.0, 1.25, 1.55, 1.95)
    background_sigma: Positive = 0.3  # of the logarithm of how strong the background is against the configured one
    motion_prior: tuple[Positive, Positive, Positive] = (0.5, 0.3, 0.2)  # at rest, moving, moving fast
    search_diffusion_m2ps: tuple[Positive, Positive] = (2.0, 20.0)  # of a moving source and a fast one while it is searched for
    declared_rms_m: Positive = 3.5  # the posterior's, for the source to count as found
    given_up_rms_m: Positive = 7.0  # above this the source is searched for again, from where the posterior has it
    doubt: Annotated[float, Meta(gt=0.0, lt=1.0)] = 1e-3  # probability that there is none, at most


class GivenHypothesisConfig(_Section, frozen=True, kw_only=True):
    """A hypothesis that moves by a schedule: ``[[t_s, x, y], ...]`` from the mission's start, mission frame."""

    schedule: Annotated[tuple[tuple[NonNegative, Coordinate, Coordinate], ...], Meta(min_length=1, max_length=1000)]


class FusionConfig(_Section, frozen=True, kw_only=True):
    """Which estimator, and the time grid that it steps on."""

    estimator: Literal["paper", "paper-geometric", "bayes", "given"] = "bayes"
    grid_s: Annotated[float, Meta(ge=0.05, le=10.0)] = 0.5
    horizon_s: Positive = 60.0  # what is older may be compacted once no peer lacks it; no agent does so in flight
    paper: PaperEstimatorConfig = PaperEstimatorConfig()
    bayes: BayesEstimatorConfig = BayesEstimatorConfig()
    given: GivenHypothesisConfig | None = None


class DetectionConfig(_Section, frozen=True, kw_only=True):
    """What counts as a cone: energies in keV, cluster sizes in pixels, times in ns.

    The rates that estimator ``bayes`` expects were measured with these values (benchmarks/channel_response.py): where any but
    ``minimum_pixels`` are others, it is wrong about activities.
    """

    energy_window: Annotated[float, Meta(gt=0.0, lt=1.0)] = 0.2  # of the line's energy, each side
    minimum_pixels: Annotated[int, Meta(ge=2, le=1000)] = 6  # of both clusters together (paper: 15)
    minimum_photon_kev: NonNegative | None = None  # of a cone; none: what the line's kinematics allow, less 10 keV (Cs-137: 174)
    maximum_electron_kev: Positive | None = None  # of a cone; none: the line's Compton edge (Cs-137: 477)
    cluster_threshold_kev: NonNegative = 5.0
    cluster_gap_ns: Positive = 100.0
    coincidence_window_ns: Positive = 100.0


class TrackConfig(_Section, frozen=True, kw_only=True):
    """When tracking ends: after ``duration_s`` the swarm returns.

    When the source counts as lost: by an estimator that knows how sure it is, where the hypothesis' RMS is above ``lost_rms_m``;
    then the swarm encircles what is left of it as widely as that. ``bayes`` comes so far only when nothing is heard at all: else
    it gives a track up before (``given_up_rms_m``), and searches from what it knows. By any other one, after
    ``no_cone_timeout_s`` without a cone; then it searches outward from where the source was last believed to be, the circle
    growing by ``widening_mps``.
    """

    lost_rms_m: Positive = 15.0
    no_cone_timeout_s: Positive | None = 20.0
    widening_mps: NonNegative = 0.5
    duration_s: Positive | None = None


class DroneInMission(_Section, frozen=True, kw_only=True):
    """A member of the swarm and where its local frame lies at the start: its origin and heading in the mission frame.

    ``localization``: ``exact``: the frame lies exactly there for the whole flight; else how the vehicle localises itself, and
    the frame's place and heading are estimated in flight, beginning with ``origin_sigma_m`` (of each axis) and ``yaw_sigma_deg``
    (180: the heading is not known at all).
    """

    id: DroneId
    origin_m: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    yaw_deg: Degrees = 0.0
    localization: Literal["exact", "gnss", "rtk", "slam"] = "exact"
    origin_sigma_m: NonNegative = 1.0
    yaw_sigma_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 5.0

    @property
    def is_exact(self) -> bool:
        """Whether its frame lies exactly there for the whole flight, so that there is nothing to estimate."""
        return self.localization == "exact"


class DatumConfig(_Section, frozen=True, kw_only=True):
    """Where on Earth the mission frame's origin lies (WGS84, height above the ellipsoid); its axes are east, north, up there."""

    latitude_deg: Latitude
    longitude_deg: Longitude
    altitude_m: Coordinate = 0.0


class GroundConfig(_Section, frozen=True, kw_only=True):
    """The ground on which the source lies, in the mission frame: a plane, or an elevation grid.

    ``height_m``: of the plane at the mission frame's origin; ``slope``: its rise per metre east and north. ``grid``: an ESRI
    ASCII grid or GeoTIFF file instead, from the mission file's folder.

    ``grid_crs``: of the grid's coordinates: ``mission`` (metres of the mission frame), ``EPSG:4326`` (degrees, WGS84) or the
    code of a UTM zone (EPSG:32601 .. 32660, 32701 .. 32760); none: what a GeoTIFF says itself, ``mission`` where nothing is said.
    Georeferenced grids need the mission's ``datum``. ``geoid_m``: their zero above the ellipsoid; they count from the sea mostly.
    ``grid_data``: the file's content, filled on load: it belongs to the mission, to its id and its records.
    """

    height_m: Coordinate = 0.0
    slope: tuple[Annotated[float, Meta(ge=-2.0, le=2.0)], Annotated[float, Meta(ge=-2.0, le=2.0)]] = (0.0, 0.0)
    grid: str | None = None
    grid_crs: Annotated[str, Meta(pattern=r"^(mission|EPSG:(4326|32[67](0[1-9]|[1-5][0-9]|60)))$")] | None = None
    geoid_m: Annotated[float, Meta(ge=-200.0, le=200.0)] = 0.0
    grid_data: Annotated[bytes, Meta(max_length=GRID_BYTES)] | None = None


class FramesConfig(_Section, frozen=True, kw_only=True):
    """How the drones' frames are estimated where they are not known exactly; drifts are 1 sigma.

    ``keyframe_s``: from one estimate of all frames to the next; ``settle_s``: how long a keyframe's entries are waited for (an
    exposure is half a second long, and needs its time to arrive). The sigmas are of each axis.
    """

    keyframe_s: Annotated[float, Meta(ge=0.2, le=10.0)] = 1.0
    settle_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.9
    gnss_sigma_m: Positive = 1.5  # by which a GNSS position wanders
    rtk_sigma_m: Positive = 0.05
    gnss_correlation_s: Positive = 40.0  # of both
    compass_drift_deg: NonNegative = 0.3  # by which the heading of an autopilot with GNSS wanders in a second
    slam_drift_m: NonNegative = 0.1  # level, after a metre flown, as the root of the distance: 1 % of 100 m
    slam_climb_m: NonNegative = 0.03  # the same upwards; a barometer or rangefinder helps
    slam_turn_deg: NonNegative = 0.1  # of the heading, after a metre flown
    slam_yaw_drift_deg: NonNegative = 0.1  # and after a second, as the root of the time
    wander_m: NonNegative = 0.03  # by which any position wanders in a second, as the root of the time
    jump_m: NonNegative = 0.2  # by which a jump of the localisation leaves the frame uncertain, and again for each second it took
    jump_yaw_deg: NonNegative = 2.0
    window_s: Positive = 30.0  # of sightings by which an unknown frame is found
    lead: Positive = 10.0  # of the best pose before every other one, in the logarithm of the likelihood, for it to be taken
    aligned_sigma_m: Positive = 1.5  # the same of its errors, at most
    aligned_yaw_deg: Positive = 5.0
    suspect_s: Positive = 30.0  # without a contradiction, for a drone that was contradicted to be believed again


class MissionConfig(_Section, frozen=True, kw_only=True):
    """What the swarm is to do. The same file on every drone."""

    name: str
    swarm: Identifier = "radron"
    nuclide: str = "Cs-137"
    drones: Annotated[tuple[DroneInMission, ...], Meta(min_length=1, max_length=64)]
    datum: DatumConfig | None = None  # none: the mission frame has no place on Earth, or nobody needs to know it
    area: AreaConfig
    ground: GroundConfig = GroundConfig()
    frames: FramesConfig = FramesConfig()
    survey: SurveyConfig = SurveyConfig()
    encirclement: EncirclementConfig = EncirclementConfig()
    limits: LimitsConfig = LimitsConfig()
    detection: DetectionConfig = DetectionConfig()
    fusion: FusionConfig = FusionConfig()
    track: TrackConfig = TrackConfig()

    def check(self, where: str) -> None:
        """Raise ConfigError where the values contradict each other; ``where`` is named in the text."""
        outline = Polygon(self.area.polygon_m)
        if not outline.is_valid or outline.area <= 0.0:
            raise ConfigError(
                f"{where}: area.polygon_m: {explain_validity(outline)}; give the corners of a simple polygon in order"
            )
        ids = [drone.id for drone in self.drones]
        doubles = sorted({name for name in ids if ids.count(name) > 1})
        if doubles:
            raise ConfigError(f"{where}: drones: the id {doubles[0]!r} is given twice; ids must differ")
        if self.area.floor_m >= self.area.ceiling_m:
            raise ConfigError(f"{where}: area.floor_m must be below area.ceiling_m")
        for name, height in (("survey", self.survey.height_m), ("encirclement", self.encirclement.height_m)):
            if not self.area.floor_m <= height <= self.area.ceiling_m:
                raise ConfigError(
                    f"{where}: {name}.height_m = {height:g} is outside area.floor_m .. area.ceiling_m "
                    f"({self.area.floor_m:g} .. {self.area.ceiling_m:g})"
                )
        if self.fusion.estimator == "given" and self.fusion.given is None:
            raise ConfigError(f"{where}: fusion.estimator = 'given' needs fusion.given.schedule")

    @property
    def mission_id(self) -> str:
        """16 hex digits that differ when anything in the mission differs."""
        content = msgspec.json.encode(self, order="sorted")
        return hashlib.blake2b(content, digest_size=8).hexdigest()


class PeerMeshConfig(_Section, frozen=True, kw_only=True):
    """Where the swarm's Zenoh sessions listen, by drone: ``{d1 = "tcp/10.7.1.11:7447", ...}``, the same on every drone.

    A drone listens at its own endpoint and dials those of the mission's drones before it: never both ways.
    """

    endpoints: dict[DroneId, str] = {}
    listen: str | None = None  # none: its own of ``endpoints``


class VisionConfig(_Section, frozen=True, kw_only=True):
    """Where the poses of a visual or LiDAR SLAM on board come from, a TCP feed ("host:port"); the autopilot gets them."""

    address: str


class VehicleConfig(_Section, frozen=True, kw_only=True):
    """The autopilot's onboard MAVLink link, as a MAVSDK address, and what is assumed of its localisation.

    ``gnss``: the autopilot flies by satellites; without, it has neither origin nor home, and is guided by vision.
    """

    address: str = "udpin://0.0.0.0:14540"
    connect_timeout_s: Annotated[float, Meta(gt=0.0, le=600.0)] = 5.0
    position_sigma_m: NonNegative = 0.15  # at least; the autopilot's own figure counts where it is larger
    yaw_sigma_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 1.0
    gnss: bool = True
    vision: VisionConfig | None = None  # none: there is none, or it goes to the autopilot by itself


class SightingsConfig(_Section, frozen=True, kw_only=True):
    """Where a sensor that sees the other drones (a camera for their lights, a ranging radio) tells of them: a TCP feed."""

    address: str | None = None  # "host:port"; none: there is no such sensor


class DetectorConfig(_Section, frozen=True, kw_only=True):
    """Where pixel hits come from.

    ``feed``: the simulation's TCP feed at ``address`` ("host:port"); ``t3pa``: ``file`` in real time; ``pypixet``: the camera,
    by the vendor's module with its files in ``pixet_folder``.
    """

    driver: Literal["none", "feed", "t3pa", "pypixet"] = "none"
    address: str | None = None
    file: str | None = None
    pixet_folder: str | None = None
    bias_v: Annotated[float, Meta(ge=-1000.0, le=1000.0)] | None = None  # none: what the camera's own configuration says


class RecorderConfig(_Section, frozen=True, kw_only=True):
    """The flight recorder: MCAP files in ``folder`` (none: no records), the oldest removed beyond ``limit_mb``."""

    folder: str | None = None
    limit_mb: Annotated[int, Meta(ge=16, le=1_000_000)] = 4096


class DroneConfig(_Section, frozen=True, kw_only=True):
    """What is particular to one vehicle.

    ``camera_rpy_deg``: rotation body <- camera as roll, pitch, yaw about the fixed body axes, degrees; the camera's z is the
    outward normal of its sensor, x runs along a pixel row, y up the rows. The default looks forward with y up.
    ``mission``: path of the mission file; relative paths in a drone file are from that file's folder.
    ``state``: folder for what must survive a restart in flight (none: a restarted agent stays out of the flight).
    """

    id: DroneId
    mission: str | None = None
    state: str | None = None
    camera_rpy_deg: tuple[Degrees, Degrees, Degrees] = (90.0, 0.0, 90.0)
    calibration: str | None = None  # folder with a.txt, b.txt, c.txt, t.txt; none: the simulation's nominal camera
    vehicle_lag_s: NonNegative = 0.38  # by which the vehicle follows its position setpoints
    mesh: PeerMeshConfig = PeerMeshConfig()
    vehicle: VehicleConfig = VehicleConfig()
    detector: DetectorConfig = DetectorConfig()
    sightings: SightingsConfig = SightingsConfig()
    recorder: RecorderConfig = RecorderConfig()


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file. Raises ConfigError where it is unreadable or not TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not TOML: {error}") from None


def load_toml(path: Path, kind: type[T]) -> T:
    """Read a TOML file into a config type.

    Raises:
        ConfigError: unreadable, not TOML, an unknown key (with the nearest known one), a value out of range.
    """
    return convert(read_toml(path), kind, str(path))


def load_mission(path: Path) -> MissionConfig:
    """Read and check a mission file, and read the elevation grid that it names."""
    mission = load_toml(path, MissionConfig)
    mission.check(str(path))
    return with_ground_grid(mission, path.parent)


def with_ground_grid(mission: MissionConfig, folder: Path) -> MissionConfig:
    """The mission with the content of its elevation grid, read from ``folder`` unless it is there already.

    Raises:
        ConfigError: the file cannot be read, or is too large.
    """
    ground = mission.ground
    if ground.grid is None or ground.grid_data is not None:
        return mission
    path = folder / ground.grid
    try:
        with path.open("rb") as file:
            data = file.read(GRID_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"ground.grid: {path}: cannot be read: {error.strerror}") from None
    if len(data) > GRID_BYTES:
        raise ConfigError(
            f"ground.grid: {path}: more than {GRID_BYTES // 1_000_000} MB; crop it to the area, or compress it (GeoTIFF)"
        )
    return replace(mission, ground=replace(ground, grid_data=data))


def convert(document: object, kind: type[T], where: str) -> T:
    """Fit a parsed document to a config type; errors name ``where``, the key and what is allowed."""
    try:
        return msgspec.convert(document, kind)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {_explain(str(error), kind)}") from None


def _explain(text: str, kind: type) -> str:
    """The words of msgspec's error with the key in front and what is allowed behind."""
    message, _, place = text.partition(" - at ")
    path = place.strip("`").removeprefix("$").lstrip(".")
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
