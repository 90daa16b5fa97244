"""Reports of a fit: blocks with intervals, totals, the highest activity and dose rate, and what arithmetic forbids to see."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from radron.agent.fusion.field.dose import dose_map
from radron.agent.fusion.field.fit import Fitted, total
from radron.agent.fusion.field.grid import Grid
from radron.agent.fusion.field.model import CountModel
from radron.agent.geometry import Array
from radron.agent.terrain.ground import Ground
from radron.protocol.contamination import MAX_BLOCKS, MAX_LEVEL, Block, Contamination, Finding, Range

BLOCK_M: Final = 10.0  # least side of a block, and two heights of the detectors: smaller ones have no honest intervals
Z_90: Final = 1.645
Z_DETECTED: Final = 3.29  # sigmas of the detection limit, for 5 % of errors of both kinds


@dataclass(frozen=True, eq=False)
class Blocks:
    """Means of the activity per area, Bq/m2, over B square blocks. functionals: (B, K) linear functions of the ground's numbers.
    mean, sigma: (B,). inside: (B,) m2 of the area in each block. place: (2,) south-western corner, side_m, across: the layout.
    """

    functionals: Array
    mean: Array
    sigma: Array
    inside: Array
    corner: tuple[float, float]
    side_m: float
    across: int

    @classmethod
    def of(cls, fitted: Fitted, model: CountModel) -> Blocks:
        """Return the blocks of a fit with a contaminated area."""
        grid, height_m = model.grid, float(model.live_s @ model.height / model.live_s.sum())
        side_m = max(BLOCK_M, 2.0 * height_m)
        while (layout := grid.blocks(side_m))[1] * layout[2] > MAX_BLOCKS:
            side_m += grid.cell_m
        number, across, up = layout
        weights = np.zeros((across * up, grid.size))
        touched = np.flatnonzero(number >= 0)
        weights[number[touched], touched] = grid.inside_m2[touched]
        inside = weights.sum(axis=1)
        functionals = model.functionals(weights / np.maximum(inside, 1e-9)[:, None])
        mean, covariance = total(fitted, functionals)
        corner = grid.centres[touched].min(axis=0) - 0.5 * grid.cell_m
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        side_m = grid.cells_of(side_m) * grid.cell_m
        return cls(functionals, mean, sigma, inside, (float(corner[0]), float(corner[1])), side_m, across)

    def middle(self, block: int) -> tuple[float, float]:
        """Return the middle of a block, metres, mission frame."""
        up, along = divmod(block, self.across)
        return self.corner[0] + (along + 0.5) * self.side_m, self.corner[1] + (up + 0.5) * self.side_m

    def ranges(self) -> tuple[Array, Array, Array]:
        """Return median, 5 % and 95 % quantiles (B,) given that no activity is negative; 0 for blocks outside of the area."""
        quantiles = (np.maximum(self.mean + z * self.sigma, 0.0) * (self.inside > 0.0) for z in (0.0, -Z_90, Z_90))
        median, low, high = quantiles
        return median, low, high


def total_of(fitted: Fitted, model: CountModel) -> tuple[float, float]:
    """Return mean and sigma of the area's activity in Bq."""
    mean, covariance = total(fitted, model.functionals(model.grid.inside_m2[None]))
    return float(mean[0]), math.sqrt(max(float(covariance[0, 0]), 0.0))


def range_of(mean: float, sigma: float) -> Range:
    """Return a Gaussian quantity that cannot be negative."""
    median, low, high = (max(0.0, mean + z * sigma) for z in (0.0, -Z_90, Z_90))
    return Range(median, low, high)


def contamination(
    nuclide: str,
    finding: Finding,
    evidences: dict[Finding, float],
    total: tuple[float, float],
    blocks: Blocks,
    activity: Array,
    grid: Grid,
    ground: Ground,
) -> Contamination:
    """Return the report of a fit. total: mean and sigma of the area's activity, Bq. activity: (N,) Bq/m2 of the map without
    negative activity.
    """
    median, low, high = blocks.ranges()
    unit = max(float(high.max()), 1.0) / MAX_LEVEL
    area_m2 = float(grid.inside_m2.sum())
    top = int(np.argmax(median))
    dose = np.where(grid.inside > 0.0, dose_map(nuclide, activity, grid), 0.0)
    most = int(np.argmax(dose))
    relative = float(blocks.sigma[top] / max(blocks.mean[top], blocks.sigma[top]))
    x, y = blocks.middle(top)
    east, north = grid.centres[most].tolist()
    return Contamination(
        nuclide=nuclide,
        finding=finding,
        evidences=evidences,
        total_bq=range_of(*total),
        least_bqm2=Z_DETECTED * total[1] / area_m2,
        corner_m=blocks.corner,
        block_m=blocks.side_m,
        across=blocks.across,
        unit_bqm2=unit,
        blocks=tuple(map(Block, *(_levels(values, unit) for values in (median, low, high)))),
        highest_bqm2=Range(float(median[top]), float(low[top]), float(high[top])),
        highest_m=(x, y, ground.height_m(x, y)),
        dose_svph=range_of(float(dose[most]), relative * float(dose[most])),
        dose_m=(east, north, ground.height_m(east, north)),
    )


def _levels(values: Array, unit: float) -> tuple[int, ...]:
    return tuple(np.clip(np.rint(values / unit), 0, MAX_LEVEL).astype(int).tolist())
