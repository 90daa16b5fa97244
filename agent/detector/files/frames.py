"""Pixet's frames: a text file of 256 lines of 256 numbers, and beside it ``.dsc``, which describes it.

A measurement in frames is a pair of such files: of time over threshold (``..._ToT.txt``), and of time of arrival
(``..._ToA.txt``).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.readout import SENSOR_PIXELS
from radron.agent.errors import DetectorError

_MAX_BYTES = 16 << 20  # 65,536 numbers need less than 2 MB
_ACQUIRED = re.compile(r'"Acq time"[^\n]*\n[^\n]*\n\s*([0-9.,]+)')


@dataclass(frozen=True, slots=True)
class Frame:
    """An image of the camera: time over threshold of each pixel in one exposure, without times of the hits.

    tot: (65536,) counts of 25 ns by matrix index, 0: no hit. acquisition_s: length of the exposure; None if no description states
    it.
    """

    tot: NDArray[np.int64]
    acquisition_s: float | None


def is_frame(path: Path) -> bool:
    """Return whether a file is an image: its first line has a number for each column of the sensor."""
    with path.open("rb") as file:
        fields = file.readline(SENSOR_PIXELS * 32).split()
    try:
        return len(fields) == SENSOR_PIXELS and bool([float(field) for field in fields])
    except ValueError:
        return False


def read_frame(path: Path) -> Frame:
    """Read an image of time over threshold from a text file of 256 lines of 256 numbers.

    Raises:
        DetectorError: the file is not such an image; the text names the line.
    """
    if path.stat().st_size > _MAX_BYTES:
        raise DetectorError(f"{path}: larger than {_MAX_BYTES >> 20} MB; not a frame of {SENSOR_PIXELS} x {SENSOR_PIXELS} pixels")
    try:
        matrix = np.loadtxt(path, np.float64, ndmin=2, encoding="utf-8-sig")
    except (ValueError, UnicodeDecodeError) as error:
        raise DetectorError(f"{path}: not a frame: {error}") from None
    if matrix.shape != (SENSOR_PIXELS, SENSOR_PIXELS):
        raise DetectorError(f"{path}: holds {matrix.shape[0]} x {matrix.shape[1]} numbers, not {SENSOR_PIXELS} x {SENSOR_PIXELS}")
    whole = np.isfinite(matrix) & (matrix == np.floor(matrix)) & (matrix >= 0)
    if not whole.all():
        raise DetectorError(
            f"{path}: line {int(whole.all(axis=1).argmin()) + 1}: not whole numbers; name the frame of time over threshold (ToT)"
        )
    return Frame(matrix.ravel().astype(np.int64), _acquisition_s(path))


def _acquisition_s(path: Path) -> float | None:
    description = path.with_name(path.name + ".dsc")
    if not description.is_file():
        return None
    found = _ACQUIRED.search(description.read_text(encoding="utf-8", errors="replace")[:_MAX_BYTES])
    return float(found[1].replace(",", ".")) if found else None
