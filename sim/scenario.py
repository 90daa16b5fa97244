"""Scenario files: a mission, and the truth for its simulation. The agents see the mission only."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import shapely
from msgspec import Meta, Struct
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.config.drone import DetectorConfig, DroneConfig, ResponseConfig, VehicleConfig
from radron.agent.config.loading import convert, merged, read_toml, with_files
from radron.agent.config.mission import MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.fusion.registry import check_estimator
from radron.sim.faults.kinds import AnyFault, check_faults, read_faults
from radron.sim.radiation.camera import CameraTruth
from radron.sim.radiation.crystal.detectors import DETECTORS
from radron.sim.radiation.crystal.emulated import DEVICE_STEP_KEV, OrdinaryTruth
from radron.sim.radiation.nuclides import NUCLIDES
from radron.sim.radiation.truth import GroundTruth
from radron.sim.vehicle.multirotor import MultirotorTruth
from radron.sim.world.contaminationtruth import ContaminationTruth
from radron.sim.world.launch import StartTruth
from radron.sim.world.localization import LocalizationTruth
from radron.sim.world.localizers import check_vehicles
from radron.sim.world.owncameras import OwnCamera
from radron.sim.world.radio import RadioTruth
from radron.sim.world.sightings import SightingTruth
from radron.sim.world.sourcetruth import MAX_COURSE_S, Duration, RandomSourcesTruth, SourceTruth
from radron.sim.world.terrain import TerrainTruth
from radron.sim.world.walls import WallTruth

COMING_HOME_S = 300.0  # return and landing, with a large reserve
_ABREAST_M, _INSIDE_M = 5.0, 3.0  # between added launch places, and from them to the fence
_FOLDER = Path(__file__).parent / "scenarios"


class _Section(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    pass


class EndTruth(_Section, frozen=True, kw_only=True):
    """When a simulated flight ends, and when its source counts as lost.

    A flight ends when all drones have landed, ``search_s`` after its search has begun without an estimate, or after ``track_s``
    of tracking; a mission with a tracking time of its own (``mission.track.duration_s``) is flown until all have landed. In any
    case it ends ``after_s`` after the beginning of the search, if that is given, and ``COMING_HOME_S`` after the longest search
    and tracking together, even if a drone never lands.

    ``lost``: ``error``: the error of the estimate is above 20 m for 10 s (the flight goes on); ``no-cone``: the paper's rule, 20
    s without a Compton cone (ends the flight).
    """

    search_s: Duration = 900.0
    track_s: Duration = 180.0
    after_s: Duration | None = None
    lost: Literal["error", "no-cone"] = "error"

    def longest_s(self, mission: MissionConfig) -> float:
        """Return the longest duration of a simulated flight in seconds, from the beginning of the search."""
        longest_s = self.search_s + max(self.track_s, mission.track.duration_s or 0.0) + COMING_HOME_S
        return longest_s if self.after_s is None else min(longest_s, self.after_s)


class Scenario(_Section, frozen=True, kw_only=True):
    """A scenario: a mission, and the true sources, sensors, vehicles and faults for its simulation.

    The sources of ``source``, ``sources`` and ``random_sources`` exist together; each may be left out.
    """

    name: str
    description: str
    mission: MissionConfig
    source: SourceTruth | None = None
    sources: Annotated[tuple[SourceTruth, ...], Meta(max_length=8)] = ()
    random_sources: RandomSourcesTruth | None = None
    contamination: Annotated[tuple[ContaminationTruth, ...], Meta(max_length=8)] = ()  # of the ground, beside the sources
    terrain: TerrainTruth = TerrainTruth()
    walls: tuple[WallTruth, ...] = ()
    camera: CameraTruth = CameraTruth()
    cameras: dict[str, OwnCamera] = {}  # by drone: cameras that differ
    ordinary: dict[str, OrdinaryTruth] = {}  # by drone: ordinary detectors in the place of cameras
    ground: GroundTruth | None = None  # None: no ground that scatters or emits photons, as in the paper's data
    vehicle: MultirotorTruth = MultirotorTruth()
    localization: LocalizationTruth = LocalizationTruth()
    sightings: SightingTruth | None = None  # None: no relative observations
    radio: RadioTruth = RadioTruth()
    start: StartTruth = StartTruth()
    end: EndTruth = EndTruth()
    response: ResponseConfig = ResponseConfig()  # of the vehicles by the drone files, whether true or not
    fault: tuple[AnyFault, ...] = ()

    @property
    def measured(self) -> bool:
        """Whether the drones' cameras are simulated.

        They are simulated also without a source, but not if the source's position is given to the agents.
        """
        given = self.mission.fusion.estimator == "given"
        sources = self.source is not None or bool(self.sources) or self.random_sources is not None
        return not given or sources or bool(self.contamination)

    def drone_file(self, drone: str) -> DroneConfig:
        """Return a drone's file in a flight in one process, without links."""
        return DroneConfig(id=drone, vehicle=VehicleConfig(response=self.response), detector=self.detector_file(drone))

    def detector_file(self, drone: str, address: str | None = None) -> DetectorConfig:
        """Return the section ``[detector]`` of a drone's file: its kind, and its feed at ``address``; None: no feed."""
        detector = DetectorConfig() if address is None else DetectorConfig(driver="feed", address=address)
        truth = self.ordinary.get(drone)
        if truth is None:
            return detector
        return replace(detector, kind=DETECTORS[truth.detector].kind, energy_kev=(0.0, DEVICE_STEP_KEV))

    def check(self, where: str) -> None:
        """Raise ConfigError if values contradict each other. ``where``: name of the file, for the error."""
        self.mission.check(where)
        check_estimator(self.mission.fusion.estimator, f"{where}: mission.fusion.estimator")
        nuclide = self.mission.one_nuclide
        if nuclide is not None and nuclide not in NUCLIDES:
            raise ConfigError(f"{where}: mission.nuclide: unknown nuclide {nuclide!r}; known: {', '.join(NUCLIDES)}")
        area = Polygon(self.mission.area.polygon_m)
        named = [("source", self.source), *((f"sources[{place}]", source) for place, source in enumerate(self.sources))]
        for name, source in named:
            if source is not None:
                source.check(area, where, name)
        if self.random_sources is not None:
            self.random_sources.check(area, where)
        self._check_contamination(area, where)
        if (self.mission.track.duration_s or 0.0) > MAX_COURSE_S:
            raise ConfigError(f"{where}: mission.track.duration_s: a simulated flight tracks for at most {MAX_COURSE_S:g} s")
        for wall in self.walls:
            wall.check(where)
        self.vehicle.check(where)
        self._check_localization(where)
        drones = [drone.id for drone in self.mission.drones]
        for name in self.cameras:
            if name not in drones:
                raise ConfigError(f"{where}: cameras.{name}: no such drone; there are {', '.join(drones)}")
        self._check_ordinary(where)
        check_faults(self.fault, drones, where)
        self.start.check(self.mission, where)

    def _check_ordinary(self, where: str) -> None:
        for name, truth in self.ordinary.items():
            truth.check(f"{where}: ordinary.{name}")
        wanted = {drone.id: drone.detector for drone in self.mission.drones if drone.detector != "minipix"}
        found = {name: DETECTORS[truth.detector].kind for name, truth in self.ordinary.items()}
        if found != wanted:
            raise ConfigError(f"{where}: ordinary: the mission has {wanted or 'no ordinary detectors'}, but these are {found}")
        if wanted and self.ground is None:
            raise ConfigError(f"{where}: ordinary: ordinary detectors are simulated over a ground only; give the section ground")

    def _check_contamination(self, area: Polygon, where: str) -> None:
        for place, contamination in enumerate(self.contamination):
            contamination.check(area, f"{where}: contamination[{place}]")
        if self.contamination and (self.ground is None or self.walls or self.terrain != TerrainTruth()):
            raise ConfigError(
                f"{where}: contamination is simulated on flat open ground alone; add [ground], and leave out walls and terrain"
            )

    def _check_localization(self, where: str) -> None:
        truth = self.localization
        check_vehicles(truth.vehicles, truth.liar, (drone.id for drone in self.mission.drones), where)
        receivers = [name for name, vehicle in truth.vehicles.items() if vehicle.reception is not None]
        if receivers and self.mission.datum is None:
            raise ConfigError(f"{where}: {receivers[0]} has a satellite receiver, but there is no mission.datum")


def shipped() -> list[str]:
    """Return the names of the scenarios that come with the package."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml") if not path.stem.endswith("-base"))


def load_scenario(name_or_path: str, *, with_grid: bool = True) -> Scenario:
    """Load a scenario that comes with the package by its name, or from a file by its path.

    ``with_grid``: also read the elevation grid and the buildings of the mission.

    Raises:
        ConfigError: unknown name, unreadable file, an invalid key or value.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml" and path.parent == Path():
        if name_or_path not in shipped():
            raise ConfigError(
                f"unknown scenario {name_or_path!r}; shipped: {', '.join(shipped())}; or give the path of a .toml file"
            )
        path = _FOLDER / f"{name_or_path}.toml"
    scenario = parse_scenario(_read(path), str(path))
    if not with_grid:
        return scenario
    return replace(scenario, mission=with_files(scenario.mission, path.parent))


def override(scenario: Scenario, values: Mapping[str, str | float]) -> Scenario:
    """Return a scenario with some of its values changed.

    Keys: ``radius_m`` and ``speed_mps`` (of the encirclement; the speed also of the survey), ``activity_bq`` and
    ``source_speed_mps``, ``drones`` (their number), or any dotted path such as ``mission.fusion.paper.process_noise_m2ps``.

    Raises:
        ConfigError: an unknown key or an invalid value.
    """
    document = msgspec.to_builtins(scenario)
    estimator = values.get("mission.fusion.estimator", "given")
    if scenario.mission.fusion.estimator == "given" and estimator != "given":
        raise ConfigError(f"{scenario.name}: its hypothesis is given, not estimated; it does not use estimator {estimator!r}")
    for key, value in values.items():
        if key == "drones":
            document["mission"]["drones"] = _line_up(document["mission"], _whole(key, value))
            continue
        for path in _SHORT.get(key, (key,)):
            _set(document, path, _number(value))
    where = f"{scenario.name} with {', '.join(f'{key}={value}' for key, value in values.items())}"
    return parse_scenario(document, where)


def chosen(scenario: Scenario, estimator: str | None, law: str | None) -> Scenario:
    """Return a scenario with another estimator and another flocking law (spacing of the drones on their circle), where given.

    Raises:
        ConfigError: an unknown name.
    """
    values = {"mission.fusion.estimator": estimator, "mission.encirclement.law": law}
    return override(scenario, {key: name for key, name in values.items() if name is not None})


_SHORT = {
    "radius_m": ("mission.encirclement.radius_m",),
    "speed_mps": ("mission.encirclement.speed_mps", "mission.survey.speed_mps"),
    "activity_bq": ("source.activity_bq",),
    "source_speed_mps": ("source.speed_mps",),
}


def _read(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, object]:
    """A scenario document. ``base = "other"`` takes missing values from another scenario: a file beside it, a shipped one, or any
    path. Of several, ``base = ["one", "other"]``, later ones override earlier ones.
    """
    document = read_toml(path)
    bases = document.pop("base", [])
    if isinstance(bases, str):
        bases = [bases]
    if not isinstance(bases, list) or not all(isinstance(base, str) for base in bases):
        raise ConfigError(f"{path}: base: expected the name or path of another scenario, or a list of them")
    whole: dict[str, object] = {}
    for base in bases:
        found = _base(path, base)
        if found.resolve() in (path.resolve(), *seen):
            raise ConfigError(f"{path}: base: {base!r} leads back to this file")
        whole = merged(whole, _read(found, (*seen, path.resolve())))
    return merged(whole, document)


def _base(path: Path, base: str) -> Path:
    """Return the file of a base named in ``path``: beside it first, then among the shipped ones."""
    named = base if base.endswith(".toml") else f"{base}.toml"
    for folder in (path.parent, _FOLDER):
        try:
            if (folder / named).is_file():
                return folder / named
        except OSError:  # an impossible file name
            break
    known = ", ".join(sorted(file.stem for file in _FOLDER.glob("*.toml")))
    raise ConfigError(f"{path}: base: there is no {named!r} in {path.parent}, nor among the shipped scenarios: {known}")


def parse_scenario(document: dict[str, Any], where: str) -> Scenario:
    """Convert the content of a scenario file (with its base file merged in) to a scenario.

    ``where``: name of the file, for errors.

    Raises:
        ConfigError: an invalid key or value.
    """
    read_faults(document.get("fault", ()), where)  # first, for errors that name kinds and keys
    scenario = convert(document, Scenario, where)
    scenario.check(where)
    return scenario


def _set(document: dict[str, object], path: str, value: object) -> None:
    *parents, last = path.split(".")
    section: object = document
    for name in parents:
        section = section.get(name) if isinstance(section, dict) else None
    if not isinstance(section, dict) or last not in section:
        raise ConfigError(f"there is no {path!r} in this scenario; give radius_m, speed_mps, drones or a dotted path")
    section[last] = value


def _number(value: str | float) -> object:
    if not isinstance(value, str):
        return value
    try:
        return tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return value


def _whole(key: str, value: str | float) -> int:
    number = _number(value)
    if not isinstance(number, int | float) or not math.isfinite(number) or number != int(number) or not 0 < number <= 64:
        raise ConfigError(f"{key}: expected a whole number from 1 to 64, not {value!r}")
    return int(number)


def _line_up(mission: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """``count`` drones: the given ones, then further ones east of the last, 5 m apart, as far as the fence allows; then west of
    the first, then in further rows north of these.
    """
    drones, area = mission["drones"], mission["area"]
    fence = Polygon(area["polygon_m"]).buffer(area["fence_margin_m"] - _INSIDE_M)
    (first, _, _), (x, y, z) = drones[0]["origin_m"], drones[-1]["origin_m"]
    reach = range(1, 65)
    beside = [x + _ABREAST_M * k for k in reach] + [first - _ABREAST_M * k for k in reach]
    rows = [(east, y) for east in beside] + [
        (east, y + _ABREAST_M * row) for row in reach for east in sorted((*(one["origin_m"][0] for one in drones), *beside))
    ]
    inside = (place for place in rows if shapely.contains_xy(fence, *place))
    missing = zip(range(1, count - len(drones) + 1), inside, strict=False)
    return [*drones[:count], *({"id": f"x{k}", "origin_m": (*place, z), "yaw_deg": 0.0} for k, place in missing)]
