"""Error of the source estimate over time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from radron.sim.figures.faultmarks import ROW_IN, fault_bars, rows_of, shade_faults
from radron.sim.figures.style import DRONES, ESTIMATE, TRUTH, dress, mark_event, metres, new_figure, stage_bands, wrapped
from radron.sim.result import Trace


def error_figure(trace: Trace, title: tuple[str, ...]) -> Figure:
    """Plot the horizontal error of the source estimate over time, with its 1-sigma radius and the theoretical bound.

    Mission stages are shown as background, Compton cones as ticks.
    """
    time_s = trace.time_s
    rows = len(rows_of(trace.faults, float(time_s[0]), float(time_s[-1])))
    figure = new_figure(9.0, 4.5 + ROW_IN * rows)
    axes, *strip = figure.subplots(
        2 if rows else 1, 1, sharex=True, squeeze=False, height_ratios=[3.4, ROW_IN * rows][: 1 + bool(rows)]
    )[:, 0]
    stage_bands(axes, time_s, trace.swarm_stage)
    offset = trace.hypothesis_m[:, :, :2] - trace.source_m[:, None, :2]
    errors = np.linalg.norm(offset, axis=2)  # (T, N)
    for drone in range(errors.shape[1]):  # they differ only while messages are on their way
        axes.plot(time_s, errors[:, drone], color=ESTIMATE, linewidth=0.7, alpha=0.35)
    first = np.linalg.norm((trace.estimate_m - trace.source_m)[:, :2], axis=1)
    axes.plot(time_s, first, color=ESTIMATE, linewidth=1.6, label=f"error ({_first(trace)}; thin: the others)")
    axes.plot(time_s, trace.sigma_m, color=DRONES[0], linewidth=1.3, linestyle="--", label="stated 1 sigma (RMS radius)")
    bound = np.where(np.isfinite(trace.sigma_m), trace.bound_m, np.nan)
    if np.isfinite(bound).any():
        axes.plot(time_s, bound, color=TRUTH, linewidth=1.0, linestyle=":", label="bound of the median error")
    if trace.cones:
        times = np.array([cone.time_s for cone in trace.cones])
        axes.plot(
            times, np.full(times.shape, 0.012), "|", color="#333333", markersize=7, markeredgewidth=0.6, alpha=0.6,
            transform=axes.get_xaxis_transform(), label="a cone",
        )  # fmt: skip
    known = np.flatnonzero(np.isfinite(first))
    if known.size:
        begin = int(known[0])
        mark_event(axes, float(time_s[begin]), f"initial estimate, {metres(float(first[begin]))} off")
    finite = errors[np.isfinite(errors)]
    axes.set_ylim(0.0, max(2.0, 1.1 * float(finite.max())) if finite.size else 10.0)
    axes.set_xlim(float(time_s[0]), float(time_s[-1]))
    dress(axes, wrapped(title), "", "horizontal distance (m)")
    for panel in strip:
        shade_faults(axes, trace)
        fault_bars(panel, trace)
    (strip or [axes])[-1].set_xlabel("time since the start command (s)")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def _first(trace: Trace) -> str:
    """The drone that is drawn thick."""
    return trace.drones[trace.judged[0]] if np.ptp(trace.judged) == 0 else "the first one alive"
