"""The mission file: the swarm's task and its estimator. The same on every drone.

Its hash is the mission id: drones with different mission ids refuse to start together.
"""

from __future__ import annotations

import hashlib
from math import dist
from typing import Annotated, ClassVar, Literal

import msgspec
from msgspec import Meta
from shapely import Point, Polygon
from shapely.validation import explain_validity

from radron.agent.config.buildings import BuildingsConfig
from radron.agent.config.estimators import FusionConfig
from radron.agent.config.frames import FramesConfig
from radron.agent.config.responses import ResponseContent, ResponseTable, check_detectors
from radron.agent.config.section import (
    Coordinate,
    Degrees,
    DetectorKind,
    FileName,
    NonNegative,
    Positive,
    Section,
    content_of,
)
from radron.agent.config.sizes import check_names, check_sizes
from radron.agent.config.survey import SurveyConfig
from radron.agent.errors import ConfigError
from radron.protocol.units import DroneId, Identifier, Latitude, Longitude, Nuclide

Corner = tuple[Coordinate, Coordinate]
SourceHeight = Annotated[float, Meta(ge=0.0, le=50.0)]
AUTO = "auto"  # in the place of a nuclide: any
_OF_ONE_NUCLIDE = frozenset({"bayes", "field", "paper", "paper-geometric"})  # estimators that take all cones for that nuclide's
MOST_LANES = 300  # over an area: they are planned between two steps in flight (0.2 s on a desktop), again when a drone drops out
_RETURN_SHARE = 0.9  # of the ceiling, for the highest return: heights above a launch place are good to a metre or two
MAX_GRID_BYTES = 2_000_000  # limit of an elevation grid: 1 km2 at 1 m, compressed


class AreaConfig(Section, frozen=True, kw_only=True):
    """The area to search, and the fence around it that no drone may leave.

    ``polygon_m``: corners of the area in order, in the mission frame (east, north; metres). ``fence_margin_m``: distance of the
    fence outside the polygon. ``floor_m``, ``ceiling_m``: least and greatest flight height above the ground.
    """

    polygon_m: Annotated[tuple[Corner, ...], Meta(min_length=3, max_length=256)]
    fence_margin_m: NonNegative = 30.0
    floor_m: NonNegative = 1.5
    ceiling_m: Positive = 60.0


class EncirclementConfig(Section, frozen=True, kw_only=True):
    """The circular flight of all drones around the estimated source, the hypothesis (paper, Sec. V-C).

    ``law``: the control law of the paper, or the smooth one. With the smooth law and an estimator that states its covariance, the
    radius is ``nearest_m`` plus the RMS position error of the hypothesis, ``radius_m`` at most, and the height is in proportion
    to the radius: ``height_m`` at ``radius_m``. ``steps``, ``step_s``: number and length of the steps for which the flight is
    planned.
    """

    law: Literal["paper", "smooth"] = "smooth"
    radius_m: Positive = 12.0
    nearest_m: Positive = 6.0
    speed_mps: Positive = 3.0
    height_m: Positive = 3.0
    steps: Annotated[int, Meta(ge=2, le=63)] = 30  # K
    step_s: Annotated[float, Meta(gt=0.0, le=2.0)] = 0.2  # Delta T
    bias_rad: Annotated[float, Meta(ge=0.0, le=1.6)] = 0.05  # beta


class LimitsConfig(Section, frozen=True, kw_only=True):
    """Limits of each vehicle's motion, and the least distance between two vehicles (``separation_m``)."""

    speed_mps: Positive = 8.0
    acceleration_mps2: Positive = 4.0
    jerk_mps3: Positive = 20.0
    climb_mps: Positive = 2.0
    separation_m: Positive = 3.0


class DetectionConfig(Section, frozen=True, kw_only=True):
    """Limits by which a pair of pixel clusters is accepted as one Compton-scattered photon, which gives a cone of possible
    directions.

    Energies in keV, cluster sizes in pixels, times in ns. The rates that estimator ``bayes`` expects were measured with the
    default values (benchmarks/channel_response.py): with other values, except for ``minimum_pixels``, its activities are biased.
    """

    energy_window: Annotated[float, Meta(gt=0.0, lt=1.0)] = 0.2  # share of the line's energy, on each side
    minimum_pixels: Annotated[int, Meta(ge=2, le=1000)] = 6  # of both clusters together (paper: 15)
    minimum_photon_kev: NonNegative | None = None  # of a cone; none: the kinematic limit of the line, less 10 keV (Cs-137: 174)
    maximum_electron_kev: Positive | None = None  # of a cone; none: the line's Compton edge (Cs-137: 477)
    cluster_threshold_kev: NonNegative = 5.0
    cluster_gap_ns: Positive = 100.0
    coincidence_window_ns: Positive = 100.0


class TrackConfig(Section, frozen=True, kw_only=True):
    """Limits of the flight around a found source: when it ends, when the source counts as lost, and which source comes next.

    After ``duration_s`` of tracking the swarm returns.

    When the source counts as lost: with an estimator that states its covariance, while the hypothesis' RMS position error is
    above ``lost_rms_m``; the swarm then encircles it on a circle that fits this error. With ``bayes`` this happens only without
    any measurements: otherwise ``bayes`` gives the track up earlier (``given_up_rms_m``), and searches from its posterior. With
    any other estimator, after ``no_cone_timeout_s`` without a cone; the swarm then searches outward from the last hypothesis on a
    circle that grows by ``widening_mps``.

    Each of several sources is circled until the drones together have watched it for ``each_s`` per drone. Then the ``policy``
    decides: the ``strongest`` source, ``each`` in turn again, or a source of the nuclide named (without one, the strongest).
    """

    later = frozenset({"policy", "each_s"})

    lost_rms_m: Positive = 15.0
    no_cone_timeout_s: Positive | None = 20.0
    widening_mps: NonNegative = 0.5
    duration_s: Positive | None = None
    policy: Annotated[str, Meta(pattern=r"^(strongest|each|[A-Z][a-z]?-[0-9]{1,3}m?)\Z")] = "strongest"
    each_s: Positive = 30.0


class SafetyConfig(Section, frozen=True, kw_only=True):
    """Reaction of the swarm to the failure of a drone, of its radio, or of its agent (the program on its onboard computer).

    ``alone``: reaction of a drone that hears no other drone of the flight, or is heard by none: continue (``keep``), stay clear
    of the other drones (``hold``), or return. ``agent_lost``: the autopilots' failsafe without their agents (PX4:
    COM_OBL_RC_ACT); the other drones keep clear of a drone that flies it, and preflight checks it. ``return_height_m``: height of
    the first drone's return by its autopilot, above its launch place; each further drone returns ``return_layer_m`` higher, or
    less where the ceiling does not allow as much. ``battery_reserve``: share of the battery below which a drone returns, one
    drone after the other; below half of this share it returns at once.
    """

    alone: Literal["keep", "hold", "return"] = "keep"
    agent_lost: Literal["return", "land", "hold"] = "return"
    return_height_m: Positive = 10.0
    return_layer_m: NonNegative = 4.0
    battery_reserve: Annotated[float, Meta(ge=0.0, le=0.9)] = 0.2


class DroneInMission(Section, frozen=True, kw_only=True):
    """A member of the swarm, with origin and heading of its local frame (in which its autopilot flies) in the mission frame at
    the start.

    ``localization``: ``exact``: the given origin and heading hold for the whole flight. Otherwise it names the vehicle's kind of
    localisation, and origin and heading of the frame are estimated in flight, starting with the errors ``origin_sigma_m`` (1
    sigma of each axis) and ``yaw_sigma_deg`` (1 sigma; 180: unknown heading).

    ``detector``: kind of its detector: the Compton camera ``minipix``, or an ordinary detector that gives a ``spectrum`` or
    ``counts`` alone. ``response``: only of an ordinary detector, its table of response: a shipped one by its name, or a file in
    the mission file's folder. The table belongs to the mission, also to its id.
    """

    later: ClassVar[frozenset[str]] = frozenset({"detector", "response"})

    id: DroneId
    origin_m: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    yaw_deg: Degrees = 0.0
    localization: Literal["exact", "gnss", "rtk", "slam"] = "exact"
    origin_sigma_m: NonNegative = 1.0
    yaw_sigma_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 5.0
    detector: DetectorKind = "minipix"
    response: FileName | None = None

    @property
    def is_exact(self) -> bool:
        """Whether the given origin and heading of the local frame hold for the whole flight, so that nothing is estimated."""
        return self.localization == "exact"


class DatumConfig(Section, frozen=True, kw_only=True):
    """The place on Earth of the mission frame's origin (WGS84, height above the ellipsoid). The frame's axes point east, north
    and up there.
    """

    latitude_deg: Latitude
    longitude_deg: Longitude
    altitude_m: Coordinate = 0.0


class GroundConfig(Section, frozen=True, kw_only=True):
    """The ground on which the source lies, in the mission frame: a plane, or an elevation grid.

    ``height_m``: height of the plane at the mission frame's origin; ``slope``: its rise per metre east and north. ``grid``: an
    ESRI ASCII grid or GeoTIFF file instead, by its name in the mission file's folder.

    ``grid_crs``: coordinate system of the grid: ``mission`` (metres of the mission frame), ``EPSG:4326`` (degrees, WGS84) or the
    code of a UTM zone (EPSG:32601 .. 32660, 32701 .. 32760); none: the system that the GeoTIFF itself names, else ``mission``.
    Georeferenced grids need the mission's ``datum``. ``geoid_m``: height of the grid's zero, mostly sea level, above the
    ellipsoid. ``grid_data``: the file's content, filled on load: it is part of the mission, its id and its records.
    """

    height_m: Coordinate = 0.0
    slope: tuple[Annotated[float, Meta(ge=-2.0, le=2.0)], Annotated[float, Meta(ge=-2.0, le=2.0)]] = (0.0, 0.0)
    grid: FileName | None = None
    grid_crs: Annotated[str, Meta(pattern=r"^(mission|EPSG:(4326|32[67](0[1-9]|[1-5][0-9]|60)))$")] | None = None
    geoid_m: Annotated[float, Meta(ge=-200.0, le=200.0)] = 0.0
    grid_data: Annotated[bytes, Meta(max_length=MAX_GRID_BYTES)] | None = None


class MissionConfig(Section, frozen=True, kw_only=True):
    """The task of the swarm: area, drones, search, flight around the source, and limits. Every drone has the same mission file.

    ``nuclide``: the source's nuclide, or a list of candidates, or ``auto``: any known nuclide. None given: ``auto`` with the
    estimator ``sources``, else Cs-137. More than one candidate needs an estimator that reads spectra, such as ``sources``.
    ``source_height_m``: least and greatest height of a source above the ground, which only ``sources`` estimates.
    """

    name: str
    swarm: Identifier = "radron"
    nuclide: str | Annotated[tuple[Nuclide, ...], Meta(min_length=1, max_length=32)] = ""
    source_height_m: tuple[SourceHeight, SourceHeight] = (0.0, 0.0)
    drones: Annotated[tuple[DroneInMission, ...], Meta(min_length=1, max_length=64)]
    datum: DatumConfig | None = None  # none: the mission frame's place on Earth is unknown or not needed
    area: AreaConfig
    ground: GroundConfig = GroundConfig()
    buildings: BuildingsConfig = BuildingsConfig()
    frames: FramesConfig = FramesConfig()
    survey: SurveyConfig = SurveyConfig()
    encirclement: EncirclementConfig = EncirclementConfig()
    limits: LimitsConfig = LimitsConfig()
    detection: DetectionConfig = DetectionConfig()
    fusion: FusionConfig = FusionConfig()
    track: TrackConfig = TrackConfig()
    safety: SafetyConfig = SafetyConfig()
    responses: Annotated[
        tuple[ResponseContent, ...], Meta(max_length=64)
    ] = ()  # tables of response of ordinary detectors, filled on load
    later = frozenset({"buildings", "source_height_m", "responses"})

    def __post_init__(self) -> None:
        if not self.nuclide:
            msgspec.structs.force_setattr(self, "nuclide", AUTO if self.fusion.estimator == "sources" else "Cs-137")

    def named(self, where: str = "mission") -> str:
        """Return the name of the source's nuclide. Raise ConfigError, whose text begins with ``where``, if there are several
        candidates.
        """
        if self.one_nuclide is None:
            raise ConfigError(
                f"{where}: nuclide: {self.nuclide_text!r} is more than one, and only fusion.estimator = 'sources' tells which it "
                "is; fly that, or name one nuclide (`radron-agent cones FILE --nuclide auto` recognises that of a recording)"
            )
        return self.one_nuclide

    @property
    def one_nuclide(self) -> str | None:
        """The name of the source's nuclide if the mission names exactly one; None if there are several candidates."""
        if isinstance(self.nuclide, tuple):
            return self.nuclide[0] if len(self.nuclide) == 1 else None
        return None if self.nuclide == AUTO else self.nuclide

    @property
    def nuclide_text(self) -> str:
        """The source's possible nuclides as text for people: ``Cs-137``, ``Cs-137, Co-60`` or ``auto``."""
        return ", ".join(self.nuclide) if isinstance(self.nuclide, tuple) else self.nuclide

    def member(self, drone: str) -> DroneInMission:
        """Return the mission's entry for the drone with this id. Raise ConfigError if the mission has no such drone."""
        found = {each.id: each for each in self.drones}
        if drone not in found:
            raise ConfigError(f"drone {drone!r} is not in the mission; its drones are {', '.join(found)}")
        return found[drone]

    def response(self, drone: str) -> ResponseContent | None:
        """Return name and content of the table of response of a drone's ordinary detector; None for a Compton camera.

        Raises ConfigError if the mission has no such drone, or not its table: the files of a mission file are read on load.
        """
        name = self.member(drone).response
        found = next((one for one in self.responses if one.name == name), None)
        if name is not None and found is None:
            raise ConfigError(f"drones: {drone}: the table of response {name!r} was not read")
        return found

    def table(self, drone: str) -> ResponseTable | None:
        """Return the table of response of a drone's ordinary detector; None for a Compton camera. Raises as ``response``."""
        found = self.response(drone)
        return None if found is None else found.table

    def check(self, where: str) -> None:
        """Raise ConfigError if values of the mission contradict each other, or exceed limits; ``where`` (the file's name) begins
        the text.
        """
        if self.fusion.estimator in _OF_ONE_NUCLIDE:
            self.named(where)
            if self.source_height_m[1] > 0.0:
                raise ConfigError(f"{where}: source_height_m: only fusion.estimator = 'sources' knows sources above the ground")
        low_m, high_m = self.source_height_m
        if low_m > high_m or low_m == high_m > 0.0:
            raise ConfigError(f"{where}: source_height_m: {low_m:g} is not below {high_m:g}; give least and greatest height")
        outline = Polygon(self.area.polygon_m)
        if not outline.is_valid or outline.area <= 0.0:
            raise ConfigError(
                f"{where}: area.polygon_m: {explain_validity(outline)}; give the corners of a simple polygon in order"
            )
        width_m = min(_sides_m(outline))
        if width_m > MOST_LANES * self.survey.lane_spacing_m:
            raise ConfigError(
                f"{where}: area.polygon_m is {width_m:.0f} m wide; with survey.lane_spacing_m = {self.survey.lane_spacing_m:g} "
                f"that makes more than {MOST_LANES} lanes; search a smaller area, or use wider lanes"
            )
        self.survey.check(where)
        self.buildings.check(where)
        check_detectors(self, where)
        check_names(self, where)
        check_sizes(self, where)
        ids = [drone.id for drone in self.drones]
        doubles = sorted({name for name in ids if ids.count(name) > 1})
        if doubles:
            raise ConfigError(f"{where}: drones: the id {doubles[0]!r} is given twice; ids must differ")
        fence = outline.buffer(self.area.fence_margin_m)
        for drone in self.drones:
            beyond_m = fence.distance(Point(drone.origin_m[:2]))
            if beyond_m > 0.0:
                raise ConfigError(
                    f"{where}: drones: the launch place of {drone.id} is {beyond_m:.1f} m outside the fence; move it, or give a "
                    "larger area or area.fence_margin_m"
                )
        if self.fusion.estimator == "given" and self.fusion.given is None:
            raise ConfigError(f"{where}: fusion.estimator = 'given' needs fusion.given.schedule")

    @property
    def return_heights_m(self) -> tuple[float, ...]:
        """Heights (m) above its launch place at which each drone's autopilot returns, in the order of ``drones``.

        Each drone has a height of its own, so that drones that return at once do not meet.
        """
        highest_m = _RETURN_SHARE * self.area.ceiling_m
        lowest_m = min(self.safety.return_height_m, highest_m)
        layer_m = min(self.safety.return_layer_m, (highest_m - lowest_m) / max(len(self.drones) - 1, 1))
        return tuple(round(lowest_m + layer_m * index, 2) for index in range(len(self.drones)))

    def return_height_m(self, drone: str) -> float:
        """Return the height (m) above its launch place at which this drone's autopilot returns, as in ``return_heights_m``."""
        return self.return_heights_m[[member.id for member in self.drones].index(drone)]

    @property
    def turn_s(self) -> float:
        """Camera time (s), summed over all drones, for which one of several sources is watched before the swarm flies to the
        next.
        """
        return self.track.each_s * len(self.drones)

    @property
    def mission_id(self) -> str:
        """Identifier of the mission's content, 16 hex digits: a hash that differs when anything in the mission differs."""
        content = msgspec.json.encode(content_of(self), order="sorted")
        return hashlib.blake2b(content, digest_size=8).hexdigest()


def _sides_m(outline: Polygon) -> tuple[float, float]:
    """The sides of the smallest rectangle around it."""
    corners = outline.minimum_rotated_rectangle.exterior.coords
    first, second, third = corners[:3]
    return dist(first, second), dist(second, third)
