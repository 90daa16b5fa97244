"""Style of all figures: colours for colour-blind readers (Okabe and Ito), and titles that state the result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from radron.agent.outputs import replacing

DRONES = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#8C6D31", "#5D3A9B")
ESTIMATE = "#D55E00"
TRUTH = "#000000"
CONE = "#7A7A7A"
GRID = "#D9D9D9"
MIN_SHOWN_M = 0.01  # lower end of logarithmic axes of errors
STAGES = {  # background colours only; the label in the band names the stage
    "takeoff": "#F0F0F0",
    "survey": "#E3EEF7",
    "track": "#FFFFFF",
    "reacquire": "#FCE8DC",
    "hold": "#F3E9F1",
    "return": "#F0F0F0",
    "landing": "#E6E6E6",
    "landed": "#E6E6E6",
    "abort": "#F8D7D0",
}


def drone_colour(index: int) -> str:
    """Return the colour of the drone with this index; colours repeat after seven drones."""
    return DRONES[index % len(DRONES)]


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure that needs no display and no global state of Matplotlib."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def dress(axes: Axes, title: str = "", x_label: str = "", y_label: str = "") -> None:
    """Give axes their title, labels and a light grid, without a box."""
    if title:
        axes.set_title(title, loc="left", fontsize=11)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def plain_log(axis: Axis, low: float, high: float) -> None:
    """Label a logarithmic axis from ``low`` to ``high`` with plain numbers, as many as fit."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 300.0 * low else (1.0,)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_formatter(NullFormatter())


def stage_bands(axes: Axes, time_s: NDArray[np.float64], stage: NDArray[np.str_], named: bool = True) -> None:
    """Shade the mission stages behind a time axis, with their names at its top. stage: (T,) strings."""
    changes = np.flatnonzero(stage[1:] != stage[:-1]) + 1
    starts = [0, *changes.tolist()]
    ends = [*changes.tolist(), len(stage) - 1]
    span = max(float(time_s[-1] - time_s[0]), 1e-9)
    for start, end in zip(starts, ends, strict=True):
        name, left, right = str(stage[start]), float(time_s[start]), float(time_s[end])
        axes.axvspan(left, right, color=STAGES.get(name, "#F0F0F0"), zorder=0, linewidth=0)
        share = (right - left) / span
        if named and share > 0.004:  # vertical where the name does not fit along the axis
            middle, frame, along = (left + right) / 2.0, axes.get_xaxis_transform(), share > 0.012 * len(name)
            text = axes.text(middle, 0.98, name, transform=frame, ha="center", va="top", fontsize=8, color="#555555")
            text.set_rotation(0.0 if along else 90.0)


def mark_event(axes: Axes, time_s: float, text: str) -> None:
    """Mark an event on a time axis with a line and a text."""
    axes.axvline(time_s, color="#555555", linewidth=0.8, linestyle=(0, (4, 2)))
    axes.annotate(
        text,
        (time_s, 0.9),
        (5, 0),
        xycoords=axes.get_xaxis_transform(),
        textcoords="offset points",
        va="top",
        fontsize=8,
        color="#333333",
    )


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG file, completely or not at all."""
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=150)


def seconds(value: float | None) -> str:
    """Return a duration as text for a title."""
    return "never" if value is None or not np.isfinite(value) else f"{value:.0f} s" if value >= 100.0 else f"{value:.1f} s"


def metres(value: float | None) -> str:
    """Return a distance as text for a title."""
    return "unknown" if value is None or not np.isfinite(value) else f"{value:.2f} m" if value < 10.0 else f"{value:.0f} m"


def becquerels(value: float) -> str:
    """Return an activity as text with a unit prefix, such as "3 GBq"."""
    for unit, name in ((1e9, "GBq"), (1e6, "MBq"), (1e3, "kBq")):
        if value >= 0.9995 * unit:
            return f"{value / unit:.3g} {name}"
    return f"{value:.3g} Bq"


def wrapped(parts: Sequence[str], width: int = 90) -> str:
    """Join the parts of a title by semicolons, on as many lines as they need."""
    lines = [""]
    for part in parts:
        joined = f"{lines[-1]}; {part}" if lines[-1] else part
        if len(joined) > width and lines[-1]:
            lines[-1] += ";"
            lines.append(part)
        else:
            lines[-1] = joined
    return "\n".join(lines)
