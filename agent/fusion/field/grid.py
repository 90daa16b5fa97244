"""The grid of ground cells, and the smooth functions on it: a Gaussian process by a cosine basis.

    f(x, y) = sum_kl u_kl phi_k(x) phi_l(y),    phi_0 = 1,    phi_k(x) = sqrt(2) cos(pi k x / L),    u_kl ~ N(0, s_kl)

With s_kl the spectral density of the Matern-5/2 covariance in two dimensions at the frequency w = pi (k / L_x, l / L_y),

    s_kl ~ (5 / l^2 + |w|^2)^(-7/2),    scaled so that all s_kl add up to 1,

f has unit variance on average [SS20, A. Solin, S. Sarkka, Hilbert space methods for reduced-rank Gaussian process regression].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from radron.agent.geometry import Array

CELL_M: Final = 2.5
MARGIN_M: Final = 10.0  # of cells around the area
MAX_CELLS: Final = 96  # along an axis; a larger area has larger cells
HALF_WAVE_M: Final = 6.5  # of the finest basis function
MAX_MODES: Final = 20  # along an axis
BEYOND_M: Final = 120.0  # from the grid's edge: farther ground gives no counts
_BEYOND_CELLS: Final = 18  # along that distance, growing outwards


@dataclass(frozen=True, eq=False)
class Grid:
    """Square cells along the axes, row by row from the south-western corner. west, south: that corner, metres, mission frame.
    columns, rows: numbers of cells. inside: (N,) share of each cell in the area.
    """

    west: float
    south: float
    cell_m: float
    columns: int
    rows: int
    inside: Array

    @classmethod
    def around(cls, area: Polygon, cell_m: float = CELL_M, margin_m: float = MARGIN_M) -> Grid:
        """Return the grid of an area and its margin."""
        west, south, east, north = area.bounds
        cell_m = max(cell_m, (max(east - west, north - south) + 2.0 * margin_m) / (MAX_CELLS - 3))  # parts of cells at both ends
        margin = math.ceil(margin_m / cell_m)
        columns, rows = (math.ceil((to - start) / cell_m - 1e-9) + 2 * margin for start, to in ((west, east), (south, north)))
        west, south = west - margin * cell_m, south - margin * cell_m
        x, y = west + cell_m * np.arange(columns), south + cell_m * np.arange(rows)
        left, lower = (part.ravel() for part in np.meshgrid(x, y))
        cells = shapely.box(left, lower, left + cell_m, lower + cell_m)
        shapely.prepare(area)
        inside = np.asarray(shapely.area(shapely.intersection(cells, area)) / cell_m**2, np.float64)
        return cls(west, south, cell_m, columns, rows, inside)

    @property
    def size(self) -> int:
        """Number N of cells."""
        return self.columns * self.rows

    @cached_property
    def centres(self) -> Array:
        """(N, 2) middles of the cells."""
        x = self.west + self.cell_m * (np.arange(self.columns) + 0.5)
        y = self.south + self.cell_m * (np.arange(self.rows) + 0.5)
        return np.stack([part.ravel() for part in np.meshgrid(x, y)], axis=1)

    @property
    def inside_m2(self) -> Array:
        """(N,) part of the area in each cell."""
        return self.inside * self.cell_m**2

    @cached_property
    def basis(self) -> tuple[Array, Array]:
        """Basis functions at the middles of the cells, along x (columns, K) and along y (rows, L)."""
        return _cosines(self.columns, self.cell_m), _cosines(self.rows, self.cell_m)

    @property
    def modes(self) -> int:
        """Number of basis functions."""
        along_x, along_y = self.basis
        return int(along_x.shape[1] * along_y.shape[1])

    def spectrum(self, length_m: float) -> Array:
        """Return the prior variances s of the coefficients (modes,), the constant one last on top of the others' sum.

        The mean over the grid has unit variance besides: nothing is known of it.
        """
        along_x, along_y = (np.arange(part.shape[1]) for part in self.basis)
        x, y = np.pi / self.cell_m * along_x / self.columns, np.pi / self.cell_m * along_y / self.rows
        density = (5.0 / length_m**2 + x**2 + y[:, None] ** 2) ** -3.5
        result: Array = (density / density.sum()).ravel()
        result[0] += 1.0
        return result

    def field(self, coefficients: Array) -> Array:
        """Return f (N,) of coefficients (modes,)."""
        along_x, along_y = self.basis
        table = coefficients.reshape(along_y.shape[1], along_x.shape[1])
        result: Array = (along_y @ table @ along_x.T).ravel()
        return result

    def projected(self, weights: NDArray[Any]) -> Array:
        """Return (..., modes) sums over the cells of weights (..., N) times each basis function."""
        along_x: NDArray[Any]
        along_y: NDArray[Any]
        along_x, along_y = (part.astype(weights.dtype) for part in self.basis)
        *shape, _ = weights.shape
        half = weights.reshape(-1, self.columns) @ along_x
        half = half.reshape(-1, self.rows, along_x.shape[1]).transpose(0, 2, 1).reshape(-1, self.rows)
        whole = (half @ along_y).reshape(-1, along_x.shape[1], along_y.shape[1]).transpose(0, 2, 1)
        return np.asarray(whole.reshape(*shape, self.modes), np.float64)

    @cached_property
    def _outside(self) -> tuple[Array, Array]:
        return _frame(self)

    @property
    def beyond(self) -> Array:
        """(M, 2) places that stand for the ground beyond the grid."""
        return self._outside[0]

    @property
    def beyond_m2(self) -> Array:
        """(M,) ground for which each of ``beyond`` stands."""
        return self._outside[1]

    def blocks(self, side_m: float) -> tuple[NDArray[np.intp], int, int]:
        """Return the block of each cell (N,), -1 outside of the area, and the numbers of blocks along x and y.

        Blocks of at least ``side_m`` begin at the south-western corner of the area's bounding box.
        """
        each = self.cells_of(side_m)
        touched = np.flatnonzero(self.inside > 0.0)
        column, row = np.arange(self.size) % self.columns, np.arange(self.size) // self.columns
        first_column, first_row = int(column[touched].min()), int(row[touched].min())
        across = int(column[touched].max() - first_column) // each + 1
        up = int(row[touched].max() - first_row) // each + 1
        number = (row - first_row) // each * across + (column - first_column) // each
        return np.where(self.inside > 0.0, number, -1), across, up

    def cells_of(self, side_m: float) -> int:
        """Return the number of cells along a block's side of at least ``side_m``."""
        return max(1, math.ceil(side_m / self.cell_m - 1e-9))


def _cosines(cells: int, cell_m: float) -> Array:
    modes = min(MAX_MODES, cells, max(2, round(cells * cell_m / HALF_WAVE_M)))
    result: Array = math.sqrt(2.0) * np.cos(np.pi / cells * np.outer(np.arange(cells) + 0.5, np.arange(modes)))
    result[:, 0] = 1.0
    return result


def _frame(grid: Grid) -> tuple[Array, Array]:
    """Return middles (M, 2) and areas (M,) of cells around the grid that grow outwards."""
    out = BEYOND_M * np.linspace(0.0, 1.0, _BEYOND_CELLS // 2 + 1) ** 1.5

    def edges(start: float, cells: int) -> Array:
        end = start + cells * grid.cell_m
        return np.concatenate((start - out[:0:-1], np.linspace(start, end, max(2, cells // 4 + 1)), end + out[1:]))

    x, y = edges(grid.west, grid.columns), edges(grid.south, grid.rows)
    middle_x, middle_y = 0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1])
    places = np.stack([part.ravel() for part in np.meshgrid(middle_x, middle_y)], axis=1)
    m2 = np.outer(np.diff(y), np.diff(x)).ravel()
    east, north = grid.west + grid.columns * grid.cell_m, grid.south + grid.rows * grid.cell_m
    within = (places[:, 0] > grid.west) & (places[:, 0] < east) & (places[:, 1] > grid.south) & (places[:, 1] < north)
    return places[~within], m2[~within]
