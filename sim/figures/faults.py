"""Plot of many random missions with faults, by kind of fault."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from radron.sim.figures.style import DRONES, ESTIMATE, dress, new_figure


def kinds_figure(rows: Sequence[tuple[str, int, int, int]], title: str) -> Figure:
    """Draw bars by kind of fault: number of missions, of missions with a violation, and of missions without the source located.

    rows: kind, its missions, missions with a violation, missions whose able drones did not locate the source.
    """
    figure = new_figure(8.0, 1.6 + 0.24 * len(rows))
    axes = figure.subplots()
    places = range(len(rows))
    axes.barh(places, [row[1] for row in rows], color="#D0DEEA", label="missions")
    axes.barh(
        [place - 0.2 for place in places], [row[2] for row in rows], height=0.4, color=ESTIMATE, label="an invariant violated"
    )
    axes.barh(
        [place + 0.2 for place in places], [row[3] for row in rows], height=0.4, color=DRONES[0], label="source not located"
    )
    axes.set_yticks(places, [row[0] for row in rows], fontsize=8)
    axes.invert_yaxis()
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    dress(axes, "", "missions in which the fault came", "")
    axes.legend(fontsize=8, loc="lower right")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    return figure
