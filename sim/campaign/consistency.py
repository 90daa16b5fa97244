"""Consistency of an estimator over many flights: does its stated uncertainty match its errors? Coverage, NEES, error over bound.

One sample per run, half-way through the tracking, so that the samples are independent: the number of truths in the 50 % (90 %)
region of the posterior is then binomial, and the squared errors in units of the covariance (NEES) follow a chi-squared
distribution with two degrees of freedom. A run that ends earlier gives its last sample; lost runs are included.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from msgspec import Struct
from scipy.stats import chi2, kstest

from radron.sim.campaign.flights import Flown
from radron.sim.campaign.report import failed_note
from radron.sim.campaign.table import Table, write_table
from radron.sim.figures.consistency import consistency_figure
from radron.sim.figures.style import save
from radron.sim.result import RunResult
from radron.sim.runfile import write_text
from radron.sim.scoring.statistics import error_over_bound, share_interval, summarise

X0_ERROR_M = 8.0  # requirement: 90 % of the errors of x0 are within
SCENARIOS = tuple(f"{poses}-{what}" for poses in ("ideal", "biased") for what in (
    "static-solo", "static-swarm", "moving-solo", "moving-swarm",
))  # fmt: skip


class Share(Struct, frozen=True):
    """How often an event occurred in many flights, and the 95 % confidence interval of its probability (Clopper and Pearson)."""

    hits: int
    of: int
    low: float | None
    high: float | None

    @classmethod
    def among(cls, hits: int, of: int) -> Share:
        """Make the share of an event that occurred in ``hits`` of ``of`` flights."""
        return cls(hits, of, *(share_interval(hits, of) or (None, None)))

    def agrees(self, probability: float) -> bool | None:
        """Return whether the flights are compatible with this probability of the event; None without a flight."""
        return None if self.low is None or self.high is None else self.low <= probability <= self.high


class Spread(Struct, frozen=True):
    """Median, 90 % quantile and maximum of a number over many flights; None without a number from any flight."""

    count: int
    median: float | None
    p90: float | None
    largest: float | None

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Compute the quantiles of these values."""
        if not len(values):
            return cls(0, None, None, None)
        return cls(len(values), float(np.median(values)), float(np.quantile(values, 0.9)), float(max(values)))


class Consistency(Struct, frozen=True, kw_only=True):
    """Statistics of whether the stated uncertainty of an estimator matches its errors, in one scenario. Lengths in m.

    in_50, in_90: flights whose 50 % (90 %) region contains the truth. nees_mean: mean of the squared errors in units of the
    covariance (ideal: 2); nees_low, nees_high: 95 % interval of this mean for a calibrated estimator. uniform_p: p-value of the
    hypothesis that the truth's probability levels are uniform (Kolmogorov and Smirnov). over_bound: each flight's median error in
    units of its theoretical bound.
    """

    scenario: str
    estimator: str
    runs: int
    lost: int
    in_50: Share
    in_90: Share
    nees_mean: float | None
    nees_low: float | None
    nees_high: float | None
    uniform_p: float | None
    error: Spread
    bound_median_m: float | None
    bound_relative_median_m: float | None
    over_bound: Spread
    relative: Spread
    x0_error: Spread
    x0_rms: Spread
    x0_within: Share  # X0_ERROR_M


def consistency_of(label: str, runs: Sequence[RunResult]) -> Consistency:
    """Compute the consistency of an estimator in one scenario from its flights. ``label``: name of the scenario."""
    summary = summarise(runs)
    regions = [run.region for run in runs if run.region is not None]
    nees = [run.nees_sample for run in runs if run.nees_sample is not None]
    x0_errors = [run.x0_error_m for run in runs if run.x0_error_m is not None]
    low, high = chi2.ppf((0.025, 0.975), 2 * len(nees)) / len(nees) if nees else (None, None)
    return Consistency(
        scenario=label,
        estimator=", ".join(sorted({run.estimator for run in runs})),
        runs=len(runs),
        lost=summary.lost,
        in_50=Share.among(summary.in_50, summary.sampled),
        in_90=Share.among(summary.in_90, summary.sampled),
        nees_mean=float(np.mean(nees)) if nees else None,
        nees_low=None if low is None else float(low),
        nees_high=None if high is None else float(high),
        uniform_p=float(kstest(regions, "uniform").pvalue) if regions else None,
        error=Spread.of([run.error_median_m for run in runs if run.error_median_m is not None]),
        bound_median_m=summary.bound_median_m,
        bound_relative_median_m=summary.bound_relative_median_m,
        over_bound=Spread.of([ratio for ratio in map(error_over_bound, runs) if ratio is not None]),
        relative=Spread.of([run.error_relative_median_m for run in runs if run.error_relative_median_m is not None]),
        x0_error=Spread.of(x0_errors),
        x0_rms=Spread.of([run.x0_rms_m for run in runs if run.x0_rms_m is not None]),
        x0_within=Share.among(sum(error <= X0_ERROR_M for error in x0_errors), len(x0_errors)),
    )


def write_consistency(folder: Path, flown: Flown) -> tuple[Table, list[Path]]:
    """Write ``consistency.txt``, ``.csv``, ``.md``, ``.json`` and ``.png`` of a campaign into its folder.

    Return the table, and the files written.
    """
    groups = [(case.label, flown.of(case)) for case in flown.campaign.cases]
    found = [consistency_of(label, runs) for label, runs in groups if runs]
    table = consistency_table(found, failed_note(flown))
    written = write_table(folder, "consistency", table)
    text = msgspec.json.format(msgspec.json.encode(found).decode(), indent=2)
    write_text(folder / "consistency.json", text + "\n")
    written.append(folder / "consistency.json")
    if found:
        save(consistency_figure([(label, runs) for label, runs in groups if runs], f"estimator {found[0].estimator}"),
             folder / "consistency.png")  # fmt: skip
        written.append(folder / "consistency.png")
    return table, written


def consistency_table(found: Sequence[Consistency], failed: str = "") -> Table:
    """Return the statistics as a table, with a column for each scenario."""
    columns = [
        (
            str(one.runs), str(one.lost),
            *_covered(one.in_50, 0.5), *_covered(one.in_90, 0.9),
            _number(one.nees_mean), _interval(one.nees_low, one.nees_high), _number(one.uniform_p),
            _number(one.error.median), _number(one.bound_median_m), _number(one.over_bound.median), _number(one.over_bound.p90),
            _number(one.relative.median), _number(one.bound_relative_median_m),
            _number(one.x0_error.median), _number(one.x0_error.p90), _number(one.x0_error.largest),
            _number(100.0 * one.x0_within.hits / one.x0_within.of if one.x0_within.of else None, 0),
            _number(one.x0_rms.median), _number(one.x0_rms.largest),
        )
        for one in found
    ]  # fmt: skip
    rows = tuple((label, tuple(column[index] for column in columns)) for index, label in enumerate(_LABELS))
    return Table(
        "Does the stated uncertainty match the errors?",
        tuple((one.scenario, one.estimator) for one in found),
        rows,
        11,
        NOTE + failed,
    )


_LABELS = (
    "runs", "runs lost",
    "in the 50 % region (%)", "95 % interval", "agrees", "in the 90 % region (%)", "95 % interval", "agrees",
    "NEES, mean (ideal: 2)", "calibrated: 95 % in", "p of uniform levels",
    "error, median (m)", "bound, median (m)", "error / bound, median", "error / bound, 90 %",
    "own frames, error (m)", "own frames, bound (m)",
    "error of x0, median (m)", "error of x0, 90 % (m)", "error of x0, largest (m)", f"x0 within {X0_ERROR_M:g} m (%)",
    "RMS of x0, median (m)", "RMS of x0, largest (m)",
)  # fmt: skip

NOTE = (
    "One sample per run, half-way through the tracking; the last one of a run that ends earlier. In a region: how often the "
    "region contains the truth, with the 95 % interval of that probability (Clopper and Pearson); it agrees if the interval "
    "contains the nominal value. NEES: squared error in units of the posterior's covariance; the row below gives the 95 % "
    "interval of the mean for a calibrated estimator. p: p-value for uniform probability levels of the truth, as a calibrated "
    "estimator gives them (Kolmogorov, Smirnov). Bound: posterior Cramer-Rao bound for each run's trajectories, as a median "
    "error. Own frames: error of the source's position as each vehicle's localisation sees it."
)


def _covered(share: Share, probability: float) -> tuple[str | None, str | None, str | None]:
    if share.low is None or share.high is None:
        return None, None, None
    agrees = "yes" if share.agrees(probability) else "too often" if share.low > probability else "too seldom"
    return f"{100.0 * share.hits / share.of:.0f}", _interval(100.0 * share.low, 100.0 * share.high, 0), agrees


def _number(value: float | None, digits: int = 2) -> str | None:
    return None if value is None else f"{value:.{digits}f}"


def _interval(low: float | None, high: float | None, digits: int = 2) -> str | None:
    return None if low is None or high is None else f"{low:.{digits}f} - {high:.{digits}f}"
