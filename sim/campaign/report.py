"""Reports on a simulated flight or a campaign: a sentence, tables, figures."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np
from matplotlib.figure import Figure
from msgspec import Struct

from radron.protocol.codes import Code
from radron.sim.campaign.flights import Flown
from radron.sim.campaign.sources import sources_markdown, summarise_sources
from radron.sim.figures.campaign import boxes_figure, ecdf_figure, tuning_figure
from radron.sim.figures.error import error_figure
from radron.sim.figures.map import last_tracking, map_figure
from radron.sim.figures.posterior import posterior_figure
from radron.sim.figures.sources import sources_figure
from radron.sim.figures.spacing import spacing_figure
from radron.sim.figures.style import becquerels, metres, save, seconds
from radron.sim.result import Flight, RunResult, Trace
from radron.sim.runfile import json_line, write_text
from radron.sim.scoring.statistics import Summary, summarise


def sentence(result: RunResult, trace: Trace) -> str:
    """Return a sentence on the source estimate at the end of the tracking.

    It gives the position, the 1-sigma radius, and the distance from the truth.
    """
    end = last_tracking(trace)
    estimate, source = trace.estimate_m[end], trace.source_m[end]
    if not np.isfinite(estimate).all():
        return _without_estimate(result, bool(np.isfinite(source).all()))
    where = f"({estimate[0]:.1f}, {estimate[1]:.1f}) m east and north of the mission's origin"
    if not np.isfinite(source).all():
        what = "False source estimate" if result.false_hypothesis else "Given hypothesis"
        return f"{what}: {where}; there is no source in this scenario."
    error = float(np.hypot(*(estimate - source)[:2]))
    lost = "; the source was lost" if result.lost else ""
    sigma = _length(float(trace.sigma_m[end]))
    return f"Source estimate: {where}, 1 sigma = {sigma}; {_length(error)} from the truth{lost}.{_all_sources(result)}"


def _all_sources(result: RunResult) -> str:
    """Report the number of sources found, as a further sentence; empty for one true and one estimated source."""
    true, found, false = result.sources_true or 0, result.sources_found or 0, result.false_sources or 0
    if max(true, found) <= 1:
        return ""
    told = f" {found - false} of {true} sources found, {result.nuclides_right or 0} with the right nuclide"
    return f"{told}; {false} false.{_excluded(result)}" if false else f"{told}.{_excluded(result)}"


def _excluded(result: RunResult) -> str:
    """Report the excluded activities of a search for several sources; empty for another search."""
    if result.excluded_nuclides_bq is None or result.excluded_bq is None:
        return ""
    return f" Further ones of {becquerels(result.excluded_bq)} or more, of whichever nuclide, are excluded."


def _without_estimate(result: RunResult, there: bool) -> str:
    """Report a flight without an estimate. ``there``: there is a source."""
    excluded = "" if result.excluded_bq is None else f"{becquerels(result.excluded_bq)} or more would have been found anywhere"
    if result.finding_code == Code.SOURCE_OUTSIDE:
        return f"The swarm tells: {result.finding}."
    if result.decision is not None:
        total = "" if result.total_error is None else f"; the activity is {100.0 * result.total_error:.0f} % off"
        return f"The map tells: {result.decision}{total}."
    if result.finding_code == Code.MAPPED:
        return f"The swarm has {result.finding}."
    if result.nothing_found or not there:
        truth = "though there is one" if there else "and there is none"
        return f"The swarm found no source, {truth}{f'; one of {excluded}' if excluded else ''}."
    return (
        f"The swarm did not find the source: {result.cones} cones in {result.sim_s:.0f} s of flight "
        "were not enough for an initial estimate."
    )


def faults_of(trace: Trace) -> str:
    """Return a sentence that names the faults of the flight, each with its time; empty without faults."""
    end_s = float(trace.time_s[-1])
    ends = ["on" if fault.end_s >= end_s else f"to {fault.end_s:g} s" for fault in trace.faults]
    told = [f"{fault.label} from {fault.begin_s:g} s {end}" for fault, end in zip(trace.faults, ends, strict=True)]
    return f"Faults: {'; '.join(told)}." if told else ""


def error_of(result: RunResult) -> str:
    """Return the median error of an estimator in words, as part of a sentence."""
    if result.error_median_m is None:
        return "no estimate"
    return f"median error {_length(result.error_median_m)}"


def result_json(result: RunResult) -> str:
    """Return the scores of a flight as one flat JSON object on one line."""
    return json_line(msgspec.structs.asdict(result))


def write_flight(folder: Path, flight: Flight) -> list[Path]:
    """Write the scores and figures of a flight into a folder, which must exist; return the files.

    Files: ``result.json`` (``result-{estimator}.json`` for estimators that only listened), ``map.png``, ``spacing.png``,
    ``error.png``, ``posterior.png`` and ``sources.png``. The last three need a scenario with a source, the very last one several
    sources, true or estimated.
    """
    result = flight.result
    results = {"result.json": result, **{f"result-{name}.json": heard for name, heard in flight.listened.items()}}
    for name, record in results.items():
        write_text(folder / name, result_json(record))
    figures = flight_figures(flight)
    for name, figure in figures.items():
        save(figure, folder / f"{name}.png")
    return [*(folder / name for name in results), *(folder / f"{name}.png" for name in figures)]


def flight_figures(flight: Flight) -> dict[str, Figure]:
    """Return the figures of a flight by name.

    They are ``map`` and ``spacing``; with a source also ``error`` and ``posterior``; with several sources, true or estimated,
    also ``sources``.
    """
    result, trace = flight.result, flight.trace
    title = f"{result.scenario}, seed {result.seed}"
    figures = {
        "map": map_figure(trace, (f"{title}, estimator {result.estimator}", _outcome(result, trace))),
        "spacing": spacing_figure(trace, title),
    }
    if np.isfinite(trace.source_m).any():
        figures["error"] = error_figure(trace, (title, *_course(result)))
        figures["posterior"] = posterior_figure(trace, (f"{title}, estimator {result.estimator}", *_course(result)))
    if max(result.sources_true or 0, result.sources_found or 0) > 1:
        figures["sources"] = sources_figure(trace, (f"{title}, estimator {result.estimator}", _all_sources(result).strip()))
    return figures


def write_campaign(folder: Path, flown: Flown) -> list[Path]:
    """Write the statistics and figures of a campaign into its folder; return the files.

    Files: ``summary.csv``, ``sources.csv``, ``summary.md``, ``boxes.png``, ``ecdf.png`` and, with varied parameters,
    ``tuning.png``.
    """
    groups = [(case, flown.of(case)) for case in flown.campaign.in_order()]
    groups = [(case, runs) for case, runs in groups if runs]
    if not groups:
        return []
    rows = [({"scenario": case.name, **dict(case.point)}, summarise(runs)) for case, runs in groups]
    sources = [(case, summarise_sources(runs)) for (case, _), (_, runs) in zip(rows, groups, strict=True)]
    write_text(folder / "summary.csv", cases_csv(rows))
    write_text(folder / "sources.csv", cases_csv(sources))
    write_text(folder / "summary.md", f"{summary_markdown(rows)}\n{sources_markdown(sources)}{failed_note(flown)}")
    estimators = ", ".join(sorted({run.estimator for _, runs in groups for run in runs}))
    title = f"estimator {estimators}, seeds from {flown.campaign.seed_base}"
    figures = {"boxes.png": boxes_figure(groups, title), "ecdf.png": ecdf_figure(groups, title)}
    if flown.campaign.parameters:
        figures["tuning.png"] = tuning_figure(groups, title)
    for name, figure in figures.items():
        save(figure, folder / name)
    return [folder / name for name in ("summary.csv", "sources.csv", "summary.md", *figures)]


def failed_note(flown: Flown) -> str:
    """Return a note in Markdown that names the failed flights, which count in no number; empty without failures."""
    if not flown.failures:
        return ""
    named = ", ".join(outcome.job.label for outcome in flown.failures)
    return f"\n{len(flown.failures)} flights failed and are in none of these numbers: {named}.\n"


def case_sentence(label: str, runs: Sequence[RunResult]) -> str:
    """Return the results of one case of a campaign in one line."""
    if not runs:
        return f"{label}: all runs failed"
    s = summarise(runs)
    found = f"initial estimate after {seconds(s.time_to_x0_median_s)} (in {s.found} of {s.runs} runs)"
    bound = "" if s.error_over_bound is None else f", {s.error_over_bound:.2f} times the bound"
    parts = [f"{label}: {found}, error {metres(s.error_median_m)}{bound} (medians)", f"lost in {s.lost}"]
    if s.nothing_found:
        excluded = "" if s.excluded_median_bq is None else f", {becquerels(s.excluded_median_bq)} or more excluded (median)"
        parts.append(f"nothing found in {s.nothing_found}{excluded}")
    sources = summarise_sources(runs)
    if sources.true > sources.runs:
        parts.append(f"number of sources right in {sources.number_right}")
    if s.false_hypotheses:
        parts.append(f"a false hypothesis in {s.false_hypotheses}")
    return "; ".join(parts)


Row = tuple[Mapping[str, object], Summary]


def cases_csv(rows: Sequence[tuple[Mapping[str, object], Struct]]) -> str:
    """Return the statistics of all cases as CSV: scenario and parameters, then all numbers; empty cells for missing numbers."""
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow([*rows[0][0], *rows[0][1].__struct_fields__])
    for case, summary in rows:
        table.writerow([*case.values(), *("" if value is None else value for value in msgspec.structs.astuple(summary))])
    return stream.getvalue()


def summary_markdown(rows: Sequence[Row]) -> str:
    """Return a rounded selection of the statistics of all cases for reading, in Markdown, with the definitions."""
    head = [
        *rows[0][0], "runs", "found", "lost", "time to x0, median (95 %)", "max", "tracking time, mean", "error, median (95 %)",
        "error, mean", "bound, median", "error / bound", "error in own frames", "in the 50 % region", "in the 90 % region",
        "NEES", "x0 RMS", "x0 error, 90 %", "nothing found", "false hypotheses", "least separation", "fence breaches",
    ]  # fmt: skip
    lines = [" | ".join(head), " | ".join("---" for _ in head)]
    for case, s in rows:
        cells = [
            *(str(value) for value in case.values()), str(s.runs), str(s.found), str(s.lost),
            _with_interval((s.time_to_x0_median_s, s.time_to_x0_low_s, s.time_to_x0_high_s), "s", 1),
            _unit(s.time_to_x0_max_s, "s", 1), _unit(s.tracking_time_mean_s, "s", 1),
            _with_interval((s.error_median_m, s.error_low_m, s.error_high_m), "m", 2),
            _unit(s.error_mean_m, "m", 2), _unit(s.bound_median_m, "m", 2), _unit(s.error_over_bound, "", 2),
            _unit(s.error_relative_median_m, "m", 2), f"{s.in_50} of {s.sampled}", f"{s.in_90} of {s.sampled}",
            _unit(s.nees_median, "", 2), _unit(s.x0_rms_median_m, "m", 2), _unit(s.x0_error_p90_m, "m", 2),
            str(s.nothing_found), str(s.false_hypotheses), _unit(s.min_separation_m, "m", 2), str(s.fence_breaches),
        ]  # fmt: skip
        lines.append(" | ".join(cells))
    return "\n".join(f"| {line} |" for line in lines) + NOTE


NOTE = """

Errors are horizontal: the median (mean) over the runs of each run's median (mean) over all its tracking samples; runs that lost
the source are included. A run without an initial estimate x0 counts as slower than any other in the median time to x0, and as 0 s
of tracking. NEES: median over the runs of their means; 2 is ideal. In brackets: 95 % interval of the median. Bound: posterior
Cramer-Rao bound for each run's trajectories, as a median error. Own frames: error of the source's position as each vehicle's
localisation sees it. In the 50 % (90 %) region: how often this region of the posterior contains the truth, at one sample per run,
half-way through the tracking.
"""


def _outcome(result: RunResult, trace: Trace) -> str:
    end = last_tracking(trace)
    estimate, source = trace.estimate_m[end], trace.source_m[end]
    if not np.isfinite(estimate).all():
        return f"source not found in {result.sim_s:.0f} s"
    if not np.isfinite(source).all():
        return "hypothesis given, no source"
    error = float(np.hypot(*(estimate - source)[:2]))
    return f"error {metres(error)} at {seconds(float(trace.time_s[end]))}, 1 sigma = {metres(float(trace.sigma_m[end]))}"


def _course(result: RunResult) -> list[str]:
    if result.time_to_x0_s is None:
        return ["source not found"]
    lost = ", then lost" if result.lost else ""
    return [
        f"initial estimate after {seconds(result.time_to_x0_s)}, error {metres(result.x0_error_m)}",
        f"tracked for {seconds(result.tracking_time_s)}{lost}, median error {metres(result.error_median_m)}",
    ]


def _length(value_m: float) -> str:
    return f"{value_m:.{2 if value_m < 1.0 else 1 if value_m < 100.0 else 0}f} m"


def _unit(value: float | None, unit: str, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f} {unit}".rstrip()


def _with_interval(values: tuple[float | None, float | None, float | None], unit: str, digits: int) -> str:
    value, *ends = values
    if value is None or ends == [None, None]:
        return _unit(value, unit, digits)
    low, high = ("?" if end is None else f"{end:.{digits}f}" for end in ends)
    return f"{_unit(value, unit, digits)} ({low} - {high})"
