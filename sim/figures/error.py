"""Error of the source estimate over time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from sim.figures.style import DRONES, ESTIMATE, TRUTH, dress, mark_event, metres, new_figure, stage_bands, wrapped
from sim.result import Trace


def error_figure(trace: Trace, title: tuple[str, ...]) -> Figure:
    """Horizontal error of the hypothesis over time, with its 1-sigma radius and the bound; stages as background, cones as
    ticks.
    """
    figure = new_figure(9.0, 4.5)
    axes = figure.add_subplot()
    time_s = trace.time_s
    stage_bands(axes, time_s, trace.swarm_stage)
    offset = trace.hypothesis_m[:, :, :2] - trace.source_m[:, None, :2]
    errors = np.linalg.norm(offset, axis=2)  # (T, N)
    for drone in range(1, errors.shape[1]):  # they differ only while messages are on their way
        axes.plot(time_s, errors[:, drone], color=ESTIMATE, linewidth=0.7, alpha=0.35)
    axes.plot(time_s, errors[:, 0], color=ESTIMATE, linewidth=1.6, label=f"error ({trace.drones[0]}; thin: the others)")
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
    known = np.flatnonzero(np.isfinite(errors[:, 0]))
    if known.size:
        first = int(known[0])
        mark_event(axes, float(time_s[first]), f"initial estimate, {metres(float(errors[first, 0]))} off")
    finite = errors[np.isfinite(errors)]
    axes.set_ylim(0.0, max(2.0, 1.1 * float(finite.max())) if finite.size else 10.0)
    axes.set_xlim(float(time_s[0]), float(time_s[-1]))
    dress(axes, wrapped(title), "time since the start command (s)", "horizontal distance (m)")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure
