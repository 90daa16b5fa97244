"""Faults in the figures of a flight: bars below a time axis, and numbered places on the map."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from radron.sim.figures.style import drone_colour
from radron.sim.result import FaultTrace, Trace

ROW_IN = 0.19  # height of a row of bars, inches
MAX_MARK_ROWS = 12
_LETTER = 0.0085  # width of a letter, as a share of the time axis
_SEVERAL = "#555555"  # of more than one drone


def rows_of(faults: Sequence[FaultTrace], begin_s: float, end_s: float) -> list[list[tuple[int, FaultTrace]]]:
    """Distribute the faults of a flight to rows, as few as possible, in which neither their bars nor their labels overlap.

    Each fault gets a number.
    """
    span_s = end_s - begin_s
    rows: list[list[tuple[int, FaultTrace]]] = []
    ends: list[float] = []
    for number, fault in enumerate(faults, 1):
        text_s = _LETTER * span_s * (len(fault.label) + 4)
        row = next((row for row, end in enumerate(ends) if end <= min(fault.begin_s, end_s - text_s)), len(rows))
        if row == len(rows):
            rows.append([])
            ends.append(begin_s)
        rows[row].append((number, fault))
        ends[row] = max(fault.end_s, fault.begin_s + text_s)
    return rows[:MAX_MARK_ROWS]


def shade_faults(axes: Axes, trace: Trace) -> None:
    """Draw a line on a time axis where each fault begins."""
    for fault in trace.faults:
        axes.axvline(fault.begin_s, color=_colour(fault), linewidth=0.9, linestyle=(0, (1, 2)), zorder=1)


def fault_bars(axes: Axes, trace: Trace) -> None:
    """Draw a bar with number and name for each fault, on a separate panel that shares the time axis."""
    begin_s, end_s = float(trace.time_s[0]), float(trace.time_s[-1])
    rows = rows_of(trace.faults, begin_s, end_s)
    for row, faults in enumerate(rows):
        for number, fault in faults:
            left, right = max(fault.begin_s, begin_s), min(fault.end_s, end_s)
            axes.barh(row, right - left, left=left, height=0.84, color=_colour(fault), alpha=0.3, linewidth=0)
            axes.plot([left, left], [row - 0.42, row + 0.42], color=_colour(fault), linewidth=1.6)
            text, late = f"{number}  {fault.label}", left + _LETTER * (end_s - begin_s) * (len(fault.label) + 4) > end_s
            shift, side = (-4, "right") if late else (4, "left")
            axes.annotate(
                text, (right if late else left, row), (shift, 0), textcoords="offset points", va="center", ha=side, fontsize=8,
                color="#222222", annotation_clip=False,
            )  # fmt: skip
    axes.set_ylim(max(len(rows), 1) - 0.5, -0.5)
    axes.set_yticks([])
    axes.set_ylabel("faults", fontsize=8)
    axes.spines[["top", "right", "left"]].set_visible(False)


def fault_places(axes: Axes, trace: Trace) -> None:
    """Draw the numbers of the faults on the map, where the affected drones were when the faults began."""
    struck: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    for number, fault in enumerate(trace.faults, 1):
        sample = min(int(np.searchsorted(trace.time_s, fault.begin_s)), len(trace.time_s) - 1)
        for drone in fault.drones:
            struck[sample, drone].append(number)
    for (sample, drone), numbers in struck.items():
        x, y = trace.position_m[sample, drone, :2].tolist()
        axes.annotate(
            ",".join(map(str, numbers)), (x, y), ha="center", va="center", fontsize=7, color="#222222", zorder=8,
            bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": drone_colour(drone), "linewidth": 1.2},
        )  # fmt: skip


def fault_entries(trace: Trace) -> list[Line2D]:
    """Return entries for the map's legend that name the numbered faults."""
    return [
        Line2D(
            [],
            [],
            linestyle="",
            marker=f"${number}$",
            markersize=7,
            color="#222222",
            label=f"{fault.label}, {fault.begin_s:.0f} s",
        )
        for number, fault in enumerate(trace.faults, 1)
    ]


def _colour(fault: FaultTrace) -> str:
    return drone_colour(fault.drones[0]) if len(fault.drones) == 1 else _SEVERAL
