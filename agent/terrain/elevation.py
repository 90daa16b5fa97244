"""Elevation grids as files: ESRI ASCII, and GeoTIFF by tifffile (0.2 MB of Python; rasterio with its GDAL is 36 MB)."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO

import numpy as np

from agent.errors import ConfigError
from agent.geometry import Array

MOST_NODES = 4_000_000
_MOST_HEADER_LINES = 6
_POINT = 2  # GeoTIFF: a pixel's tie point is its centre, not its corner
_METRE = 9001  # EPSG code of the unit
_USER_DEFINED = 32767
_NODATA_TAG = 42113  # GDAL's own tag; without it every height is valid


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """Heights at the nodes of a grid.

    heights: (R, C), metres, NaN where missing. matrix (2, 2), origin (2,): the node of column c and row r lies at ``matrix @ (c,
    r) + origin`` in the file's coordinates: x or longitude, y or latitude. crs: their reference system, where the file gives it.
    """

    heights: Array
    matrix: Array
    origin: Array
    crs: str | None = None


def read_raster(name: str, data: bytes) -> Raster:
    """Read an elevation grid from a file's content; ``name`` is for the errors.

    Raises:
        ConfigError: neither an ESRI ASCII grid nor a GeoTIFF, damaged, too large, or of an unsupported kind.
    """
    if data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return _geotiff(name, data)
    return _ascii(name, data)


def _ascii(name: str, data: bytes) -> Raster:
    try:
        lines = data.decode("ascii").splitlines()
        head: dict[str, float] = {}
        while len(head) < _MOST_HEADER_LINES and lines and lines[len(head)].split()[0][0].isalpha():
            key, value = lines[len(head)].split()
            head[key.lower()] = float(value)
        columns, rows, cell = int(head["ncols"]), int(head["nrows"]), head["cellsize"]
        shift = 0.0 if "xllcenter" in head else 0.5 * cell
        west, south = (head[f"{axis}llcenter"] if f"{axis}llcenter" in head else head[f"{axis}llcorner"] for axis in "xy")
        _check_size(name, rows, columns)
        heights = np.array(" ".join(lines[len(head) :]).split(), dtype=np.float64).reshape(rows, columns)
    except (ValueError, KeyError, IndexError) as error:
        raise ConfigError(
            f"ground.grid: {name}: not an ESRI ASCII grid (ncols, nrows, xllcorner, yllcorner, cellsize, then nrows times ncols "
            f"heights) and not a GeoTIFF: {error!r}"
        ) from None
    heights[(heights == head.get("nodata_value", np.nan)) | ~np.isfinite(heights)] = np.nan
    if not cell > 0.0:
        raise ConfigError(f"ground.grid: {name}: cellsize = {cell:g}; it must be above 0")
    origin = np.array([west + shift, south + shift + (rows - 1) * cell])
    return Raster(heights, np.diag([cell, -cell]), origin)


def _geotiff(name: str, data: bytes) -> Raster:
    import tifffile  # noqa: PLC0415  a tenth of the agent's time to start, for those that have such a file

    try:
        with tifffile.TiffFile(BytesIO(data)) as tiff:
            page = tiff.pages.first
            _check_size(name, *page.shape[:2])
            keys: dict[str, object] = page.geotiff_tags or {}
            nodata = page.nodata if _NODATA_TAG in page.tags else np.nan
            heights = np.array(page.asarray(), dtype=np.float64)
    except ConfigError:
        raise
    except Exception as error:  # the reader raises all kinds of errors for damaged files
        raise ConfigError(
            f"ground.grid: {name}: this GeoTIFF cannot be read: {error}; "
            "convert it: gdal_translate -ot Float32 -co COMPRESS=DEFLATE"
        ) from None
    if heights.ndim != 2:
        raise ConfigError(f"ground.grid: {name}: {heights.ndim} dimensions; a grid of heights has one band: gdal_translate -b 1")
    for key in ("VerticalUnitsGeoKey", "ProjLinearUnitsGeoKey"):
        if _code(keys, key) not in (None, _METRE):
            raise ConfigError(f"ground.grid: {name}: its unit is not the metre; convert it to metres")
    heights[(heights == nodata) | ~np.isfinite(heights)] = np.nan
    matrix, origin = _placement(name, keys)
    if _code(keys, "GTRasterTypeGeoKey") != _POINT:
        origin = origin + matrix @ (0.5, 0.5)
    projected, geographic = _code(keys, "ProjectedCSTypeGeoKey"), _code(keys, "GeographicTypeGeoKey")
    if _USER_DEFINED in (projected, geographic):
        raise ConfigError(f"ground.grid: {name}: its coordinate system is user-defined; convert it: gdalwarp -t_srs EPSG:4326")
    code = projected or geographic
    return Raster(heights, matrix, origin, None if code is None else f"EPSG:{code}")


def _placement(name: str, keys: dict[str, object]) -> tuple[Array, Array]:
    """Matrix and origin of columns and rows; the origin refers to the corner (or centre) of the first pixel."""
    if "ModelTransformation" in keys:
        whole = np.array(keys["ModelTransformation"], dtype=np.float64).reshape(4, 4)
        return whole[:2, :2], whole[:2, 3]
    if "ModelPixelScale" in keys and "ModelTiepoint" in keys:
        x, y = np.array(keys["ModelPixelScale"], dtype=np.float64)[:2]
        tie = np.array(keys["ModelTiepoint"], dtype=np.float64).ravel()
        matrix = np.diag([x, -y])
        return matrix, tie[3:5] - matrix @ tie[:2]
    raise ConfigError(f"ground.grid: {name}: this TIFF is not georeferenced; save it as a GeoTIFF or ESRI ASCII grid")


def _code(keys: dict[str, object], key: str) -> int | None:
    value = keys.get(key)
    return int(value) if isinstance(value, int) else None


def _check_size(name: str, rows: int, columns: int) -> None:
    if rows < 2 or columns < 2:
        raise ConfigError(f"ground.grid: {name}: {rows} rows of {columns}; at least two of each are needed")
    if rows * columns > MOST_NODES:
        raise ConfigError(f"ground.grid: {name}: {rows} rows of {columns} are more than {MOST_NODES}; crop it to the area")
