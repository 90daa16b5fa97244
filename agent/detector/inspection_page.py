"""``radron-agent inspect``: the summary on the terminal, and the page as PNG and JSON."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from radron.agent.detector.files.calibration import Calibration, load_calibration
from radron.agent.detector.files.frames import is_frame
from radron.agent.detector.files.t3pa import T3paReader
from radron.agent.detector.inspection import SPECTRUM_BIN_KEV, Inspection, inspect_frame, inspect_hits
from radron.agent.detector.readout import SENSOR_PIXELS
from radron.agent.outputs import check_output, replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def run_inspect(reader: T3paReader, calibration: Path | None, png: Path | None, json: Path | None) -> None:
    """Summarise a camera file on stdout, with a progress bar on stderr, and write picture (PNG) and numbers (JSON) if asked for.

    Raises RadronError.
    """
    outputs = [path for path in (png, json) if path is not None]
    for path in outputs:
        check_output(path, (reader.path,))
    figure = None if png is None else _new_figure()
    constants = Calibration.nominal() if calibration is None else load_calibration(calibration)
    found = _inspected(reader, constants)
    Console().print(summary_table(found))
    for note in found.notes:
        Console(stderr=True).print(f"{reader.path}: {note}", highlight=False)
    if json is not None:
        with replacing(json, (reader.path,)) as temporary:
            temporary.write_bytes(msgspec.json.format(msgspec.json.encode(found), indent=1))
    if png is not None and figure is not None:
        draw(figure, found)
        with replacing(png, (reader.path,)) as temporary:
            figure.savefig(temporary, format="png", dpi=120)
    if outputs:
        Console().print(f"written: {', '.join(map(str, outputs))}", highlight=False)


def _inspected(reader: T3paReader, calibration: Calibration) -> Inspection:
    if is_frame(reader.path):
        return inspect_frame(reader.path, calibration)
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    terminal = Console(stderr=True)
    with Progress(*columns, console=terminal, transient=True, disable=not terminal.is_terminal) as progress:
        task = progress.add_task(reader.path.name, total=reader.size_bytes)
        return inspect_hits(reader, calibration, lambda position: progress.update(task, completed=position))


def summary_table(found: Inspection) -> Table:
    """Return the summary of a camera file as a table for the terminal."""
    table = Table(title=found.file, show_header=False)
    live_s = found.live_time_s or 0.0

    def rate(count: int) -> str:
        return f"{count:,}  ({count / live_s:.3g} /s)" if live_s > 0.0 else f"{count:,}"

    rows: list[tuple[str, str | None]] = [
        ("format", found.format),
        ("measurements", str(found.measurements)),
        ("duration, live", None if found.duration_s is None else f"{found.duration_s:.6g} s, {live_s:.6g} s"),
        ("pixel hits", rate(found.hits)),
        ("clusters", rate(found.clusters)),
        ("lost rows and hits", f"{found.lost_rows:,}" if found.lost_rows else None),
        ("moved by 409.6 us", f"{found.repaired_hits:,}" if found.repaired_hits else None),
        ("saturated hits", f"{found.saturated_hits:,}"),
        ("pixels with hits", f"{found.pixels_hit:,} of {SENSOR_PIXELS**2:,}"),
        ("dead pixels", "too few hits to tell" if found.dead_pixels is None else f"{found.dead_pixels:,}"),
        ("noisy pixels", _noisy(found)),
        ("masked pixels", f"{found.masked_pixels:,}" if found.masked_pixels else None),
        (
            "delay in clusters",
            None if found.delay_ns is None else "median {:.0f} ns, 95 % below {:.0f} ns".format(*found.delay_ns),
        ),
        ("recognised", _recognised(found)),
    ]
    for name, text in rows:
        if text is not None:
            table.add_row(name, text)
    return table


def _noisy(found: Inspection) -> str:
    if not found.noisy_pixels:
        return "none"
    worst = found.noisy_pixels[0]
    return f"{len(found.noisy_pixels)}, the worst in column {worst.column}, row {worst.row}: {worst.hits:,} hits"


def _recognised(found: Inspection) -> str:
    if found.nuclide is not None:
        return found.nuclide
    return f"unknown, lines at {', '.join(map(str, found.lines_kev))} keV" if found.lines_kev else "no nuclide stands out"


def _new_figure() -> Figure:
    """Return an empty matplotlib figure; matplotlib is not a dependency of the agent."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    return Figure(figsize=(12.0, 8.0), layout="constrained")


def draw(figure: Figure, found: Inspection) -> None:
    """Draw the summary of a camera file: hits of each pixel, spectrum, sizes of the clusters, and the rate over time."""
    (occupancy, spectrum), (sizes, rate) = figure.subplots(2, 2)
    figure.suptitle(f"{found.file}: {found.format}, {found.hits:,} hits")
    pixels = np.array(found.pixels, np.float64).reshape(SENSOR_PIXELS, SENSOR_PIXELS)
    top = max(1.0, float(np.quantile(pixels, 0.999)))
    picture = occupancy.imshow(pixels, origin="lower", cmap="viridis", vmin=0.0, vmax=top)
    figure.colorbar(picture, ax=occupancy, label="hits")
    occupancy.set(title="Hits of each pixel", xlabel="column", ylabel="row")
    kev = (np.arange(len(found.spectrum)) + 0.5) * SPECTRUM_BIN_KEV
    spectrum.step(kev, found.spectrum, where="mid", linewidth=0.8)
    spectrum.set(title=f"Energies of events: {_recognised(found)}", xlabel="keV", ylabel=f"events per {SPECTRUM_BIN_KEV:g} keV")
    if any(found.spectrum):
        spectrum.set_yscale("log")
        spectrum.set_xlim(0.0, float(kev[np.flatnonzero(found.spectrum)[-1]]) * 1.05)
    sizes.bar(np.arange(1, len(found.sizes)), found.sizes[1:])
    sizes.set(title="Sizes of the clusters", xlabel=f"pixels ({len(found.sizes) - 1}: and more)", ylabel="clusters")
    if not found.rate:
        rate.set_visible(False)
    seconds = (np.arange(len(found.rate)) + 0.5) * found.rate_bin_s
    rate.step(seconds, np.array(found.rate) / found.rate_bin_s, where="mid", linewidth=0.8)
    rate.set(title="Rate", xlabel="s", ylabel="hits per second")
    rate.set_ylim(bottom=0.0)
