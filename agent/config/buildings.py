"""Walls and buildings that the mission knows: in the mission file, or in a GeoJSON file that it names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec
import pymap3d
from msgspec import Meta, Struct
from shapely import Polygon
from shapely.validation import explain_validity

from radron.agent.config.geojson import Feature, read_features
from radron.agent.config.section import Coordinate, FileName, NonNegative, Positive, Section
from radron.agent.errors import ConfigError
from radron.agent.inputs import read_bytes

Material = Literal["concrete", "brick", "wood", "glass", "steel"]
Point = tuple[Coordinate, Coordinate]
MAX_MAP_BYTES = 2_000_000  # of a GeoJSON file
MAX_CORNERS = 1000  # of all buildings together: each line of sight is cut with every side


class BuildingConfig(Section, frozen=True, kw_only=True):
    """A wall or a solid building, upright on the ground: outline (mission frame), height above ground, and material.

    ``attenuation_per_m``: linear attenuation coefficient for the nuclide's photons, in place of the material's coefficient; for a
    building with rooms, the mean over inside and walls.
    """

    footprint_m: Annotated[tuple[Point, ...], Meta(min_length=3, max_length=256)]
    height_m: Positive
    material: Material = "concrete"
    attenuation_per_m: NonNegative | None = None

    def check(self, where: str) -> None:
        """Raise ConfigError, whose text begins with ``where``, if the building's outline is not a simple polygon."""
        outline = Polygon(self.footprint_m)
        if not outline.is_valid or outline.area <= 0.0:
            raise ConfigError(f"{where}: footprint_m: {explain_validity(outline)}; give the corners of a simple polygon in order")


class BuildingsConfig(Section, frozen=True, kw_only=True):
    """Known walls and buildings between source and cameras, which attenuate the photons.

    They enter the counts and cones expected by a track of ``bayes``, not by its search, and all expectations of ``sources``.
    ``file``: a GeoJSON file in the mission file's folder, by its name: polygons with the properties ``height_m`` and ``material``
    or ``attenuation_per_m``. ``crs``: coordinate system of that file: ``EPSG:4326`` (longitude, latitude, as GeoJSON has them;
    needs the mission's ``datum``), or ``mission`` (metres of the mission frame). On load its buildings are added to ``known``.
    """

    file: FileName | None = None
    crs: Literal["EPSG:4326", "mission"] = "EPSG:4326"
    known: tuple[BuildingConfig, ...] = ()

    def check(self, where: str) -> None:
        """Raise ConfigError if an outline is not a simple polygon, or if all outlines together have too many corners."""
        for place, building in enumerate(self.known):
            building.check(f"{where}: buildings.known[{place}]")
        corners = sum(len(building.footprint_m) for building in self.known)
        if corners > MAX_CORNERS:
            raise ConfigError(f"{where}: buildings: {corners} corners; at most {MAX_CORNERS}: keep those in and near the area")


class _Properties(Struct):
    height_m: Positive
    material: Material | None = None
    attenuation_per_m: NonNegative | None = None


def read_buildings(path: Path, config: BuildingsConfig, datum: tuple[float, float, float] | None) -> BuildingsConfig:
    """Return the configuration with the buildings of its GeoJSON file added to ``known``, and without the file's name.

    Args:
        path: the GeoJSON file.
        config: the mission's section ``buildings``.
        datum: latitude, longitude (degrees) and height (m) of the mission frame's origin; None if unknown.

    Raises:
        ConfigError: the file cannot be read or is too large, or one of its features is not a polygon with the required
            properties.
    """
    where = f"buildings.file: {path}"
    if config.crs == "mission":
        datum = None
    elif datum is None:
        raise ConfigError(f"{where}: longitudes and latitudes need the mission's datum; or give buildings.crs = 'mission'")
    data = read_bytes(path, MAX_MAP_BYTES, where, "crop it to the area")
    features = read_features(where, data, datum[:2] if datum is not None else None)
    found = [_building(feature, f"{where}: feature {feature.number}", datum) for feature in features]
    return msgspec.structs.replace(config, file=None, known=(*config.known, *found))


def _building(feature: Feature, where: str, datum: tuple[float, float, float] | None) -> BuildingConfig:
    outline = feature.geometry
    if outline.geom_type != "Polygon":
        raise ConfigError(f"{where}: is a {outline.geom_type}; a building or wall is a Polygon or MultiPolygon")
    if len(outline.interiors):
        raise ConfigError(
            f"{where}: {1 + len(outline.interiors)} rings; give an outline without holes, with the mean attenuation of its inside"
        )
    corners = [(x, y) for x, y, *_ in outline.exterior.coords[:-1]]
    try:
        properties = msgspec.convert(feature.properties, _Properties)
        building = BuildingConfig(
            footprint_m=msgspec.convert(
                corners if datum is None else [_on_ground(corner, datum) for corner in corners], _Outline
            ),
            height_m=properties.height_m,
            material=properties.material or "concrete",
            attenuation_per_m=properties.attenuation_per_m,
        )
    except msgspec.ValidationError as error:
        allowed = f"height_m, and material ({', '.join(get_args(Material))}) or attenuation_per_m"
        raise ConfigError(f"{where}: {error}; its properties are {allowed}") from None
    building.check(where)
    return building


_Outline = Annotated[tuple[Point, ...], Meta(min_length=3, max_length=256)]


def _on_ground(corner: tuple[float, float], datum: tuple[float, float, float]) -> tuple[float, float]:
    """A longitude and latitude in the mission frame, to the millimetre, so that it is the same on all computers."""
    east, north, _ = pymap3d.geodetic2enu(corner[1], corner[0], datum[2], *datum)
    return round(float(east), 3), round(float(north), 3)
