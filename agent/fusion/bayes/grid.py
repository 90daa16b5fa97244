"""The cells, activities and background levels of a search, and their priors: fine cells in the area, coarse ones around it.

Without its surroundings, the search would mistake a source beyond the fence for one at the area's edge, with great certainty. The
cells coarsen with the distance from the area. A track can begin in a cell up to the fence. Beyond it only a bearing is reported,
so large cells suffice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, gaussian_filter
from shapely import Polygon, contains_xy

from radron.agent.config.estimators import BayesEstimatorConfig
from radron.agent.fusion.bayes.response import REFERENCE_BQ
from radron.agent.geometry import Array
from radron.agent.terrain.ground import Ground

Weights = NDArray[np.float32]  # numerous, and every checkpoint has its own
Real = TypeVar("Real", np.float32, np.float64)

BEYOND_FENCE_M = 60.0  # search distance: from farther away hardly any photon is counted
OUTSIDE_PRIOR = 0.1  # P(outside the area | H1), of the prior
FENCED_M = 10.0  # size of the cells up to the fence: a track that begins there has an RMS below ``given_up_rms_m``
OUTER_CELL_M = 20.0  # size of the cells beyond: a bearing from the area's centre is right to some 10 degrees
MAX_RING_CELLS = 1000  # with more, the cells are larger
_DISTANCES, _RING_DISTANCES = 64, 20  # tabulated distances of the likelihood of counts, with interpolation between them
_NARROW = 0.5  # cells squared; a kernel of three cells has a variance of at most 1


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """A rectangle of rows and columns of grid cells of one size, of which some may be left out.

    centre: of the rectangle, and x, y: (cells,) of the cells; mission frame, metres. shape: (Y, X), rows and columns of the
    rectangle. place: (cells,) flat indices of the cells in it. samples: number of distances in a table of likelihoods.
    """

    cell_m: float
    centre: tuple[float, float]
    shape: tuple[int, int]
    place: NDArray[np.intp]
    x: Array
    y: Array
    samples: int

    @staticmethod
    def filled(west: float, south: float, cell_m: float, shape: tuple[int, int], samples: int) -> Block:
        """Return a block with all cells of the rectangle that has its south-west corner at (west, south)."""
        rows, columns = shape
        x, y = np.meshgrid(west + cell_m * (np.arange(columns) + 0.5), south + cell_m * (np.arange(rows) + 0.5))
        centre = west + cell_m * columns / 2.0, south + cell_m * rows / 2.0
        return Block(cell_m, centre, shape, np.arange(x.size), x.ravel(), y.ravel(), samples)

    def ring(self, reach: Polygon, width_m: float, cell_m: float) -> Block:
        """Return a block with the cells around this block's rectangle, in a ring ``width_m`` wide, whose centres are in
        ``reach``.

        cell_m: size of these cells; the actual size may be a little smaller, as the cells line up with the rectangle's longer
        side.
        """
        height, length = (count * self.cell_m for count in self.shape)
        ring_m2 = 2.0 * width_m * (height + length + 2.0 * width_m)
        longest = max(height, length)
        cell_m = longest / math.ceil(longest / max(cell_m, math.sqrt(ring_m2 / MAX_RING_CELLS)))
        more = 2 * math.ceil(width_m / cell_m)
        rows, columns = (max(1, round(side / cell_m)) + more for side in (height, length))
        east, north = self.centre
        full = Block.filled(east - columns * cell_m / 2.0, north - rows * cell_m / 2.0, cell_m, (rows, columns), _RING_DISTANCES)
        around = (np.abs(full.x - east) > length / 2.0) | (np.abs(full.y - north) > height / 2.0)
        place = np.flatnonzero(around & contains_xy(reach, full.x, full.y))
        return Block(cell_m, self.centre, full.shape, place, full.x[place], full.y[place], _RING_DISTANCES)

    def diffused(self, weight: Weights, variance_m2: float) -> Weights:
        """Return the weights (A, cells) after a random walk, with this variance per axis (m2), of the source: a Gaussian
        convolution.

        Weight that would leave the block is reflected at its edges, so that the sum stays. A: number of activities.
        """
        full = np.zeros((len(weight), math.prod(self.shape)), np.float32)
        full[:, self.place] = weight
        blurred: Weights = _blurred(full.reshape(-1, *self.shape), variance_m2 / self.cell_m**2).reshape(full.shape)
        if len(self.place) == full.shape[1]:
            return blurred
        kept = blurred[:, self.place]  # the lost part is distributed over the other cells
        total, left = (values.sum(axis=1, keepdims=True) for values in (weight, kept))
        result: Weights = kept * (total / np.maximum(left, np.float32(1e-30)))
        return result


class Grid:
    """The grid of a search: C cells of the area and around it, A activities, B background levels and M motion modes, with their
    priors.

    x, y, z: (C,) cell centres on the ground, mission frame, metres; cell_m: (C,) sizes. inside: (C,), cells in the area; beyond:
    (C,), beyond the fence. prior: (C,) P(cell | source). blocks: the area's bounding box, a ring up to the fence, and one beyond
    it. log_activity: (A,) a = ln(activity / REFERENCE_BQ), evenly spaced; activity_variance: of a within a level, spacing^2 / 12.
    background: (B,) levels f, relative to the tables; background_prior: (B,) P(f), proportional to
    exp(-(ln f)^2 / (2 background_sigma^2)). motion_prior: (M,) P(mode). diffusion_m2ps: (M - 1,) variance per second and axis, of
    the moving modes.
    """

    def __init__(self, area: Polygon, fence_margin_m: float, config: BayesEstimatorConfig, ground: Ground) -> None:
        """Make the cells of a search area (mission frame, metres), of size ``config.cell_m``, or larger for at most
        ``config.most_cells``.
        """
        west, south, east, north = area.bounds
        cell_m = max(config.cell_m, ((east - west) * (north - south) / config.most_cells) ** 0.5)
        rows, columns = (max(1, math.ceil((side - cell_m / 2.0) / cell_m)) for side in (north - south, east - west))
        fence, reach = area.buffer(fence_margin_m), area.buffer(fence_margin_m + BEYOND_FENCE_M)
        self.blocks = [Block.filled(west, south, cell_m, (rows, columns), _DISTANCES)]
        if fence_margin_m > 0.0:
            self.blocks.append(self.blocks[-1].ring(reach, fence_margin_m, FENCED_M))
        self.blocks.append(self.blocks[-1].ring(reach, BEYOND_FENCE_M, OUTER_CELL_M))
        self._ends = np.cumsum([len(block.place) for block in self.blocks])[:-1]
        self.x, self.y = (np.concatenate([getattr(block, axis) for block in self.blocks]) for axis in ("x", "y"))
        self.z: Array = ground.heights_m(np.column_stack((self.x, self.y)))
        self.cell_m = np.repeat([block.cell_m for block in self.blocks], [len(block.place) for block in self.blocks])
        self.inside: NDArray[np.bool_] = contains_xy(area.buffer(cell_m / 2.0), self.x, self.y)
        self.inside[len(self.blocks[0].place) :] = False
        self.beyond: NDArray[np.bool_] = ~contains_xy(fence, self.x, self.y) & ~self.inside
        inside, around = self.inside, self.cell_m**2 * (contains_xy(reach, self.x, self.y) & ~self.inside)
        self.prior: Array = (1.0 - OUTSIDE_PRIOR) * inside / max(int(inside.sum()), 1) + OUTSIDE_PRIOR * around / around.sum()
        least, most = (np.log(value / REFERENCE_BQ) for value in config.activity_bq)
        self.log_activity = np.linspace(least, most, config.activity_levels)
        self.activity_variance = ((most - least) / (config.activity_levels - 1)) ** 2 / 12.0
        self.diffusion_m2ps = config.search_diffusion_m2ps
        self.motion_prior: Array = np.array(config.motion_prior) / sum(config.motion_prior)
        self.background: Array = np.array(config.background_levels)
        prior = np.exp(-0.5 * (np.log(self.background) / config.background_sigma) ** 2)
        self.background_prior: Array = prior / prior.sum()

    def by_block(self, values: NDArray[Real]) -> list[NDArray[Real]]:
        """Split values (..., C) of all C grid cells into one array for each block (rectangle of cells of one size)."""
        return np.split(values, self._ends, axis=-1)

    def diffused(self, weight: Weights, variance_m2: float) -> Weights:
        """Return weights (A, C) after a random walk of the source with this variance per axis (m2), within each block."""
        parts = zip(self.blocks, self.by_block(weight), strict=True)
        return np.concatenate([block.diffused(part, variance_m2) for block, part in parts], axis=1)


def _blurred(weight: Weights, variance: float) -> Weights:
    """Convolve along the last two axes with a Gaussian of a variance in cells squared, reflected at the edges (same sum)."""
    if variance > _NARROW:
        blur = variance**0.5
        return np.asarray(gaussian_filter(weight, (0.0, blur, blur), mode="reflect", truncate=3.0))
    to_next = 0.5 * variance  # a narrow Gaussian, sampled at the cells and cut off, would lose its variance
    for axis in (-2, -1):
        weight = correlate1d(weight, (to_next, 1.0 - variance, to_next), axis=axis, mode="reflect")
    return weight
