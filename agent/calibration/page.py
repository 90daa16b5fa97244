"""The result of a calibration on the terminal, and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.markup import escape
from rich.table import Table

from radron.agent.calibration.collection import BLOCKS, Collection
from radron.agent.calibration.result import Result, goals
from radron.agent.detector.readout import SENSOR_PIXELS
from radron.agent.detector.spectroscopy.shapes import strongest_line_kev

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BIN_KEV = 4.0


def verdict(result: Result) -> str:
    """Return ``usable``, or the requirements that a calibration has not reached, in words."""
    missed = [goal.name for goal in goals(result) if not goal.reached]
    return f"not usable: {', '.join(missed)}" if missed else "usable"


def table(result: Result) -> Table:
    """Return the requirements of a calibration with the values reached, as a table for the terminal."""
    shown = Table(title=f"calibration {result.stamp}: {verdict(result)}", show_header=False)
    for goal in goals(result):
        state = "[green]ok[/]" if goal.reached else "[red]missed[/]"
        shown.add_row(goal.name, state, escape(goal.text))
    return shown


def draw(result: Result, collection: Collection, path: Path) -> bool:
    """Draw a calibration into a file; return whether matplotlib is installed, on which the agent does not depend."""
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ModuleNotFoundError:
        return False
    figure = Figure(figsize=(12.0, 9.0), layout="constrained")
    (hits, spectrum), (blocks, times) = figure.subplots(2, 2)
    figure.suptitle(f"{result.nuclide}, {result.stamp}: {verdict(result)}")
    pixels = collection.pixels.reshape(SENSOR_PIXELS, SENSOR_PIXELS)
    image = hits.imshow(pixels, origin="lower", vmin=0.0, vmax=max(1.0, float(np.quantile(pixels, 0.999))))
    figure.colorbar(image, ax=hits, label="hits")
    hits.set(title="Hits of each pixel", xlabel="column", ylabel="row")
    _draw_spectrum(spectrum, result, collection)
    values = np.array([np.nan if block is None else block.value for block in result.blocks]).reshape(BLOCKS, BLOCKS)
    image = blocks.imshow(values, origin="lower", cmap="coolwarm")
    figure.colorbar(image, ax=blocks, label="read / true energy")
    blocks.set(title="Gain by block", xticks=[], yticks=[])
    times.hist(np.abs(collection.apart_ns), np.arange(0.0, 205.0, 5.0).tolist(), histtype="step")
    if result.drift is not None:
        times.axvline(result.drift.drift_ns, color="black", linewidth=0.8, label="drift across the sensor")
        times.legend()
    times.set(title="Coincidences: time between their clusters", xlabel="ns", ylabel="coincidences")
    figure.savefig(path, format="png", dpi=110)
    return True


def _draw_spectrum(axes: Axes, result: Result, collection: Collection) -> None:
    line = strongest_line_kev(result.nuclide)
    edges = np.arange(0.0, 1.5 * line, _BIN_KEV).tolist()
    axes.hist(collection.energies_kev, edges, histtype="step", label="measured, by the coarse gain")
    axes.axvline(line, color="black", linewidth=0.8, label=f"{line:g} keV")
    axes.set(title="Single clusters", xlabel="keV", ylabel=f"events per {_BIN_KEV:g} keV", yscale="log")
    axes.legend()
