"""GeoJSON files (RFC 7946) of users: the mission's buildings, and layers under the page's map."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from radron.agent.errors import ConfigError
from radron.agent.inputs import text_of

MAX_DISTANCE_DEG = 1.0  # from the mission's datum to the nearest feature: 111 km
MAX_SHARE_SWAPPED = 0.1  # of that distance, with latitude and longitude swapped: then they are
MIN_DISTANCE_DEG = 0.01  # least distance for a check of swapped coordinates: 1.1 km
_WGS84 = re.compile(r"(CRS84|EPSG:+4326)$")
_TURN_DEG = 360.0


@dataclass(frozen=True, slots=True)
class Feature:
    """One shape of a GeoJSON file, with its properties.

    ``number``: number of the feature in the file, from 1. ``geometry``: a single part, neither empty nor a collection.
    """

    number: int
    geometry: BaseGeometry
    properties: Mapping[str, object]


def read_features(where: str, data: bytes, place: tuple[float, float] | None) -> list[Feature]:
    """Read the shapes of a GeoJSON file: a FeatureCollection, a Feature or a bare geometry.

    A feature of several parts gives one shape for each part; a feature without geometry gives none.

    Args:
        where: begin of the error texts, such as the file's name.
        data: content of the file.
        place: latitude and longitude (degrees) of the mission's datum, if the coordinates are in WGS84; None: another system.

    Raises:
        ConfigError: not GeoJSON, not in WGS84, latitude and longitude swapped, or far from the place.
    """
    try:
        document = msgspec.json.decode(text_of(data))
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise ConfigError(f"{where}: is not GeoJSON (RFC 7946): {error}") from None
    features = document.get("features") if _is(document, "FeatureCollection") else [document]
    if not isinstance(features, list):
        raise ConfigError(f"{where}: is not GeoJSON (RFC 7946): no list of features")
    found = [part for number, one in enumerate(features, 1) for part in _parts(number, one, f"{where}: feature {number}")]
    if place is not None:
        _check_place(where, document, found, place)
    return found


def _is(document: Any, kind: str) -> bool:
    return isinstance(document, dict) and document.get("type") == kind


def _parts(number: int, feature: Any, where: str) -> Iterator[Feature]:
    geometry, properties = (feature.get("geometry"), feature.get("properties")) if _is(feature, "Feature") else (feature, None)
    if geometry is None:
        return
    try:
        whole = shapely.from_geojson(msgspec.json.encode(geometry).decode())
    except (shapely.GEOSException, TypeError, ValueError) as error:
        raise ConfigError(f"{where}: its geometry is not GeoJSON (RFC 7946): {error}") from None
    for part in _flat(whole):
        yield Feature(number, part, properties if isinstance(properties, dict) else {})


def _flat(geometry: BaseGeometry) -> Iterator[BaseGeometry]:
    if hasattr(geometry, "geoms"):
        for part in geometry.geoms:
            yield from _flat(part)
    elif not geometry.is_empty:
        yield geometry


def _check_place(where: str, document: Any, features: list[Feature], place: tuple[float, float]) -> None:
    """Refuse coordinates that are no longitudes and latitudes (degrees, WGS84) near the place."""
    convert = "ogr2ogr -t_srs EPSG:4326 makes them so"
    crs = document.get("crs")  # of files older than RFC 7946
    properties = crs.get("properties") if isinstance(crs, dict) else None
    if crs is not None and not (isinstance(properties, dict) and _WGS84.search(str(properties.get("name")))):
        raise ConfigError(f"{where}: its coordinates are not in WGS84 (RFC 7946); {convert}")
    if not features:
        return
    latitude, longitude = place
    shapes = shapely.force_2d([feature.geometry for feature in features])
    here = shapely.points([longitude - _TURN_DEG, longitude, longitude + _TURN_DEG], latitude)
    with np.errstate(over="ignore"):  # of coordinates that are refused below
        away = float(shapely.distance(here[:, None], shapes).min())
        swapped = float(shapely.distance(shapely.Point(latitude, longitude), shapes).min())
    if away > MIN_DISTANCE_DEG and swapped < MAX_SHARE_SWAPPED * away:
        raise ConfigError(f"{where}: latitude and longitude are swapped: GeoJSON has the longitude first; swap them")
    x, y = abs(shapely.get_coordinates(shapes)).max(axis=0).tolist()
    if x > _TURN_DEG or y > 90.0:
        raise ConfigError(f"{where}: has coordinates that are no degrees; {convert}")
    if away > MAX_DISTANCE_DEG:
        raise ConfigError(
            f"{where}: nothing in it is nearer than {away:.0f} degrees to the mission's datum; are file and datum the right ones?"
        )
