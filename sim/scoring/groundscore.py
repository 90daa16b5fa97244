"""Score of an estimate of contaminated ground against the true one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from shapely import Polygon, contains_xy

from radron.protocol.contamination import Contamination, Finding
from radron.sim.geometry import Array
from radron.sim.radiation.ground.dose import ambient_dose_svph
from radron.sim.world.contamination import Contaminated

COMPACT_M = 35.0  # diameter up to which a contaminated part is right as an extended source, too
_HOT_SHARE = 0.5  # of the highest true block: hot blocks are above it
_MOST_INSIDE = 0.5  # share of a block that lies in the area, from which on it is scored


class GroundScore(Struct, frozen=True, kw_only=True):
    """Scores of an estimate of contaminated ground, as fields of a ``RunResult``; None without a comparison."""

    decision: str | None = None
    decision_right: bool | None = None
    total_error: float | None = None
    total_in_90: bool | None = None
    block_error_median: float | None = None
    blocks_in_90: float | None = None
    dose_error_median: float | None = None
    map_first_s: float | None = None


def score_ground(
    contaminated: Sequence[Contaminated], has_sources: bool, area: Polygon, ground_name: str, told: Contamination | None
) -> GroundScore:
    """Compare an estimate of contaminated ground with the true one, and return the scores.

    Totals are of the area, blocks those above half of the highest true one, and doses the highest of 1 m above the ground.
    Without contaminated ground the decision alone is scored, and without an estimate nothing.

    Args:
        contaminated: the true parts. For the amounts only those of the estimate's nuclide count, without hot spots, which the
            estimate tells as sources.
        has_sources: whether there are point sources.
        area: the mission's area.
        ground_name: kind of the ground, for the true dose rate.
        told: the estimate; None: there is none.
    """
    if told is None:
        return GroundScore()
    decision = GroundScore(decision=str(told.finding), decision_right=told.finding in right_findings(contaminated, has_sources))
    parts = [part for part in contaminated if part.source.nuclide == told.nuclide and not part.spots]
    inside = [contains_xy(area, part.source.x_m, part.source.y_m) for part in parts]
    total_bq = sum(float(part.source.activity_bq[kept].sum()) for part, kept in zip(parts, inside, strict=True))
    if total_bq == 0.0:
        return decision
    truth, scored = block_means(parts, area, told)
    hot = scored & (truth > _HOT_SHARE * truth[scored].max(initial=0.0))
    median, low, high = told.unit_bqm2 * np.array([(block.median, block.low, block.high) for block in told.blocks]).T
    half_unit = 0.5 * told.unit_bqm2  # the maps are rounded
    held = (low - half_unit <= truth) & (truth <= high + half_unit)
    dose_svph = ambient_dose_svph([part.source for part in parts], ground_name, area)
    return GroundScore(
        decision=decision.decision,
        decision_right=decision.decision_right,
        total_error=abs(told.total_bq.median / total_bq - 1.0),
        total_in_90=told.total_bq.low <= total_bq <= told.total_bq.high,
        block_error_median=float(np.median(np.abs(median[hot] / truth[hot] - 1.0))) if hot.any() else None,
        blocks_in_90=float(np.mean(held[hot])) if hot.any() else None,
        dose_error_median=abs(told.dose_svph.median / dose_svph - 1.0),
    )


def right_findings(contaminated: Sequence[Contaminated], has_sources: bool) -> set[Finding]:
    """Return the decisions that are right for this ground and for point sources beside it."""
    areas = [part for part in contaminated if not part.spots]
    has_points = has_sources or len(areas) < len(contaminated)
    if not areas:
        return {Finding.POINTS if has_points else Finding.NOTHING}
    if has_points:
        return {Finding.AREA_AND_SPOTS}
    is_compact = len(areas) == 1 and areas[0].reach_m <= COMPACT_M
    return {Finding.AREA, Finding.EXTENDED} if is_compact else {Finding.AREA}


def block_means(parts: Sequence[Contaminated], area: Polygon, told: Contamination) -> tuple[Array, NDArray[np.bool_]]:
    """Return the true mean activity per area of each block of the estimate, (B,) Bq/m2, and which blocks are scored, (B,) bool.

    A mean is over the part of a block in the area; blocks that lie in it by less than half are not scored.
    """
    along, up = told.across, len(told.blocks) // told.across
    west, south = told.corner_m
    activity = np.zeros(along * up)
    for part in parts:
        x, y = part.source.x_m, part.source.y_m
        column, row = (np.floor((place - edge) / told.block_m).astype(int) for place, edge in ((x, west), (y, south)))
        kept = contains_xy(area, x, y) & (column >= 0) & (column < along) & (row >= 0) & (row < up)
        np.add.at(activity, row[kept] * along + column[kept], part.source.activity_bq[kept])
    inside_m2 = np.array([area.intersection(_square(told, place)).area for place in range(along * up)])
    scored = inside_m2 >= _MOST_INSIDE * told.block_m**2
    return np.asarray(np.where(scored, activity / np.maximum(inside_m2, 1e-9), 0.0)), scored


def _square(told: Contamination, block: int) -> Polygon:
    up, along = divmod(block, told.across)
    west, south = told.corner_m[0] + along * told.block_m, told.corner_m[1] + up * told.block_m
    east, north = west + told.block_m, south + told.block_m
    return Polygon([(west, south), (east, south), (east, north), (west, north)])
