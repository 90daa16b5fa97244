"""Plain tiles for a map, as a folder and as an MBTiles file."""

from __future__ import annotations

import math
import sqlite3
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path


def png(red: int, green: int, blue: int, size: int = 256) -> bytes:
    """An image of one colour with a darker edge."""
    edge, inside = bytes(value // 2 for value in (red, green, blue)), bytes((red, green, blue))
    rows = [edge * size, *[edge + inside * (size - 1)] * (size - 1)]
    data = zlib.compress(b"".join(b"\0" + row for row in rows))
    header = struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", data), (b"IEND", b""))
    chunks = (struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in parts)
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def tile_of(latitude_deg: float, longitude_deg: float, z: int) -> tuple[int, int]:
    """Column and row of the tile in which a place lies (Web Mercator)."""
    latitude = math.radians(latitude_deg)
    across = (longitude_deg + 180.0) / 360.0
    down = (1.0 - math.asinh(math.tan(latitude)) / math.pi) / 2.0
    return int(across * 2**z), int(down * 2**z)


def corner_of(z: int, x: int, y: int) -> tuple[float, float]:
    """Latitude and longitude of a tile's north-western corner."""
    return math.degrees(math.atan(math.sinh(math.pi * (1.0 - 2.0 * y / 2**z)))), 360.0 * x / 2**z - 180.0


def around(latitude_deg: float, longitude_deg: float, levels: range, reach: int = 3) -> Iterator[tuple[int, int, int]]:
    """Tiles around a place."""
    for z in levels:
        column, row = tile_of(latitude_deg, longitude_deg, z)
        yield from ((z, x, y) for x in range(column - reach, column + reach + 1) for y in range(row - reach, row + reach + 1))


def colour(z: int, x: int, y: int) -> tuple[int, int, int]:
    """Of a tile: neighbours differ."""
    return (225, 230, 215) if (x + y) % 2 else (210, 218, 205)


def write_folder(folder: Path, latitude_deg: float, longitude_deg: float, levels: range) -> Path:
    for z, x, y in around(latitude_deg, longitude_deg, levels):
        path = folder / str(z) / str(x) / f"{y}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(png(*colour(z, x, y)))
    return folder


def write_mbtiles(path: Path, latitude_deg: float, longitude_deg: float, levels: range, kind: str = "png") -> Path:
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE metadata (name text, value text)")
        file.execute("CREATE TABLE tiles (zoom_level integer, tile_column integer, tile_row integer, tile_data blob)")
        told = [("format", kind), ("attribution", "&copy; <a href='https://example.org'>Survey</a>")]
        file.executemany("INSERT INTO metadata VALUES (?, ?)", told)
        places = around(latitude_deg, longitude_deg, levels)
        tiles = ((z, x, 2**z - 1 - y, png(*colour(z, x, y))) for z, x, y in places)
        file.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", tiles)
    file.close()
    return path
