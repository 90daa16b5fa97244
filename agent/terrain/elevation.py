"""Elevation grids as files: ESRI ASCII, and GeoTIFF by tifffile (0.2 MB of Python; rasterio with its GDAL is 36 MB)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from io import BytesIO
from xml.etree import ElementTree

import numpy as np

from radron.agent.errors import ConfigError
from radron.agent.geometry import Array
from radron.agent.inputs import text_of

MAX_NODES = 4_000_000
MIN_HEIGHT_M, MAX_HEIGHT_M = -500.0, 9000.0  # of land on Earth; beyond are voids: -9999, -32768, the least float32
MAX_REASON = 120  # characters of a library's own error
_MAX_HEADER_LINES = 6
_POINT = 2  # GeoTIFF: a pixel's tie point is its centre, not its corner
_METRE = 9001  # EPSG code of the unit
_FOOT_M, _SURVEY_FOOT_M = 0.3048, 1200.0 / 3937.0
_UNITS_M = {9001: 1.0, 9002: _FOOT_M, 9003: _SURVEY_FOOT_M}  # by EPSG code
_GDAL_UNITS_M = {
    **dict.fromkeys(("", "m", "metre", "metres", "meter", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet", "international foot"), _FOOT_M),
    **dict.fromkeys(("us-ft", "ftus", "us survey foot", "foot_us"), _SURVEY_FOOT_M),
}
_USER_DEFINED = 32767
_PLACEMENT_TAGS = {"ModelPixelScale": 33550, "ModelTiepoint": 33922, "ModelTransformation": 34264}
_METADATA_TAG, _NODATA_TAG = 42112, 42113  # GDAL's own tags


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """An elevation grid as read from a file: heights at nodes, and the place of each node.

    heights: (R, C), R rows and C columns, metres; NaN where missing: no number, declared as missing, or no height of land. matrix
    (2, 2), origin (2,): the node of column c and row r lies at ``matrix @ (c, r) + origin`` in the file's coordinates: x or
    longitude, y or latitude. crs: reference system of the coordinates, if the file gives it.
    """

    heights: Array
    matrix: Array
    origin: Array
    crs: str | None = None


def read_raster(name: str, data: bytes) -> Raster:
    """Read an elevation grid from the content of a file; ``name`` (of the file) begins the errors.

    Raises:
        ConfigError: neither an ESRI ASCII grid nor a GeoTIFF, damaged, too large, or of an unsupported kind.
    """
    if data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return _geotiff(name, data)
    return _ascii(name, data)


def _ascii(name: str, data: bytes) -> Raster:
    try:
        lines = text_of(data).splitlines()
        head: dict[str, float] = {}
        while len(head) < _MAX_HEADER_LINES and lines and lines[len(head)].split()[0][0].isalpha():
            key, value = lines[len(head)].split()
            head[key.lower()] = float(value)
        columns, rows, cell = int(head["ncols"]), int(head["nrows"]), head["cellsize"]
        shift = 0.0 if "xllcenter" in head else 0.5 * cell
        west, south = (head[f"{axis}llcenter"] if f"{axis}llcenter" in head else head[f"{axis}llcorner"] for axis in "xy")
        _check_size(name, rows, columns)
        heights = np.array(" ".join(lines[len(head) :]).split(), dtype=np.float64).reshape(rows, columns)
    except (ValueError, KeyError, IndexError, OverflowError) as error:
        raise ConfigError(
            f"ground.grid: {name}: not an ESRI ASCII grid (ncols, nrows, xllcorner, yllcorner, cellsize, then nrows times ncols "
            f"heights) and not a GeoTIFF: {str(error)[:MAX_REASON]}"
        ) from None
    heights[heights == head.get("nodata_value", np.nan)] = np.nan
    if not (cell > 0.0 and np.isfinite([cell, west, south]).all()):
        raise ConfigError(
            f"ground.grid: {name}: cellsize = {cell:g}, west = {west:g}, south = {south:g}; give finite numbers, above 0"
        )
    origin = np.array([west + shift, south + shift + (rows - 1) * cell])
    return Raster(_plausible(heights), np.diag([cell, -cell]), origin)


def _geotiff(name: str, data: bytes) -> Raster:
    import tifffile  # noqa: PLC0415  a tenth of the agent's start-up time, only needed for such files

    logging.getLogger(tifffile.__name__).setLevel(logging.CRITICAL)  # its notes go to the terminal; errors are raised
    try:
        with tifffile.TiffFile(BytesIO(data)) as tiff:
            page = tiff.pages.first
            if len(page.shape) != 2:
                bands = "a grid of heights has one band: gdal_translate -b 1"
                raise ConfigError(f"ground.grid: {name}: {len(page.shape)} dimensions; {bands}")
            _check_size(name, *page.shape)
            keys: dict[str, object] = page.geotiff_tags or {}
            keys |= {name: page.tags[tag].value for name, tag in _PLACEMENT_TAGS.items() if tag in page.tags}
            nodata = float(page.tags[_NODATA_TAG].value) if _NODATA_TAG in page.tags else np.nan
            about = _gdal_metadata(page.tags[_METADATA_TAG].value) if _METADATA_TAG in page.tags else {}
            scale, offset = float(about.get("scale", 1.0)), float(about.get("offset", 0.0))
            heights = np.array(page.asarray(), dtype=np.float64)
    except ConfigError:
        raise
    except Exception as error:  # the reader raises all kinds of errors for damaged files
        raise ConfigError(
            f"ground.grid: {name}: this GeoTIFF cannot be read: {str(error)[:MAX_REASON]}; "
            "convert it: gdal_translate -ot Float32 -co COMPRESS=DEFLATE"
        ) from None
    if _code(keys, "ProjLinearUnitsGeoKey") not in (None, _METRE):
        raise ConfigError(f"ground.grid: {name}: the unit of its coordinates is not the metre; convert it: gdalwarp -t_srs")
    heights[heights == nodata] = np.nan
    heights = _unit_m(name, keys, about.get("unittype")) * (offset + scale * heights)
    matrix, origin = _placement(name, keys)
    if _code(keys, "GTRasterTypeGeoKey") != _POINT:
        origin = origin + matrix @ (0.5, 0.5)
    projected, geographic = _code(keys, "ProjectedCSTypeGeoKey"), _code(keys, "GeographicTypeGeoKey")
    if _USER_DEFINED in (projected, geographic):
        raise ConfigError(f"ground.grid: {name}: its coordinate system is user-defined; convert it: gdalwarp -t_srs EPSG:4326")
    code = projected or geographic
    return Raster(_plausible(heights), matrix, origin, None if code is None else f"EPSG:{code}")


def _gdal_metadata(text: str) -> dict[str, str]:
    """Texts by role of the first band: scale, offset, unittype."""
    items = ElementTree.fromstring(text).iter("Item")
    return {item.get("role", ""): item.text or "" for item in items if item.get("sample", "0") == "0"}


def _unit_m(name: str, keys: dict[str, object], written: str | None) -> float:
    """Metres in the unit of the heights: as GDAL has written it, otherwise the coordinate system's unit."""
    code = _code(keys, "VerticalUnitsGeoKey")
    unit_m = _UNITS_M.get(_METRE if code is None else code) if written is None else _GDAL_UNITS_M.get(written.strip().lower())
    if unit_m is None:
        unit = written if written is not None else f"EPSG:{code}"
        raise ConfigError(f"ground.grid: {name}: the unit of its heights, {unit}, is not supported; convert them to metres")
    return unit_m


def _plausible(heights: Array) -> Array:
    """The heights, NaN if out of the range of land."""
    return np.where((heights >= MIN_HEIGHT_M) & (heights <= MAX_HEIGHT_M), heights, np.nan)


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
    if rows * columns > MAX_NODES:
        raise ConfigError(f"ground.grid: {name}: {rows} rows of {columns} are more than {MAX_NODES}; crop it to the area")
