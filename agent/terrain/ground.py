"""The mission's ground, on which the source lies: a plane or an elevation grid. Mission frame, metres."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from shapely import Polygon

from radron.agent.config.mission import AreaConfig, DatumConfig, GroundConfig, MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.extras import remedy
from radron.agent.frames.geodesy import mission_from_geodetics
from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array
from radron.agent.terrain.elevation import Raster, read_raster

MAX_SLOPE = 5.0  # between neighbouring nodes: 79 degrees
_BENT_CELLS = 0.1  # tolerated deviation of a grid's lines from straight ones in the mission frame


class Ground:
    """Heights and slopes of the ground on which the source lies, from a plane or an elevation grid (mission frame, metres).

    Outside the grid the heights of its edge continue.
    """

    def __init__(self, config: GroundConfig, grid: _Grid | None = None) -> None:
        self._base, (self._east, self._north) = config.height_m, config.slope
        self._grid = grid

    @classmethod
    def from_config(cls, mission: MissionConfig) -> Ground:
        """Return the ground of a mission whose elevation grid has been loaded (``with_ground_grid``).

        Raises:
            ConfigError: the grid is missing, cannot be read, lacks the datum, does not cover the area, or has holes in the area.
        """
        config = mission.ground
        if config.grid is None:
            return cls(config)
        if config.grid_data is None:
            raise ConfigError(f"ground.grid: {config.grid}: not read; load the mission with load_mission")
        return cls(config, _Grid.of(config.grid, config, mission.datum, mission.area))

    @property
    def level(self) -> bool:
        """Whether the ground has the same height everywhere."""
        return self._grid is None and self._east == self._north == 0.0

    def height_m(self, x: float, y: float) -> float:
        """Return the ground's height (m) at the position x (east), y (north) in m, mission frame."""
        if self._grid is None:
            return self._base + self._east * x + self._north * y
        return float(self._grid.heights_m(np.array([[x, y]]))[0])

    def heights_m(self, places: Array) -> Array:
        """Return the ground's heights (N,) in m at N positions (N, 2) in m, mission frame."""
        if self._grid is None:
            plane: Array = self._base + places @ np.array([self._east, self._north])
            return plane
        return self._grid.heights_m(places)

    def highest_m(self, area: AreaConfig) -> float:
        """Return the greatest height (m) of the ground in the area and inside its fence; of a grid, in all of it."""
        if self._grid is not None:
            return self._grid.highest_m
        return float(self.heights_m(np.array(area.polygon_m)).max()) + area.fence_margin_m * hypot(self._east, self._north)

    def slope(self, x: float, y: float) -> tuple[float, float]:
        """Return the ground's slope at one position (m, mission frame): rise per metre east, and rise per metre north."""
        if self._grid is None:
            return self._east, self._north
        (east, north), *_ = self._grid.slopes(np.array([[x, y]])).tolist()
        return east, north

    def slopes(self, places: Array) -> Array:
        """Return the ground's slopes (N, 2), rise per metre east and north, at N positions (N, 2) in m, mission frame."""
        if self._grid is None:
            return np.tile((self._east, self._north), (len(places), 1))
        return self._grid.slopes(places)

    def around(
        self, mission_from_local: Transform | None, place: tuple[float, float], below_m: float
    ) -> Callable[[Array], Array]:
        """Return a function that gives the ground's heights (N,) around a vehicle at N positions (N, 2), both in the vehicle's
        local frame (m).

        The heights are relative to the ground below the vehicle as measured by its rangefinder, so an offset of the ground model
        or of the local frame's height has no effect.

        mission_from_local: transform of the vehicle's local frame into the mission frame; without it the ground is taken as
        level, since its position in the model is unknown. place: horizontal position of the vehicle. below_m: local z of the
        ground at ``place``.
        """
        if mission_from_local is None:
            return lambda places: np.full(len(places), below_m)
        x, y, _ = mission_from_local.apply_point((*place, 0.0))
        offset = below_m - self.height_m(x, y)

        def heights(places: Array) -> Array:
            there = mission_from_local.apply(np.column_stack((places, np.zeros(len(places)))))
            return self.heights_m(there[:, :2]) + offset

        return heights


LEVEL = Ground(GroundConfig())


class _Grid:
    """Bilinear interpolation between the nodes of a raster in the mission frame.

    heights: (R, C). matrix (2, 2), origin (2,): the position p has column and row ``matrix @ p + origin``.
    """

    def __init__(self, heights: Array, matrix: Array, origin: Array) -> None:
        self._heights, self._matrix, self._origin = heights, matrix, origin
        rows, columns = heights.shape
        self._last = np.array([columns - 1.0, rows - 1.0])

    @classmethod
    def of(cls, name: str, config: GroundConfig, datum: DatumConfig | None, area: AreaConfig) -> _Grid:
        """The part of a file's grid below the area and its fence."""
        raster = read_raster(name, config.grid_data or b"")
        crs = config.grid_crs or raster.crs or "mission"
        if crs != "mission" and datum is None:
            raise ConfigError(f"ground.grid: {name}: its coordinates are {crs}; that needs the mission's datum: add [datum]")
        nodes = _nodes(name, raster, crs, datum, config.geoid_m)
        nodes = _cropped(name, nodes, area)
        matrix, origin = _straightened(name, nodes)
        _check_cover(name, matrix, origin, nodes, area)
        _check_slopes(name, nodes)
        return cls(_filled(name, nodes, area), matrix, origin)

    @property
    def highest_m(self) -> float:
        """Height of the highest node."""
        return float(self._heights.max())

    def heights_m(self, places: Array) -> Array:
        """Heights (N,) at positions (N, 2)."""
        column, row, across, along = self._cells(places)
        corners = self._heights
        near = (1.0 - across) * corners[row, column] + across * corners[row, column + 1]
        far = (1.0 - across) * corners[row + 1, column] + across * corners[row + 1, column + 1]
        heights: Array = (1.0 - along) * near + along * far
        return heights

    def slopes(self, places: Array) -> Array:
        """Slopes (N, 2), rise per metre east and north, bilinear within the cells; zero across the edge."""
        inside = np.abs(self._indices(places) - 0.5 * self._last) <= 0.5 * self._last
        column, row, u, v = self._cells(places)
        corners = self._heights
        a, b, c, d = corners[row, column], corners[row, column + 1], corners[row + 1, column], corners[row + 1, column + 1]
        per_cell = np.column_stack(((1.0 - v) * (b - a) + v * (d - c), (1.0 - u) * (c - a) + u * (d - b)))
        slopes: Array = (per_cell * inside) @ self._matrix
        return slopes

    def _indices(self, places: Array) -> Array:
        indices: Array = places @ self._matrix.T + self._origin
        return indices

    def _cells(self, places: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
        """Column and row (N,) of the cells, and the fractions within them (0 .. 1); positions outside are clamped to the edge."""
        indices = np.clip(self._indices(places), 0.0, self._last)
        first = np.minimum(indices.astype(np.intp), (self._last - 1.0).astype(np.intp))
        share = indices - first
        return first[:, 0], first[:, 1], share[:, 0], share[:, 1]


def _nodes(name: str, raster: Raster, crs: str, datum: DatumConfig | None, geoid_m: float) -> Array:
    """The nodes (R, C, 3) in the mission frame; z is NaN where the height is missing."""
    rows, columns = raster.heights.shape
    indices = np.stack(np.meshgrid(np.arange(columns, dtype=np.float64), np.arange(rows, dtype=np.float64)), axis=-1)
    x, y = np.moveaxis(indices @ raster.matrix.T + raster.origin, -1, 0)
    if crs == "mission" or datum is None:
        return np.stack((x, y, raster.heights), axis=-1)
    if crs == "EPSG:4326":
        longitude, latitude = x, y
    elif crs[:8] in ("EPSG:326", "EPSG:327"):
        latitude, longitude = _geodetic_from_projected(name, crs, x, y)
    else:
        raise ConfigError(f"ground.grid: {name}: {crs} is not supported; convert it: gdalwarp -t_srs EPSG:4326")
    if not (np.abs(latitude) <= 90.0).all():
        raise ConfigError(f"ground.grid: {name}: read as {crs}, it has latitudes beyond 90 degrees; is ground.grid_crs right?")
    known = np.where(np.isnan(raster.heights), datum.altitude_m - geoid_m, raster.heights)
    nodes = mission_from_geodetics(datum, np.stack((latitude, longitude, known + geoid_m), axis=-1))
    nodes[..., 2] = np.where(np.isnan(raster.heights), np.nan, nodes[..., 2])
    return nodes


def _geodetic_from_projected(name: str, crs: str, x: Array, y: Array) -> tuple[Array, Array]:
    """Latitude and longitude (degrees, WGS84) of map coordinates (metres) in a projected reference system, by PROJ."""
    try:
        from pyproj import Transformer  # noqa: PLC0415 -- optional: only grids in UTM need it
    except ImportError:
        raise ConfigError(f"ground.grid: {name}: coordinates in {crs}: {remedy('pyproj')}") from None
    longitude, latitude = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(x, y)
    return latitude, longitude


def _cropped(name: str, nodes: Array, area: AreaConfig) -> Array:
    """The nodes (R, C, 3) below the area and its fence, with a margin."""
    corners = np.array(area.polygon_m)
    margin_m = area.fence_margin_m + _cell_m(nodes)
    low, high = corners.min(axis=0) - margin_m, corners.max(axis=0) + margin_m
    inside = ((nodes[..., :2] >= low) & (nodes[..., :2] <= high)).all(axis=-1)
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if len(rows) == 0:
        (west, south), (east, north) = nodes[..., :2].min(axis=(0, 1)).tolist(), nodes[..., :2].max(axis=(0, 1)).tolist()
        raise ConfigError(
            f"ground.grid: {name}: it does not cover area.polygon_m: in the mission frame it goes from "
            f"({west:.0f}, {south:.0f}) to ({east:.0f}, {north:.0f}) m; is the datum right?"
        )
    return nodes[max(rows[0] - 1, 0) : rows[-1] + 2, max(columns[0] - 1, 0) : columns[-1] + 2]


def _cell_m(nodes: Array) -> float:
    """Diagonal of a cell of nodes (R, C, 3)."""
    return float(np.linalg.norm(nodes[1, 1, :2] - nodes[0, 0, :2]))


def _straightened(name: str, nodes: Array) -> tuple[Array, Array]:
    """Matrix and origin that map positions to columns and rows: over an area, map projections are linear enough."""
    rows, columns = nodes.shape[:2]
    indices = np.stack(np.meshgrid(np.arange(columns, dtype=np.float64), np.arange(rows, dtype=np.float64)), axis=-1).reshape(
        -1, 2
    )
    places = np.column_stack((nodes[..., :2].reshape(-1, 2), np.ones(rows * columns)))
    middle = places.mean(axis=0) * (1.0, 1.0, 0.0)  # centred for numerical accuracy
    found = np.linalg.lstsq(places - middle, indices, rcond=None)[0]
    bent = float(np.abs((places - middle) @ found - indices).max())
    if bent > _BENT_CELLS:
        raise ConfigError(f"ground.grid: {name}: its lines are curved by {bent:.2g} cells in the mission frame; use one in UTM")
    matrix = found[:2].T
    return matrix, found[2] - matrix @ middle[:2]


def _check_cover(name: str, matrix: Array, origin: Array, nodes: Array, area: AreaConfig) -> None:
    """Raise ConfigError unless the grid covers the area's corners, to within half a cell."""
    rows, columns = nodes.shape[:2]
    for x, y in area.polygon_m:
        column, row = (matrix @ (x, y) + origin).tolist()
        if not (-0.501 <= column <= columns - 0.499 and -0.501 <= row <= rows - 0.499):
            raise ConfigError(
                f"ground.grid: {name}: it does not cover the corner ({x:g}, {y:g}) of area.polygon_m; use a larger one"
            )


def _check_slopes(name: str, nodes: Array) -> None:
    """Raise ConfigError where neighbouring nodes (R, C, 3) differ more than ground does: voids, buildings, another unit."""
    for axis in (0, 1):
        steps = np.diff(nodes, axis=axis)
        slopes = np.abs(steps[..., 2]) / np.hypot(steps[..., 0], steps[..., 1])
        place = np.unravel_index(np.argmax(np.nan_to_num(slopes)), slopes.shape)
        if slopes[place] > MAX_SLOPE:
            x, y, _ = nodes[place]
            raise ConfigError(
                f"ground.grid: {name}: the ground steps by {abs(steps[place][2]):.0f} m between neighbouring nodes at ({x:.1f}, "
                f"{y:.1f}) m; give a terrain model without buildings, and declare its voids as missing (nodata)"
            )


def _filled(name: str, nodes: Array, area: AreaConfig) -> Array:
    """Heights (R, C); outside the area, missing ones are taken from the nearest known node."""
    heights = nodes[..., 2]
    holes = np.isnan(heights)
    if not holes.any():
        return heights.copy()
    within = shapely.contains_xy(Polygon(area.polygon_m).buffer(_cell_m(nodes)), nodes[..., 0], nodes[..., 1])
    bad = np.argwhere(holes & within)
    if len(bad):
        x, y, _ = nodes[tuple(bad[0])]
        raise ConfigError(
            f"ground.grid: {name}: {len(bad)} holes in the area, one at ({x:.1f}, {y:.1f}) m; fill them: gdal_fillnodata"
        )
    nearest = distance_transform_edt(holes, return_distances=False, return_indices=True)
    filled: Array = heights[tuple(nearest)]
    return filled
