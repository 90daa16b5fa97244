"""The folder of a camera's calibrations: one subfolder for each, and the history of them all."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from radron.agent.calibration.collection import Collection, block_of_pixels
from radron.agent.calibration.page import draw, verdict
from radron.agent.calibration.result import Result, goals
from radron.agent.detector.files.calibration import PIXELS, Calibration, write_calibration
from radron.agent.errors import OutputError

HISTORY = "history.csv"
_COLUMNS = ("stamp", "verdict", "nuclide", "live_s", "gain", "gain_sigma", "drift_ns", "drift_sigma_ns", "roll_deg", "pitch_deg",
            "yaw_deg", "dead", "noisy", "background_per_s")  # fmt: skip


def check_folder(folder: Path) -> None:
    """Raise OutputError if the folder cannot be made or written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written to: {error.strerror or error}") from None


def corrected(calibration: Calibration, result: Result) -> Calibration:
    """Return the calibration with the measured gains of each part of the sensor and drift time, and without dead and noisy
    pixels.
    """
    gain = np.ones(PIXELS)
    if result.gain is not None:
        values = np.array([result.gain.value if block is None else block.value for block in result.blocks])
        gain = values[block_of_pixels()]
    gain[result.bad_pixels] = np.nan
    drift_ns = calibration.drift_ns if result.drift is None else result.drift.drift_ns
    return replace(calibration.with_gain(gain), drift_ns=drift_ns)


def save(folder: Path, result: Result, collection: Collection, calibration: Calibration) -> tuple[Path, bool]:
    """Write a calibration into a subfolder of its own, and a line into the history of all calibrations.

    Return the subfolder, and whether it holds the picture, for which matplotlib is needed.

    Raises:
        OutputError: the folder cannot be written to.
    """
    own = folder / result.stamp
    try:
        own.mkdir()
        write_calibration(own, corrected(calibration, result))
        report = {"verdict": verdict(result), "goals": goals(result), "result": result}
        (own / "result.json").write_bytes(msgspec.json.format(msgspec.json.encode(report), indent=1))
        is_drawn = draw(result, collection, own / "page.png")
        history = folder / HISTORY
        is_new = not history.exists()
        with history.open("a", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            if is_new:
                writer.writerow(_COLUMNS)
            writer.writerow(_row(result))
    except OSError as error:
        raise OutputError(f"{own}: cannot be written: {error.strerror or error}") from None
    return own, is_drawn


def _row(result: Result) -> tuple[str | int, ...]:
    gain, drift, orientation, background = result.gain, result.drift, result.orientation, result.background
    angles = ("", "", "") if orientation is None else tuple(f"{angle:.2f}" for angle in orientation.camera_rpy_deg)
    return (
        result.stamp,
        verdict(result),
        result.nuclide,
        f"{result.live_s:.0f}",
        *(("", "") if gain is None else (f"{gain.value:.4f}", f"{gain.sigma:.4f}")),
        *(("", "") if drift is None else (f"{drift.drift_ns:.2f}", f"{drift.sigma_ns:.2f}")),
        *angles,
        "" if result.dead_pixels is None else len(result.dead_pixels),
        len(result.noisy_pixels),
        "" if background is None else f"{background.per_s:.3f}",
    )
