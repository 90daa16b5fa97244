"""Statistics of the sources estimated in many flights, compared with the true sources: a table with a line for each case."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from msgspec import Struct

from radron.sim.result import RunResult


class SourceSummary(Struct, frozen=True, kw_only=True):
    """Statistics of the estimated sources in a group of flights, from the flights with a comparison.

    Errors in m; None where no flight gives the number. number_right: flights with all sources found and no false source.
    with_false: flights with a false source. true, matched: numbers of sources. nuclides_right, in_90: of the matched sources. The
    errors are medians over the flights of each flight's median (90th percentile) over its matches.
    """

    runs: int
    number_right: int
    with_false: int
    true: int
    matched: int
    nuclides_right: int
    in_90: int
    error_median_m: float | None
    error_p90_m: float | None
    activity_error_median: float | None
    height_error_median_m: float | None


def summarise_sources(results: Sequence[RunResult]) -> SourceSummary:
    """Compute the statistics of the estimated sources in a group of flights."""
    compared = [result for result in results if result.sources_true is not None]
    matched = [(result.sources_found or 0) - (result.false_sources or 0) for result in compared]
    return SourceSummary(
        runs=len(compared),
        number_right=sum(result.number_right is True for result in compared),
        with_false=sum(bool(result.false_sources) for result in compared),
        true=sum(result.sources_true or 0 for result in compared),
        matched=sum(matched),
        nuclides_right=sum(result.nuclides_right or 0 for result in compared),
        in_90=sum(round((result.in_region_90 or 0.0) * each) for result, each in zip(compared, matched, strict=True)),
        error_median_m=_median(result.matched_error_median_m for result in compared),
        error_p90_m=_median(result.matched_error_p90_m for result in compared),
        activity_error_median=_median(result.activity_error_median for result in compared),
        height_error_median_m=_median(result.height_error_median_m for result in compared),
    )


Row = tuple[Mapping[str, object], SourceSummary]


_COLUMNS: tuple[tuple[str, Callable[[SourceSummary], str]], ...] = (
    ("runs", lambda s: str(s.runs)),
    ("number right", lambda s: _share(s.number_right, s.runs)),
    ("with a false source", lambda s: _share(s.with_false, s.runs)),
    ("sources matched", lambda s: _share(s.matched, s.true)),
    ("nuclide right", lambda s: _share(s.nuclides_right, s.matched)),
    ("error, median", lambda s: _metres(s.error_median_m)),
    ("error, 90 %", lambda s: _metres(s.error_p90_m)),
    ("activity error", lambda s: "-" if s.activity_error_median is None else f"{100.0 * s.activity_error_median:.1f} %"),
    ("in the 90 % region", lambda s: _share(s.in_90, s.matched)),
    ("height error", lambda s: _metres(s.height_error_median_m)),
)

NOTE = """

All sources of the estimate at the end of each run against all true ones, matched one to one within 5 m. Number right: all true
ones are matched, and none is false. Errors: medians over the runs of each run's median (90th percentile) over its matches.
"""


def sources_markdown(rows: Sequence[Row]) -> str:
    """Return the statistics of the estimated sources, rounded, in Markdown with definitions; empty without any comparison."""
    rows = [row for row in rows if row[1].runs]
    if not rows:
        return ""
    head = [*rows[0][0], *(name for name, _ in _COLUMNS)]
    lines = [head, ["---"] * len(head)]
    lines += [[*map(str, case.values()), *(cell(summary) for _, cell in _COLUMNS)] for case, summary in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + NOTE


def _share(hits: int, of: int) -> str:
    return f"{hits} of {of}"


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} m"


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
