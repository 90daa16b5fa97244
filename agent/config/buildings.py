"""Walls and buildings that the mission knows: in the mission file, or in a GeoJSON file that it names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pymap3d
from msgspec import Meta, Struct
from shapely import Polygon
from shapely.validation import explain_validity

from agent.config.section import Coordinate, FileName, NonNegative, Positive, Section
from agent.errors import ConfigError
from protocol.units import Latitude, Longitude

Material = Literal["concrete", "brick", "wood", "glass", "steel"]
Point = tuple[Coordinate, Coordinate]
MAP_BYTES = 2_000_000  # limit of a GeoJSON file
MOST_CORNERS = 1000  # of all buildings together: each line of sight is cut with every side


class BuildingConfig(Section, frozen=True, kw_only=True):
    """A wall or a solid building, upright on the ground: outline (mission frame), height above ground, and what it is made of.

    ``attenuation_per_m``: linear attenuation coefficient for the nuclide's photons, in place of the material's: of a building
    with rooms, its mean over inside and walls.
    """

    footprint_m: Annotated[tuple[Point, ...], Meta(min_length=3, max_length=256)]
    height_m: Positive
    material: Material = "concrete"
    attenuation_per_m: NonNegative | None = None

    def check(self, where: str) -> None:
        """Raise ConfigError where the footprint is no simple polygon."""
        outline = Polygon(self.footprint_m)
        if not outline.is_valid or outline.area <= 0.0:
            raise ConfigError(f"{where}: footprint_m: {explain_validity(outline)}; give the corners of a simple polygon in order")


class BuildingsConfig(Section, frozen=True, kw_only=True):
    """What may stand between source and cameras, as far as it is known: it enters the counts and cones that a track of ``bayes``
    expects, not its search, and all that ``sources`` expects.

    ``file``: a GeoJSON file relative to the mission file's folder: polygons with the properties ``height_m`` and ``material`` or
    ``attenuation_per_m``. ``crs``: of its coordinates: ``EPSG:4326`` (longitude, latitude, as GeoJSON has them; needs the
    mission's ``datum``), or ``mission`` (metres of the mission frame). On load its buildings are added to ``known``.
    """

    file: FileName | None = None
    crs: Literal["EPSG:4326", "mission"] = "EPSG:4326"
    known: tuple[BuildingConfig, ...] = ()

    def check(self, where: str) -> None:
        """Raise ConfigError where a footprint is no simple polygon, or where there are too many."""
        for place, building in enumerate(self.known):
            building.check(f"{where}: buildings.known[{place}]")
        corners = sum(len(building.footprint_m) for building in self.known)
        if corners > MOST_CORNERS:
            raise ConfigError(f"{where}: buildings: {corners} corners; at most {MOST_CORNERS}: keep those in and near the area")


class _Properties(Struct):
    height_m: Positive
    material: Material = "concrete"
    attenuation_per_m: NonNegative | None = None


class _Geometry(Struct):
    type: Literal["Polygon"]
    coordinates: list[list[tuple[float, ...]]]


class _Feature(Struct):
    geometry: _Geometry
    properties: _Properties


class _Collection(Struct):
    features: list[msgspec.Raw]
    type: Literal["FeatureCollection"]


def read_buildings(path: Path, config: BuildingsConfig, datum: tuple[float, float, float] | None) -> BuildingsConfig:
    """The buildings with those of the file ``config`` names, and without that name.

    Args:
        path: the file.
        config: of the mission.
        datum: latitude, longitude (degrees) and height of the mission frame's origin; None where it is not known.

    Raises:
        ConfigError: the file cannot be read, is too large, or a feature of it is no polygon with such properties.
    """
    where = f"buildings.file: {path}"
    try:
        with path.open("rb") as file:
            data = file.read(MAP_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{where}: cannot be read: {error.strerror}") from None
    if len(data) > MAP_BYTES:
        raise ConfigError(f"{where}: more than {MAP_BYTES // 1_000_000} MB; crop it to the area")
    if config.crs == "EPSG:4326" and datum is None:
        raise ConfigError(f"{where}: longitudes and latitudes need the mission's datum; or give buildings.crs = 'mission'")
    try:
        collection = msgspec.json.decode(data, type=_Collection)
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise ConfigError(f"{where}: no GeoJSON FeatureCollection: {error}") from None
    found = []
    for place, raw in enumerate(collection.features):
        building = _building(raw, f"{where}: feature {place + 1}", datum if config.crs == "EPSG:4326" else None)
        building.check(f"{where}: feature {place + 1}")
        found.append(building)
    return msgspec.structs.replace(config, file=None, known=(*config.known, *found))


def _building(raw: msgspec.Raw, where: str, datum: tuple[float, float, float] | None) -> BuildingConfig:
    try:
        feature = msgspec.json.decode(raw, type=_Feature)
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise ConfigError(f"{where}: {error}") from None
    rings, properties = feature.geometry.coordinates, feature.properties
    if len(rings) != 1:
        raise ConfigError(f"{where}: {len(rings)} rings; give one outline without holes, with the mean attenuation of its inside")
    corners = [corner[:2] for corner in rings[0]]
    if len(corners) > 1 and corners[0] == corners[-1]:
        corners = corners[:-1]
    try:
        if datum is not None:
            corners = [_on_ground(msgspec.convert(corner, _LonLat), datum) for corner in corners]
        return BuildingConfig(
            footprint_m=msgspec.convert(corners, _Outline),
            height_m=properties.height_m,
            material=properties.material,
            attenuation_per_m=properties.attenuation_per_m,
        )
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {error}") from None


_LonLat = tuple[Longitude, Latitude]
_Outline = Annotated[tuple[Point, ...], Meta(min_length=3, max_length=256)]


def _on_ground(corner: _LonLat, datum: tuple[float, float, float]) -> tuple[float, float]:
    """A longitude and latitude in the mission frame, to the millimetre, so that it is the same on all computers."""
    east, north, _ = pymap3d.geodetic2enu(corner[1], corner[0], datum[2], *datum)
    return round(float(east), 3), round(float(north), 3)
