"""``radron-agent cones``: progress and summary on the terminal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from radron.agent.config.mission import AUTO, DetectionConfig
from radron.agent.detector.analysis import Summary, analyse, recognise
from radron.agent.detector.files.calibration import PIXELS, Calibration, load_calibration
from radron.agent.detector.files.t3pa import T3paReader
from radron.agent.detector.lines import lines_of
from radron.agent.detector.spectroscopy.residuals import told
from radron.agent.outputs import check_output


def run_cones(opened: Callable[[], T3paReader], csv: Path, nuclide: str, calibration: Path | None) -> None:
    """Compute the Compton cones of a recording and write them as CSV, with progress on stderr and a summary on stdout. Raises
    RadronError.

    ``opened``: returns a new reader of the recording; ``csv``: output file; ``nuclide``: name, or AUTO to recognise it from the
    recording's spectrum first; ``calibration``: of the camera; None: typical constants.
    """
    if nuclide != AUTO:
        lines_of(nuclide)
    reader = opened()
    file = reader.path
    check_output(csv, (file,))
    constants = Calibration.nominal() if calibration is None else load_calibration(calibration)
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    terminal = Console(stderr=True)
    with Progress(*columns, console=terminal, transient=True, disable=not terminal.is_terminal) as progress:
        task = progress.add_task(file.name, total=reader.size_bytes)
        if nuclide == AUTO:
            found = recognise(
                opened(),
                DetectionConfig(),
                constants,
                progress=lambda position: progress.update(task, completed=position),
            )
            nuclide = found.nuclide
        summary = analyse(
            reader,
            DetectionConfig(),
            nuclide,
            constants,
            csv,
            progress=lambda position: progress.update(task, completed=position),
        )
    Console().print(summary_table(file.name, nuclide, summary))
    if constants.bad_pixels:
        Console(stderr=True).print(f"{calibration}: {constants.bad_pixels:,} of {PIXELS:,} pixels are masked", highlight=False)
    for note in summary.notes:
        Console(stderr=True).print(f"{file}: {note}", highlight=False)
    Console().print(f"{summary.cones} cones in {csv}", highlight=False)


def summary_table(name: str, nuclide: str, summary: Summary) -> Table:
    """Return the summary of a recording as a table for the terminal."""
    table = Table(title=f"{name}, {nuclide}", show_header=False)
    live = summary.live_time_s

    def rate(count: int) -> str:
        return f"{count:,}  ({count / live:.3g} /s)" if live > 0.0 else f"{count:,}"

    table.add_row("pixel hits", f"{summary.rows - summary.lost_rows:,}")
    if summary.lost_rows:
        table.add_row("overflow rows", f"{summary.lost_rows:,}")
    if summary.measurements > 1:
        table.add_row("measurements", f"{summary.measurements}, one after the other (--measurement N: one of them)")
    if summary.repaired_rows:
        table.add_row("moved by 409.6 us", f"{summary.repaired_rows:,} (beside a border of the chip's counter)")
    if summary.noise_rows:
        table.add_row("of noisy pixels", f"{summary.noise_rows:,}")
    table.add_row("duration, live", f"{summary.duration_s:.6g} s, {live:.6g} s")
    table.add_row("clusters", rate(summary.hits))
    table.add_row("full energy", rate(summary.photopeak))
    table.add_row("coincidences", rate(summary.coincidences))
    table.add_row("cones", rate(summary.cones))
    if summary.peak is not None:
        peak = summary.peak
        width = 100.0 * peak.fwhm_kev / peak.line_kev
        table.add_row("peak", f"{peak.centre_kev:.1f} keV for the line of {peak.line_kev:g} keV, FWHM {width:.1f} %")
    table.add_row("recognised", _recognised(summary, nuclide))
    if summary.direction is not None:
        found = summary.direction
        table.add_row(
            "single far source",
            f"{found.polar_deg:.1f} deg from the normal, azimuth {found.azimuth_deg:.1f} deg, "
            f"+- {np.rad2deg(found.sigma_rad):.1f} deg ({found.cones:,} cones)",
        )
    return table


def _recognised(summary: Summary, nuclide: str) -> str:
    found = summary.recognised
    if found is None and summary.unknown_lines_kev:
        return f"unknown, lines at {told(summary.unknown_lines_kev)}"
    if found is None:
        return "no nuclide stands out"
    other = "" if found.nuclide == nuclide else f", not {nuclide}"
    return f"{found.nuclide}{other} (evidence {found.evidence:.0f}, {found.peak_events:,.0f} events in its peaks)"
