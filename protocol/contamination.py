"""Contaminated ground as an estimator has mapped it: what is there, how much of it, and the dose rate above it."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from msgspec import Meta, Struct

from radron.protocol.units import Metres, Nuclide, Position, PositiveMetres

MAX_BLOCKS = 400  # an estimate with its sources stays below 4 kB
MAX_LEVEL = 250  # of the integers in a map

Level = Annotated[int, Meta(ge=0, le=MAX_LEVEL)]
Quantity = Annotated[float, Meta(ge=0.0, le=1e18)]
Evidence = Annotated[float, Meta(ge=-1e9, le=1e9)]


class Finding(StrEnum):
    """The kind of contamination that explains the counts best."""

    NOTHING = "nothing"
    POINTS = "points"
    EXTENDED = "extended source"
    AREA = "area"
    AREA_AND_SPOTS = "area with hot spots"


class Range(Struct, frozen=True, array_like=True):
    """A quantity: its median, and the 5 % and 95 % quantiles."""

    median: Quantity
    low: Quantity
    high: Quantity


class Block(Struct, frozen=True, array_like=True):
    """Mean activity per area of a square block, in the map's unit: its median, and the 5 % and 95 % quantiles."""

    median: Level
    low: Level
    high: Level


class Contamination(Struct, frozen=True, kw_only=True):
    """Activity per area of the ground, of one nuclide, in square blocks; surface-equivalent: as if nothing lay deeper.

    ``finding``: the decision; ``evidences``: by decision, the natural logarithm of the likelihood ratio to nothing. ``total_bq``:
    activity of the whole area, without that of point sources. ``least_bqm2``: uniform contamination below it cannot be told from
    background. ``corner_m``: south-western corner of the first block, mission frame; ``block_m``: its side; ``across``: number of
    blocks from west to east. ``blocks`` run from west to east and then north, in units of ``unit_bqm2``; a block outside of the
    area is 0 throughout. ``highest_bqm2``: the highest block, with its middle
    ``highest_m``. ``dose_svph``: the highest ambient dose equivalent rate H*(10) one metre above ground, Sv/h, without the
    natural one, at ``dose_m``.
    """

    nuclide: Nuclide
    finding: Finding
    evidences: Annotated[dict[Finding, Evidence], Meta(max_length=len(Finding))]
    total_bq: Range
    least_bqm2: Quantity
    corner_m: tuple[Metres, Metres]
    block_m: PositiveMetres
    across: Annotated[int, Meta(ge=1, le=MAX_BLOCKS)]
    unit_bqm2: Quantity
    blocks: Annotated[tuple[Block, ...], Meta(min_length=1, max_length=MAX_BLOCKS)]
    highest_bqm2: Range
    highest_m: Position
    dose_svph: Range
    dose_m: Position

    def flaw(self) -> str | None:
        """Return an error text if blocks do not fill their rows, or quantiles do not ascend; else None."""
        if len(self.blocks) % self.across:
            return f"its {len(self.blocks)} blocks are no whole rows of {self.across}"
        ranges: tuple[Range | Block, ...] = (self.total_bq, self.highest_bqm2, self.dose_svph, *self.blocks)
        if not all(one.low <= one.median <= one.high for one in ranges):
            return "a median is not between the quantiles of 5 % and 95 %"
        return None
