"""Consistency of an estimator's stated uncertainty with its errors, as plots: a row for each scenario."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import beta, binom, chi2

from radron.sim.figures.style import DRONES, ESTIMATE, GRID, TRUTH, dress, new_figure, plain_log, wrapped
from radron.sim.result import RunResult

_BINS = 10
_NEAREST_M, _RATIOS = 0.01, (1.0, 1.5)
Groups = Sequence[tuple[str, Sequence[RunResult]]]


def consistency_figure(groups: Groups, title: str) -> Figure:
    """Make a figure of whether an estimator's stated uncertainty matches its errors, with a row for each scenario.

    Columns: histogram of the smallest posterior regions that contain the truth; quantiles of the squared errors in units of the
    covariance; and each flight's error over its theoretical bound. Grey bands contain 95 % of the results of a calibrated
    estimator, for each bar and each quantile.
    """
    figure = new_figure(12.0, 1.0 + 3.0 * len(groups))
    panels = figure.subplots(len(groups), 3, squeeze=False)
    for row, (label, runs) in enumerate(groups):
        _regions(panels[row, 0], [run.region for run in runs if run.region is not None], label)
        _quantiles(panels[row, 1], [run.nees_sample for run in runs if run.nees_sample is not None])
        _bounds(panels[row, 2], runs)
    what = ["left: the tenth of the posterior in which the truth lies", "middle: squared errors in units of the covariance"]
    figure.suptitle(wrapped((title, *what, "right: a dot for each run"), 120), x=0.01, ha="left", fontsize=11)
    return figure


def _regions(axes: Axes, regions: Sequence[float], label: str) -> None:
    counts, edges = np.histogram(regions, _BINS, (0.0, 1.0))
    low, high = binom.ppf((0.025, 0.975), len(regions), 1.0 / _BINS) if len(regions) else (0.0, 0.0)
    axes.axhspan(low, high, color="#555555", alpha=0.25, zorder=3, linewidth=0)
    axes.axhline(len(regions) / _BINS, color=TRUTH, linewidth=0.8, linestyle="--")
    axes.bar(edges[:-1], counts, 1.0 / _BINS, align="edge", color=DRONES[0], alpha=0.8, edgecolor="white", linewidth=0.6)
    axes.set_xlim(0.0, 1.0)
    dress(axes, label, "smallest region that holds the truth (probability)", "runs")


def _quantiles(axes: Axes, nees: Sequence[float]) -> None:
    count = len(nees)
    if count:
        rank = np.arange(1, count + 1)
        expected = chi2.ppf((rank - 0.5) / count, 2)
        low, high = (chi2.ppf(beta.ppf(level, rank, count + 1 - rank), 2) for level in (0.025, 0.975))
        axes.fill_between(expected, low, high, color=GRID, linewidth=0, zorder=0)
        axes.plot(expected, expected, color=TRUTH, linewidth=0.8, linestyle="--")
        axes.plot(expected, np.sort(nees), ".", color=ESTIMATE, markersize=4)
        axes.set_xlim(0.0, 1.05 * float(expected[-1]))
        axes.set_ylim(0.0, 1.1 * max(float(max(nees)), float(expected[-1])))
    dress(axes, "", "NEES of a calibrated estimator (chi2, 2)", "NEES")


def _bounds(axes: Axes, runs: Sequence[RunResult]) -> None:
    pairs = [
        (run.bound_median_m, run.error_median_m)
        for run in runs
        if run.bound_median_m is not None and run.error_median_m is not None
    ]
    if pairs:
        bound, error = np.maximum(np.array(pairs), _NEAREST_M).T
        ends = np.array([min(bound.min(), error.min()) / 1.3, 1.3 * max(bound.max(), error.max())])
        for ratio, style in zip(_RATIOS, ("-", ":"), strict=True):
            axes.plot(ends, ratio * ends, color=TRUTH, linewidth=0.8, linestyle=style, label=f"{ratio:g} x the bound")
        axes.loglog(bound, error, ".", color=ESTIMATE, markersize=5)
        for axis, limit in ((axes.xaxis, axes.set_xlim), (axes.yaxis, axes.set_ylim)):
            limit(*ends)
            plain_log(axis, *ends)
        axes.legend(fontsize=8, frameon=False)
        axes.set_title(f"error / bound {np.median(error / bound):.2f} (median)", loc="right", fontsize=9)
    dress(axes, "", "bound (m)", "median error of a run (m)")
