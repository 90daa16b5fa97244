"""Figure of all sources of a flight over time: their number, nuclides, distances from the truth, and regions."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from radron.protocol.messages import Source as Found
from radron.sim.figures.style import DRONES, MIN_SHOWN_M, TRUTH, becquerels, dress, new_figure, plain_log, stage_bands, wrapped
from radron.sim.result import EstimateTrace, SourceTrace, Trace

_SHOWN_M = 10.0  # an estimate is drawn at the true source that is nearest to it, if that is no farther
_ROOT_90 = math.sqrt(-2.0 * math.log(0.1))  # from the RMS of one axis to the radius of the 90 % region


def sources_figure(trace: Trace, title: tuple[str, ...]) -> Figure:
    """Draw the estimates of several sources over time.

    Above: the number of estimated sources, as an area for each nuclide, and the true number. Below, for each true source at its
    final position: distance of the nearest estimated source, and the radius of its 90 % region (of a circle of equal area), in
    the colour of the estimated nuclide.
    """
    told = [str(source.nuclide) for estimate in trace.estimates for source in estimate.sources]
    nuclides = list(dict.fromkeys([*(truth.nuclide for truth in trace.truths), *told]))
    colours = {name: DRONES[place % len(DRONES)] for place, name in enumerate(nuclides)}
    rows = len(trace.truths)
    figure = new_figure(10.0, 3.2 + 1.5 * rows)
    panels = figure.subplots(1 + rows, 1, sharex=True, squeeze=False, height_ratios=[2.2, *[1.5] * rows])[:, 0]
    _numbers(panels[0], trace, colours)
    for axes, truth in zip(panels[1:], trace.truths, strict=True):
        _course(axes, trace, truth, colours)
    if rows:
        _explain(panels[1])
    for place, axes in enumerate(panels):
        stage_bands(axes, trace.time_s, trace.swarm_stage, named=place == 0)
        axes.set_xlim(float(trace.time_s[0]), float(trace.time_s[-1]))
    panels[-1].set_xlabel("time since the start command (s)")
    figure.suptitle(wrapped(title, 110), x=0.01, ha="left", fontsize=11)
    return figure


def _numbers(axes: Axes, trace: Trace, colours: dict[str, str]) -> None:
    time_s = [0.0, *(estimate.time_s for estimate in trace.estimates), float(trace.time_s[-1])]
    names = [[source.nuclide for source in estimate.sources] for estimate in trace.estimates]
    last = names[-1] if names else []
    counts = np.array([[each.count(name) for each in ([], *names, last)] for name in colours])
    axes.stackplot(time_s, counts, colors=list(colours.values()), alpha=0.6, step="post", linewidth=0)
    axes.axhline(len(trace.truths), color=TRUTH, linewidth=1.2, linestyle="-.")
    axes.set_ylim(0.0, 1.25 * max(1.0, float(counts.sum(axis=0).max()), len(trace.truths)))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    entries = [Line2D([], [], color=colour, linewidth=6.0, alpha=0.6, label=name) for name, colour in colours.items()]
    entries.append(Line2D([], [], color=TRUTH, linestyle="-.", label="truth"))
    axes.legend(handles=entries, loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
    dress(axes, "", "", "sources")


def _course(axes: Axes, trace: Trace, truth: SourceTrace, colours: dict[str, str]) -> None:
    """Distance and region of the nearest estimate to one true source."""
    near = [(estimate.time_s, _nearest(estimate, truth)) for estimate in trace.estimates]
    shown = [(time_s, source) for time_s, source in near if source is not None]
    x, y, z = truth.place_m
    text = f"{truth.nuclide}, {becquerels(truth.activity_bq)}, ({x:.0f}, {y:.0f}) m{f', {z:.0f} m high' if z >= 0.5 else ''}"
    for name, colour in colours.items():
        mine = [(time_s, source) for time_s, source in shown if source.nuclide == name]
        times = [time_s for time_s, _ in mine]
        apart = [max(math.dist(source.position_m[:2], truth.place_m[:2]), MIN_SHOWN_M) for _, source in mine]
        axes.plot(times, apart, color=colour, marker=".", markersize=2.5, linestyle="", alpha=0.5)
        axes.plot(times, [max(_radius_m(source), MIN_SHOWN_M) for _, source in mine], color=colour, linewidth=1.5)
    axes.set_yscale("log")
    axes.set_ylim(MIN_SHOWN_M, _SHOWN_M)
    plain_log(axes.yaxis, MIN_SHOWN_M, _SHOWN_M)
    dress(axes, "", "", "m")
    axes.set_title(text if shown else f"{text}: not found", fontsize=9, loc="left")


def _explain(axes: Axes) -> None:
    """The legend of all lower panels, beside the first one."""
    dots = Line2D([], [], color="#555555", marker=".", linestyle="", label="error")
    entries = [dots, Line2D([], [], color="#555555", linewidth=1.5, label="90 % region")]
    axes.legend(handles=entries, loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)


def _nearest(estimate: EstimateTrace, truth: SourceTrace) -> Found | None:
    nearest = min(estimate.sources, key=lambda source: math.dist(source.position_m[:2], truth.place_m[:2]))
    return nearest if math.dist(nearest.position_m[:2], truth.place_m[:2]) <= _SHOWN_M else None


def _radius_m(source: Found) -> float:
    """Radius of a circle as large as the 90 % region."""
    xx, xy, _, yy, _, _ = source.covariance_m2
    return _ROOT_90 * math.sqrt(math.sqrt(max(xx * yy - xy * xy, 0.0)))
