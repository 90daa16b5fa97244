"""Figure of the speed and spacing of the encircling swarm (the paper's figure of the swarm stabilisation)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from radron.sim.figures.style import dress, drone_colour, new_figure, seconds, stage_bands, wrapped
from radron.sim.result import Trace
from radron.sim.scoring.statistics import hypothesis_steps, settling_times

STEP_M = 5.0  # a jump of the hypothesis after which the swarm has to rearrange
REST_S = 20.0  # least time between jumps that count as steps; faster ones are a filter at work
WITHIN_DEG = 5.0


def spacing_figure(trace: Trace, name: str) -> Figure:
    """Plot the speed of each drone and how evenly the drones are spaced on their circle, over time.

    Upper panel: speeds. Lower panel: deviation of each gap between tracking drones from equal gaps. Vertical lines mark jumps of
    the source estimate; jumps in quick succession are updates of a filter, and get no lines.
    """
    steps = hypothesis_steps(trace.time_s, trace.estimate_m, STEP_M)
    if len(steps) < 2 or np.diff(steps).min() < REST_S:
        steps = steps[:0]
    several = len(trace.drones) > 1
    figure = new_figure(9.0, 5.5 if several else 3.5)
    panels = figure.subplots(2 if several else 1, 1, sharex=True, squeeze=False)[:, 0]
    _draw_speed(panels[0], trace)
    if several:
        _draw_spacing(panels[1], trace)
    for panel in panels:
        stage_bands(panel, trace.time_s, trace.swarm_stage, named=panel is panels[0])
        for step in steps:
            panel.axvline(step, color="#333333", linewidth=0.9, linestyle=(0, (4, 3)))
        panel.set_xlim(float(trace.time_s[0]), float(trace.time_s[-1]))
    dress(panels[0], wrapped((name, *_findings(trace, steps))), "", "ground speed (m/s)")
    if several:
        dress(panels[1], "", "", "spacing error (deg)")
    panels[-1].set_xlabel("time since the start command (s)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 8), fontsize=8, frameon=False)
    return figure


def _draw_speed(axes: Axes, trace: Trace) -> None:
    speed = np.linalg.norm(trace.velocity_mps[:, :, :2], axis=2)
    for drone, name in enumerate(trace.drones):
        axes.plot(trace.time_s, speed[:, drone], color=drone_colour(drone), linewidth=1.0, label=name)
    axes.set_ylim(bottom=0.0)


def _draw_spacing(axes: Axes, trace: Trace) -> None:
    error = np.abs(trace.spacing_error_deg)
    for drone in range(len(trace.drones)):
        axes.plot(trace.time_s, error[:, drone], color=drone_colour(drone), linewidth=1.0)
    axes.axhspan(0.0, WITHIN_DEG, color="#009E73", alpha=0.12, linewidth=0)
    axes.axhline(WITHIN_DEG, color="#009E73", linewidth=0.8)
    axes.set_ylim(bottom=0.0)


def _findings(trace: Trace, steps: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[str]:
    """The figure's result in words."""
    error = trace.spacing_error_deg
    if error.shape[1] < 2 or not np.isfinite(error).any():
        return ["speed of each drone"]
    if len(steps) == 0:
        widest = np.nanmax(np.abs(error[np.isfinite(error).any(axis=1)]), axis=1)
        return [f"the gap farthest from uniform is {float(np.median(widest)):.1f} deg from it in the median"]
    settled = settling_times(trace.time_s, error, steps, WITHIN_DEG)
    settled = settled[~np.isnan(settled)]
    median, worst = float(np.median(settled)), float(np.max(settled))
    if not np.isfinite(median):
        return [f"after most steps of the hypothesis, the gaps do not stay within {WITHIN_DEG:g} deg of uniform"]
    settles = f"{seconds(median)} after a step of the hypothesis (median; worst {seconds(worst)})"
    return [f"the gaps stay within {WITHIN_DEG:g} deg of uniform from {settles}"]
