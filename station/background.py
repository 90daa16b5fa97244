"""What lies under the page's map without any network: vector layers (GeoJSON), and raster tiles (MBTiles, or a folder)."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import quote

import msgspec
import numpy as np
import shapely
from msgspec import Struct

from agent.config.mission import DatumConfig, MissionConfig
from agent.errors import RadronError
from agent.frames.geodesy import mission_from_geodetics
from station.picture.frame import Point, TileLevels

MOST_BYTES = 30_000_000  # of a vector layer
MOST_POINTS = 300_000
DEEPEST = 24
IMAGES = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_WGS84 = re.compile(r"(CRS84|EPSG:+4326)$")
_MARKUP = re.compile(r"<[^>]*>")


class BackgroundError(RadronError):
    """A layer or tiles that cannot be shown."""


class Shape(Struct, frozen=True, array_like=True):
    """A line, or an area or point (mission frame). ``kind``: ``line``, ``area``, ``point``."""

    kind: str
    name: str
    places: list[Point]


class Tiles(Protocol):
    """Raster tiles in the Web Mercator scheme (x from the west, y from the north)."""

    @property
    def levels(self) -> TileLevels:
        """Lowest and highest zoom level, and whose data they are."""
        ...

    def tile(self, z: int, x: int, y: int) -> tuple[bytes, str] | None:
        """An image and its media type; None where there is none."""
        ...


@dataclass(frozen=True, slots=True)
class Background:
    """``layer``: the shapes as JSON, empty: none."""

    layer: bytes = b""
    tiles: Tiles | None = None


def background(mission: MissionConfig, layers: Sequence[Path], tiles: Path | None) -> Background:
    """Read what was given.

    Raises:
        BackgroundError: it cannot be read, or the mission's place on Earth is not known; one line.
    """
    if not layers and tiles is None:
        return Background()
    if mission.datum is None:
        raise BackgroundError("--layer, --tiles: the mission has no [datum], so its place on Earth is not known")
    shapes = [shape for path in layers for shape in _shapes(path, mission.datum)]
    if sum(len(shape.places) for shape in shapes) > MOST_POINTS:
        raise BackgroundError(f"--layer: more than {MOST_POINTS} points: simplify it, or crop it to the area")
    found = None if tiles is None else FolderTiles(tiles) if tiles.is_dir() else MbTiles(tiles)
    return Background(msgspec.json.encode(shapes) if layers else b"", found)


def _shapes(path: Path, datum: DatumConfig) -> Iterator[Shape]:
    try:
        data = path.read_bytes() if path.stat().st_size <= MOST_BYTES else None
        document = msgspec.json.decode(data) if data is not None else None
    except OSError as error:
        raise BackgroundError(f"{path}: cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError):
        raise BackgroundError(f"{path}: is not GeoJSON (RFC 7946)") from None
    if document is None:
        raise BackgroundError(f"{path}: more than {MOST_BYTES // 1_000_000} MB: simplify it, or crop it to the area")
    if not isinstance(document, dict) or not _is_wgs84(document):
        raise BackgroundError(f"{path}: is not GeoJSON in WGS84 (RFC 7946); ogr2ogr -t_srs EPSG:4326 makes it so")
    features = document.get("features") if document.get("type") == "FeatureCollection" else [document]
    for feature in features if isinstance(features, list) else [None]:
        yield from _feature(feature, path, datum)


def _is_wgs84(document: dict[str, Any]) -> bool:
    """Old files name their coordinates; those of RFC 7946 are WGS84."""
    crs = document.get("crs")
    properties = crs.get("properties") if isinstance(crs, dict) else None
    return crs is None or (isinstance(properties, dict) and _WGS84.search(str(properties.get("name"))) is not None)


def _feature(feature: object, path: Path, datum: DatumConfig) -> Iterator[Shape]:
    if not isinstance(feature, dict):
        raise BackgroundError(f"{path}: is not GeoJSON (RFC 7946)")
    is_feature = feature.get("type") == "Feature"
    geometry, properties = (feature.get("geometry"), feature.get("properties")) if is_feature else (feature, None)
    name = properties.get("name") if isinstance(properties, dict) else None
    if geometry is None:
        return
    try:
        found = shapely.from_geojson(msgspec.json.encode(geometry).decode())
    except (shapely.GEOSException, TypeError, ValueError):
        raise BackgroundError(f"{path}: has a geometry that is not GeoJSON (RFC 7946)") from None
    for kind, coordinates in _parts(found):
        yield Shape(kind, str(name)[:100] if name is not None else "", _places(coordinates, path, datum))


def _parts(geometry: Any) -> Iterator[tuple[str, Any]]:
    if hasattr(geometry, "geoms"):
        for part in geometry.geoms:
            yield from _parts(part)
    elif geometry.is_empty:
        return
    elif geometry.geom_type == "Polygon":
        yield "area", geometry.exterior.coords
        for hole in geometry.interiors:
            yield "line", hole.coords
    else:
        yield "point" if geometry.geom_type == "Point" else "line", geometry.coords


def _places(coordinates: Any, path: Path, datum: DatumConfig) -> list[Point]:
    lonlat = np.asarray(coordinates, dtype=np.float64)[:, :2]
    if not np.isfinite(lonlat).all() or (np.abs(lonlat) > (180.0, 90.0)).any():
        raise BackgroundError(f"{path}: has coordinates that are no degrees; ogr2ogr -t_srs EPSG:4326 makes them so")
    height = np.full(len(lonlat), datum.altitude_m)
    places = mission_from_geodetics(datum, np.column_stack((lonlat[:, 1], lonlat[:, 0], height)))
    return [(round(x, 2), round(y, 2)) for x, y, _ in places.tolist()]


class MbTiles:
    """A file of tiles (MBTiles 1.3), opened for reading only."""

    def __init__(self, path: Path) -> None:
        """Open it. Raises BackgroundError where it has no raster tiles."""
        if not path.is_file():
            raise BackgroundError(f"{path}: there is no such file or folder")
        try:
            self._file = sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode=ro", uri=True, check_same_thread=False)
            told = dict(self._file.execute("SELECT name, value FROM metadata"))
            low, high = self._file.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
        except sqlite3.Error as error:
            raise BackgroundError(f"{path}: is not an MBTiles file: {error}") from None
        kind = str(told.get("format"))
        if kind not in IMAGES:
            raise BackgroundError(f"{path}: holds tiles of the format {kind!r}; images are needed: {', '.join(IMAGES)}")
        if low is None:
            raise BackgroundError(f"{path}: holds no tile")
        self._kind = IMAGES[kind]
        self.levels = TileLevels(low, high, _MARKUP.sub("", unescape(str(told.get("attribution", ""))))[:200])

    def tile(self, z: int, x: int, y: int) -> tuple[bytes, str] | None:
        """As ``Tiles``; the file counts its rows from the south."""
        rows = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        if not _exists(z, x, y):
            return None
        found = self._file.execute(rows, (z, x, 2**z - 1 - y)).fetchone()
        return (bytes(found[0]), self._kind) if found is not None else None


class FolderTiles:
    """A folder of tiles: Z/X/Y.png (or jpg, webp), as in a browser's map."""

    def __init__(self, folder: Path) -> None:
        """See what is in it. Raises BackgroundError where that is no tiles."""
        levels = sorted(int(path.name) for path in folder.iterdir() if path.name.isdecimal() and int(path.name) <= DEEPEST)
        example = next((path for level in levels for path in folder.glob(f"{level}/*/*") if path.suffix[1:] in IMAGES), None)
        if example is None:
            raise BackgroundError(f"{folder}: holds no tiles: Z/X/Y.png, or one of {', '.join(IMAGES)}")
        self._folder, self._suffix = folder, example.suffix
        self.levels = TileLevels(levels[0], levels[-1], "")

    def tile(self, z: int, x: int, y: int) -> tuple[bytes, str] | None:
        """As ``Tiles``."""
        path = self._folder / str(z) / str(x) / f"{y}{self._suffix}"
        return (path.read_bytes(), IMAGES[self._suffix[1:]]) if _exists(z, x, y) and path.is_file() else None


def _exists(z: int, x: int, y: int) -> bool:
    return 0 <= z <= DEEPEST and 0 <= x < 2**z and 0 <= y < 2**z
