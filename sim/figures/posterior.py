"""Figure of the posterior during a flight: regions around the truth, stated and actual error, activity, evidence."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from radron.sim.figures.ellipse import draw_regions, reach_m
from radron.sim.figures.map import last_tracking
from radron.sim.figures.style import (
    DRONES,
    ESTIMATE,
    MIN_SHOWN_M,
    TRUTH,
    becquerels,
    dress,
    metres,
    new_figure,
    plain_log,
    seconds,
    stage_bands,
    wrapped,
)
from radron.sim.geometry import Array
from radron.sim.result import Trace

INSTANTS = 5
_CLEARLY = 0.8


def posterior_figure(trace: Trace, title: tuple[str, ...]) -> Figure:
    """Draw the posterior of the source during a flight, by the first drone.

    Above: 50 % and 90 % regions at several times, relative to the truth. Below, over time: error, stated RMS and theoretical
    bound; activity with its 1-sigma error; evidence. Quantities that the estimator does not give are left out.
    """
    below = [_errors, *([_activity] if _known(trace.activity_bq) else []), *([_evidence] if _known(trace.evidence) else [])]
    figure = new_figure(10.0, 3.0 + 2.3 * len(below))
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=[2.6, 2.3 * len(below)])[:, 0]
    for axes, instant in zip(top.subplots(1, INSTANTS, squeeze=False)[0], _instants(trace), strict=True):
        _regions(axes, trace, instant)
    panels = bottom.subplots(len(below), 1, sharex=True, squeeze=False)[:, 0]
    for number, (axes, draw) in enumerate(zip(panels, below, strict=True)):
        stage_bands(axes, trace.time_s, trace.swarm_stage, named=number == 0)
        axes.set_xlim(float(trace.time_s[0]), float(trace.time_s[-1]))
        draw(axes, trace)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
    panels[-1].set_xlabel("time since the start command (s)")
    figure.suptitle(wrapped(title, 110), x=0.01, ha="left", fontsize=11)
    return figure


def _instants(trace: Trace) -> list[int | None]:
    """Samples with a posterior, from the first to the last of the tracking, at increasing intervals; None where there are
    fewer.
    """
    has = np.flatnonzero(np.isfinite(trace.covariance_m2[:, 0, 0]))
    has = has[has <= last_tracking(trace)]
    if not len(has):
        return [None] * INSTANTS
    since = trace.time_s[has] - trace.time_s[has[0]]
    wanted = np.concatenate(([0.0], np.geomspace(min(2.0, max(since[-1], 1e-3)), max(since[-1], 1e-3), INSTANTS - 1)))
    chosen = np.unique(np.searchsorted(since, wanted - 1e-9).clip(0, len(has) - 1))
    return [*has[chosen].tolist(), *[None] * (INSTANTS - len(chosen))]


def _regions(axes: Axes, trace: Trace, instant: int | None) -> None:
    """The regions at one time, relative to the truth; east to the right."""
    if instant is None:
        axes.set_visible(False)
        return
    covariance = trace.covariance_m2[instant]
    offset = (trace.estimate_m[instant] - trace.source_m[instant])[:2]
    x, y = (float(value) for value in offset)
    draw_regions(axes, (x, y), covariance)
    axes.plot(x, y, marker="X", color=ESTIMATE, markersize=7, markeredgecolor="white", zorder=6)
    axes.plot(0.0, 0.0, marker="*", color=TRUTH, markersize=11, markeredgecolor="white", zorder=7)
    reach = 1.1 * max(reach_m(covariance) + max(abs(x), abs(y)), MIN_SHOWN_M)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=7)
    dress(axes)
    axes.set_title(f"{seconds(float(trace.time_s[instant]))}: error {metres(float(np.hypot(x, y)))}", fontsize=9, loc="left")


def _errors(axes: Axes, trace: Trace) -> None:
    error = np.linalg.norm((trace.estimate_m - trace.source_m)[:, :2], axis=1)
    lines = [error, trace.sigma_m, trace.bound_m]
    if _apart(trace):
        lines += [trace.own_error_m, trace.own_bound_m]
    axes.semilogy(trace.time_s, np.maximum(error, MIN_SHOWN_M), color=ESTIMATE, linewidth=1.4, label=f"error ({trace.drones[0]})")
    axes.semilogy(trace.time_s, trace.sigma_m, color=DRONES[0], linewidth=1.3, linestyle="--", label="stated RMS")
    shown = np.where(np.isfinite(trace.sigma_m), trace.bound_m, np.nan)
    axes.semilogy(trace.time_s, shown, color=TRUTH, linewidth=1.0, linestyle=":", label="bound (median)")
    if _apart(trace):
        label = f"error in {trace.drones[0]}'s own frame"
        axes.semilogy(trace.time_s, np.maximum(trace.own_error_m, MIN_SHOWN_M), color=DRONES[1], linewidth=1.1, label=label)
        own = np.where(np.isfinite(trace.sigma_m), trace.own_bound_m, np.nan)
        axes.semilogy(trace.time_s, own, color=DRONES[1], linewidth=1.0, linestyle=":", label="bound of that")
    finite = np.concatenate([line[np.isfinite(trace.sigma_m) & np.isfinite(line)] for line in lines])
    if finite.size:
        ends = max(MIN_SHOWN_M, 0.7 * float(np.quantile(finite, 0.005))), 1.6 * float(finite.max())
        axes.set_ylim(*ends)
        plain_log(axes.yaxis, *ends)
    dress(axes, "", "", "distance (m)")


def _apart(trace: Trace) -> bool:
    """Whether the vehicle's own frame is so wrong that the source is known clearly better in it than in the true frame."""
    both = np.isfinite(trace.own_bound_m) & np.isfinite(trace.bound_m) & np.isfinite(trace.own_error_m)
    return bool(both.any()) and bool(np.median(trace.own_bound_m[both] / trace.bound_m[both]) < _CLEARLY)


def _activity(axes: Axes, trace: Trace) -> None:
    known = np.isfinite(trace.activity_bq)
    time_s, mean = trace.time_s[known], trace.activity_bq[known]
    sigma = np.nan_to_num(trace.activity_sigma_bq[known])
    axes.fill_between(time_s, np.maximum(mean - sigma, 0.05 * mean), mean + sigma, color=ESTIMATE, alpha=0.2, linewidth=0)
    axes.plot(time_s, mean, color=ESTIMATE, linewidth=1.3, label="activity, 1 sigma")
    if trace.source_bq is not None:
        axes.axhline(trace.source_bq, color=TRUTH, linewidth=1.0, linestyle="-.", label=f"truth, {becquerels(trace.source_bq)}")
    tops = [float(np.quantile(mean + sigma, 0.98)), *([trace.source_bq] if trace.source_bq is not None else [])]
    axes.set_ylim(0.0, 1.3 * max(tops))
    dress(axes, "", "", "activity (Bq)")


def _evidence(axes: Axes, trace: Trace) -> None:
    axes.plot(trace.time_s, trace.evidence, color=DRONES[2], linewidth=1.3, label="log evidence")
    axes.set_yscale("symlog", linthresh=10.0)
    dress(axes, "", "", "source : none (ln)")


def _known(values: Array) -> bool:
    return bool(np.isfinite(values).any())
