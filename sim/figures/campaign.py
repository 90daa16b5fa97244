"""Plots of many flights: box plots, distributions, and dependence of the results on the varied parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from radron.sim.figures.style import DRONES, dress, drone_colour, metres, new_figure, seconds, wrapped
from radron.sim.result import RunResult
from radron.sim.scoring.statistics import ecdf, summarise
from radron.sim.sweep import Case, Value

Groups = Sequence[tuple[Case, Sequence[RunResult]]]


class _Quantity(NamedTuple):
    label: str
    of: Callable[[RunResult], float | None]


LEGEND_AT_MOST = 28  # cases; with more, lines and colours would repeat
TIME = _Quantity("time to x0 (s)", lambda run: run.time_to_x0_s)
ERROR = _Quantity("median error of a run (m)", lambda run: run.error_median_m)
TRACKING = _Quantity("tracking time (s)", lambda run: run.tracking_time_s)
_UNITS = {"m": "m", "mps": "m/s", "s": "s", "rad": "rad", "bq": "Bq", "deg": "deg", "m2": "m2", "m2ps": "m2/s", "kev": "keV"}


def boxes_figure(groups: Groups, title: str) -> Figure:
    """Make box plots of time to the first estimate (x0), error and tracking time, with a row for each case of a campaign.

    Boxes show quartiles, whiskers 5 and 95 %; every flight is a dot.
    """
    height = 1.6 + 0.45 * len(groups)
    figure = new_figure(11.0, height)
    panels = figure.subplots(1, 3, sharey=True)
    for panel, quantity in zip(panels, (TIME, ERROR, TRACKING), strict=True):
        for row, (_, runs) in enumerate(groups):
            _box(panel, _known(quantity, runs), row, drone_colour(row), upright=False)
        dress(panel, "", quantity.label, "")
        panel.set_xlim(left=0.0)
    panels[0].set_yticks(range(len(groups)), [_row_label(case, runs) for case, runs in groups], fontsize=8)
    panels[0].set_ylim(len(groups) - 0.5, -0.5)
    figure.suptitle(wrapped((title, *_findings(groups), *_missing(groups)), 120), x=0.01, ha="left", fontsize=11)
    return figure


def ecdf_figure(groups: Groups, title: str) -> Figure:
    """Make a figure of empirical distributions over all flights of a campaign.

    Shown are the share of flights that had a first estimate (x0) by a time, and the share with at most some median error; flights
    without one count as never.
    """
    figure = new_figure(10.0, 4.3)
    panels = figure.subplots(1, 2, sharey=True)
    for panel, quantity in zip(panels, (TIME, ERROR), strict=True):
        for index, (case, runs) in enumerate(groups):
            values, share = ecdf(quantity.of(run) for run in runs)
            panel.step(
                np.concatenate([[0.0], values]), np.concatenate([[0.0], share]), where="post", color=drone_colour(index),
                linestyle=("-", "--", "-.", ":")[index // len(DRONES) % 4], linewidth=1.5, label=case.label,
            )  # fmt: skip
        dress(panel, "", quantity.label, "share of the runs" if panel is panels[0] else "")
        panel.set_xlim(left=0.0)
        panel.set_ylim(0.0, 1.02)
        for line in panel.get_lines():  # continue the line to the edge of the plot
            x, y = (np.asarray(values) for values in line.get_data())
            line.set_data(np.append(x, panel.get_xlim()[1]), np.append(y, y[-1]))
    figure.suptitle(wrapped((title, *_findings(groups)), 110), x=0.01, ha="left", fontsize=11)
    if len(groups) <= LEGEND_AT_MOST:
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4), fontsize=8, frameon=False)
    return figure


def tuning_figure(groups: Groups, title: str) -> Figure:
    """Plot error and time to the first estimate against each varied parameter of a campaign, as in the paper's tuning.

    Results are pooled over the other parameters; each scenario has one colour.
    """
    parameters = [name for name, _ in groups[0][0].point]
    scenarios = list(dict.fromkeys(case.name for case, _ in groups))
    figure = new_figure(max(5.5, 4.2 * len(parameters)), 6.5)
    panels = figure.subplots(2, len(parameters), sharex="col", sharey="row", squeeze=False)
    for column, parameter in enumerate(parameters):
        values = list(dict.fromkeys(dict(case.point)[parameter] for case, _ in groups))
        for row, quantity in enumerate((ERROR, TIME)):
            panel = panels[row, column]
            for index, name in enumerate(scenarios):
                pools = [_pool(groups, name, parameter, value) for value in values]
                _curve(panel, pools, quantity, (index, len(scenarios)), name)
            panel.set_xticks(range(len(values)), [_tick(value) for value in values])
            dress(panel, "", _axis(parameter) if row == 1 else "", quantity.label if column == 0 else "")
            panel.set_ylim(bottom=0.0)
            panel.set_xlim(-0.5, len(values) - 0.5)
    pooled = ["each column pools over the others"] if len(parameters) > 1 else []
    text = wrapped((title, *pooled, *_best(groups), *_missing(groups)), 20 + 40 * len(parameters))
    figure.suptitle(text, x=0.01, ha="left", fontsize=11)
    if len(scenarios) > 1:
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4), fontsize=8, frameon=False)
    return figure


def _curve(axes: Axes, pools: Sequence[Sequence[RunResult]], quantity: _Quantity, place: tuple[int, int], name: str) -> None:
    """Boxes at each value of a parameter, with their medians connected. place: index and number of the scenarios."""
    index, count = place
    shift = (index - (count - 1) / 2.0) * 0.7 / count
    colour = drone_colour(index)
    known = [_known(quantity, runs) for runs in pools]
    for at, values in enumerate(known):
        _box(axes, values, at + shift, colour, width=0.45 / count)
    middle = [float(np.median(values)) if values else np.nan for values in known]
    axes.plot(np.arange(len(pools)) + shift, middle, color=colour, linewidth=1.4, marker="o", markersize=4, label=name)


def _box(axes: Axes, values: Sequence[float], place: float, colour: str, *, width: float = 0.5, upright: bool = True) -> None:
    """A box with every value as a dot; ``place`` on the x axis if upright, else on the y axis."""
    if not values:
        x, y = (place, 0.0) if upright else (0.0, place)
        axes.text(x, y, " none", va="bottom" if upright else "center", fontsize=8, color=colour)
        return
    axes.boxplot(
        [list(values)], positions=[place], widths=width, orientation="vertical" if upright else "horizontal", whis=(5, 95),
        showfliers=False, patch_artist=True, manage_ticks=False,
        boxprops={"facecolor": f"{colour}33", "edgecolor": colour}, medianprops={"color": colour, "linewidth": 2.2},
        whiskerprops={"color": colour}, capprops={"color": colour},
    )  # fmt: skip
    spread = place + width * 0.35 * np.sin(np.arange(len(values)) * 2.399)  # golden angle: even spread without randomness
    x_values, y_values = (spread, values) if upright else (values, spread)
    axes.plot(x_values, y_values, ".", color=colour, markersize=7.0 if len(values) <= 20 else 4.0, alpha=0.6, markeredgewidth=0)


def _known(quantity: _Quantity, runs: Sequence[RunResult]) -> list[float]:
    return [value for value in map(quantity.of, runs) if value is not None]


def _pool(groups: Groups, name: str, parameter: str, value: Value) -> list[RunResult]:
    here = [runs for case, runs in groups if case.name == name and dict(case.point)[parameter] == value]
    return [run for runs in here for run in runs]


def _row_label(case: Case, runs: Sequence[RunResult]) -> str:
    found = sum(run.time_to_x0_s is not None for run in runs)
    return f"{case.label}\n{found} of {len(runs)} found it"


def _findings(groups: Groups) -> list[str]:
    """The result in words: in full for a single case; of several, the fastest and the most accurate one."""
    summaries = [(case.label, summarise(runs)) for case, runs in groups]
    if len(groups) == 1:
        _, only = summaries[0]
        error_text = f"error {metres(only.error_median_m)}"
        return [f"initial estimate after {seconds(only.time_to_x0_median_s)}, {error_text} (medians of {only.runs} runs)"]
    times = [(time, label) for label, summary in summaries if (time := summary.time_to_x0_median_s) is not None]
    errors = [(error, label) for label, summary in summaries if (error := summary.error_median_m) is not None]
    soonest = [f"earliest initial estimate: {label}, {seconds(time)}" for time, label in _alone_least(times)]
    nearest = [f"least error: {label}, {metres(error)}" for error, label in _alone_least(errors)]
    return [*soonest, *nearest]


def _alone_least(values: Sequence[tuple[float, str]]) -> list[tuple[float, str]]:
    """The least value and its label; empty where several share it."""
    least = [pair for pair in values if pair[0] == min(value for value, _ in values)]
    return least if len(least) == 1 else []


def _missing(groups: Groups) -> list[str]:
    """The number of runs that no box shows."""
    runs = [run for _, several in groups for run in several]
    never = sum(run.time_to_x0_s is None for run in runs)
    return [f"{never} of {len(runs)} runs never found the source: not in the boxes, slowest in the medians"] if never else []


def _best(groups: Groups) -> list[str]:
    """The point of least median error, for each scenario."""
    best = []
    for name, several in groupby(groups, key=lambda group: group[0].name):
        errors = [(error, case) for case, runs in several if (error := summarise(runs).error_median_m) is not None]
        if errors:
            error, case = min(errors, key=lambda pair: pair[0])
            point = ", ".join(f"{key} = {_tick(value)}" for key, value in case.point)
            best.append(f"{name}: least error, {metres(error)}, at {point}")
    return best


def _axis(parameter: str) -> str:
    """``radius_m`` -> ``radius (m)``."""
    last = parameter.rsplit(".", 1)[-1]
    name, _, unit = last.rpartition("_")
    return f"{name.replace('_', ' ')} ({_UNITS[unit]})" if unit in _UNITS else last.replace("_", " ")


def _tick(value: Value) -> str:
    return value if isinstance(value, str) else f"{value:g}"
