"""The background map of the operator's web page, without any network.

It consists of vector layers (GeoJSON) and raster tiles (MBTiles, or a folder of images).
"""

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
from msgspec import Struct

from radron.agent.config.geojson import read_features
from radron.agent.config.mission import DatumConfig, MissionConfig
from radron.agent.errors import RadronError
from radron.agent.frames.geodesy import mission_from_geodetics
from radron.agent.inputs import read_bytes
from radron.station.picture.frame import Point, TileLevels

MAX_LAYER_BYTES = 30_000_000
MAX_POINTS = 300_000  # of all layers together
MAX_DEPTH = 24
IMAGES = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_MARKUP = re.compile(r"<[^>]*>")


class BackgroundError(RadronError):
    """A layer or the tiles of the background map cannot be shown."""


class Shape(Struct, frozen=True, array_like=True):
    """A line, an area or a point that is drawn on the map of the operator's web page.

    ``kind``: ``line``, ``area`` or ``point``. ``places``: its points in the mission frame (east, north), metres.
    """

    kind: str
    name: str
    places: list[Point]


class Tiles(Protocol):
    """Source of the map's background images: raster tiles in the Web Mercator scheme (x from the west, y from the north)."""

    @property
    def levels(self) -> TileLevels:
        """Lowest and highest zoom level of the tiles, and the attribution of their data."""
        ...

    def tile(self, z: int, x: int, y: int) -> tuple[bytes, str] | None:
        """Return the image of one tile and its media type, such as ``image/png``; None for a missing tile.

        ``z``: zoom level; ``x``, ``y``: column and row.
        """
        ...


@dataclass(frozen=True, slots=True)
class Background:
    """The map background of one mission: ``layer``, the shapes as JSON (empty: no shapes), and ``tiles``, the images."""

    layer: bytes = b""
    tiles: Tiles | None = None


def background(mission: MissionConfig, layers: Sequence[Path], tiles: Path | None) -> Background:
    """Read the layers and tiles that are drawn below the map of a mission.

    ``layers``: GeoJSON files. ``tiles``: an MBTiles file, or a folder of images; None: no images.

    Raises:
        BackgroundError: the tiles cannot be read, the layers are too large, or the mission has no datum (place on Earth).
        ConfigError: a layer cannot be read, or lies elsewhere.
    """
    if not layers and tiles is None:
        return Background()
    if mission.datum is None:
        raise BackgroundError("--layer, --tiles: the mission has no [datum], so its place on Earth is not known")
    shapes = [shape for path in layers for shape in _shapes(path, mission.datum)]
    if sum(len(shape.places) for shape in shapes) > MAX_POINTS:
        raise BackgroundError(f"--layer: more than {MAX_POINTS} points: simplify it, or crop it to the area")
    found = None if tiles is None else FolderTiles(tiles) if tiles.is_dir() else MbTiles(tiles)
    return Background(msgspec.json.encode(shapes) if layers else b"", found)


def _shapes(path: Path, datum: DatumConfig) -> Iterator[Shape]:
    where = f"--layer: {path}"
    data = read_bytes(path, MAX_LAYER_BYTES, where, "simplify it, or crop it to the area")
    for feature in read_features(where, data, (datum.latitude_deg, datum.longitude_deg)):
        name = feature.properties.get("name")
        for kind, coordinates in _lines(feature.geometry):
            yield Shape(kind, str(name)[:100] if name is not None else "", _places(coordinates, datum))


def _lines(geometry: Any) -> Iterator[tuple[str, Any]]:
    if geometry.geom_type == "Polygon":
        yield "area", geometry.exterior.coords
        for hole in geometry.interiors:
            yield "line", hole.coords
    else:
        yield "point" if geometry.geom_type == "Point" else "line", geometry.coords


def _places(coordinates: Any, datum: DatumConfig) -> list[Point]:
    lonlat = np.asarray(coordinates, dtype=np.float64)[:, :2]
    height = np.full(len(lonlat), datum.altitude_m)
    places = mission_from_geodetics(datum, np.column_stack((lonlat[:, 1], lonlat[:, 0], height)))
    return [(round(x, 2), round(y, 2)) for x, y, _ in places.tolist()]


class MbTiles:
    """Map tiles in one file of the format MBTiles 1.3, opened for reading only."""

    def __init__(self, path: Path) -> None:
        """Open the file. Raises BackgroundError if it contains no raster tiles."""
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
        if not (isinstance(low, int) and isinstance(high, int) and 0 <= low <= high <= MAX_DEPTH):
            raise BackgroundError(f"{path}: its zoom levels are {low!r} to {high!r}; at most 0 to {MAX_DEPTH} are shown")
        self._kind = IMAGES[kind]
        self.levels = TileLevels(low, high, _MARKUP.sub("", unescape(str(told.get("attribution", ""))))[:200])

    def tile(self, z: int, x: int, y: int) -> tuple[bytes, str] | None:
        """Return the image of one tile and its media type; None for a missing tile. The file counts its rows from the south."""
        rows = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        if not _exists(z, x, y):
            return None
        found = self._file.execute(rows, (z, x, 2**z - 1 - y)).fetchone()
        return (found[0], self._kind) if found is not None and isinstance(found[0], bytes) else None


class FolderTiles:
    """Map tiles in a folder: one image for each tile, named Z/X/Y.png (or jpg, webp) by zoom level, column and row."""

    def __init__(self, folder: Path) -> None:
        """Find the tiles in a folder. Raises BackgroundError if there are none."""
        levels = sorted(int(path.name) for path in folder.iterdir() if path.name.isdecimal() and int(path.name) <= MAX_DEPTH)
        example = next((path for level in levels for path in folder.glob(f"{level}/*/*") if path.suffix[1:] in IMAGES), None)
        if example is None:
            raise BackgroundError(f"{folder}: holds no tiles: Z/X/Y.png, or one of {', '.join(IMAGES)}")
        self._folder, self._suffix = folder, example.suffix
        self.levels = TileLevels(levels[0], levels[-1], "")

    def tile(self, z: int, x: int, y: int) -> tuple[bytes, str] | None:
        """Return the image of one tile and its media type; None for a missing tile."""
        path = self._folder / str(z) / str(x) / f"{y}{self._suffix}"
        return (path.read_bytes(), IMAGES[self._suffix[1:]]) if _exists(z, x, y) and path.is_file() else None


def _exists(z: int, x: int, y: int) -> bool:
    return 0 <= z <= MAX_DEPTH and 0 <= x < 2**z and 0 <= y < 2**z
