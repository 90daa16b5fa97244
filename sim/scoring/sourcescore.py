"""Score of all sources of an estimate against all true sources, matched one to one."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

from radron.protocol.messages import Source as Found
from radron.sim.geometry import Array
from radron.sim.world.sources import Source

MATCH_M = 5.0  # an estimated source farther than this from each true one is false: the least distance of two equal ones
_NEVER = 1e6  # cost of an impossible match
_HEIGHT_M2 = 1e-9  # a smaller variance is of a height that was not estimated
_REGION_90 = float(chi2.ppf(0.9, 2))


class SourceScore(Struct, frozen=True, kw_only=True):
    """Scores of an estimate of several sources, as fields of a ``RunResult``; None without a comparison, or without sources."""

    sources_true: int | None = None
    sources_found: int | None = None
    number_right: bool | None = None
    false_sources: int | None = None
    nuclides_right: int | None = None
    matched_error_median_m: float | None = None
    matched_error_p90_m: float | None = None
    activity_error_median: float | None = None
    in_region_90: float | None = None
    height_error_median_m: float | None = None


def score_sources(truths: Sequence[Source], found: Sequence[Found]) -> SourceScore:
    """Compare all sources of an estimate with all true sources, and return the scores.

    True and estimated sources are matched one to one (Hungarian algorithm). The matching has as many pairs as possible that lie
    within ``MATCH_M`` of each other horizontally; among these, as many right nuclides as possible; and then the smallest sum of
    distances.

    Args:
        truths: the true sources.
        found: the sources of the estimate, with their nuclides.
    """
    pairs = _matched(truths, found)
    errors = [_apart_m(truths[i], found[j]) for i, j in pairs]
    heights = [abs(found[j].position_m[2] - truths[i].place_m[2]) for i, j in pairs if _has_height(found[j])]
    activities = [(truths[i].activity_bq, found[j].activity_bq) for i, j in pairs]
    inside = [_squared_distance(truths[i], found[j]) <= _REGION_90 for i, j in pairs]
    return SourceScore(
        sources_true=len(truths),
        sources_found=len(found),
        number_right=len(truths) == len(found) == len(pairs),
        false_sources=len(found) - len(pairs),
        nuclides_right=sum(truths[i].nuclide == found[j].nuclide for i, j in pairs),
        matched_error_median_m=float(np.median(errors)) if errors else None,
        matched_error_p90_m=float(np.quantile(errors, 0.9)) if errors else None,
        activity_error_median=_median([abs(told_bq / true_bq - 1.0) for true_bq, told_bq in activities if told_bq is not None]),
        in_region_90=sum(inside) / len(inside) if inside else None,
        height_error_median_m=_median(heights),
    )


def _matched(truths: Sequence[Source], found: Sequence[Found]) -> list[tuple[int, int]]:
    cost = np.full((len(truths), len(found)), _NEVER)
    for i, truth in enumerate(truths):
        for j, source in enumerate(found):
            apart_m = _apart_m(truth, source)
            if apart_m <= MATCH_M:
                # A wrong nuclide costs more than all distances of one match can save.
                cost[i, j] = apart_m + (0.0 if truth.nuclide == source.nuclide else 2.0 * MATCH_M)
    rows, columns = linear_sum_assignment(cost)
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if cost[i, j] < _NEVER]


def _apart_m(truth: Source, source: Found) -> float:
    return math.dist(truth.place_m[:2], source.position_m[:2])


def _covariance(source: Found) -> Array:
    xx, xy, xz, yy, yz, zz = source.covariance_m2
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _squared_distance(truth: Source, source: Found) -> float:
    """Return the squared horizontal error in units of the covariance; infinite for a singular covariance."""
    offset = np.subtract(truth.place_m[:2], source.position_m[:2])
    covariance = _covariance(source)[:2, :2]
    if np.linalg.det(covariance) <= 0.0:
        return math.inf
    return float(offset @ np.linalg.solve(covariance, offset))


def _has_height(source: Found) -> bool:
    """Return whether the height was estimated, and not derived from the ground at the estimated place."""
    covariance = _covariance(source)
    if np.linalg.det(covariance[:2, :2]) <= 0.0:
        return False
    along = np.linalg.solve(covariance[:2, :2], covariance[:2, 2])
    return float(covariance[2, 2] - covariance[:2, 2] @ along) > _HEIGHT_M2


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None
