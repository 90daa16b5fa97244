"""Energy calibration of each pixel, from time over threshold: ToT = a E + b - c / (E - t)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agent.detector.readout import SENSOR_PIXELS
from agent.errors import DetectorError

NAMES = ("a", "b", "c", "t")
NOMINAL = (1.6, 24.0, 60.0, 1.8)  # a (counts/keV), b (counts), c (counts keV), t (keV)


@dataclass(frozen=True, slots=True)
class Calibration:
    """Converts each pixel's time over threshold, in 25 ns counts, into energy.

    With u = E - t the relation reads a u^2 - y u - c = 0, y = ToT - (a t + b), whose positive root is the energy above t: E = t +
    (y + sqrt(y^2 + 4 a c)) / (2 a). table: (65536, 4) of t, a t + b, 4 a c and 1 / (2 a), by matrix index, or (1, 4) for all.
    """

    table: NDArray[np.float64]

    def energy_kev(self, index: NDArray[np.uint16], tot: NDArray[np.uint16]) -> NDArray[np.float64]:
        """Energies in keV, (N,), from matrix indices and time over threshold, (N,) each."""
        rows = self.table if len(self.table) == 1 else self.table.take(index, axis=0)
        t, start, curvature, slope = rows.T
        y = tot - start
        energy: NDArray[np.float64] = t + (y + np.sqrt(y * y + curvature)) * slope
        return energy

    @classmethod
    def of(cls, a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], t: NDArray[np.float64]) -> Calibration:
        """From the four constants of every pixel, (65536,) each by matrix index, or (1,) for all; E and t in keV."""
        return cls(np.column_stack((t, a * t + b, 4.0 * a * c, 0.5 / a)))

    @classmethod
    def nominal(cls) -> Calibration:
        """Typical constants, the same for every pixel: for a camera without its own calibration."""
        a, b, c, t = (np.array([value]) for value in NOMINAL)
        return cls.of(a, b, c, t)


def load_calibration(folder: Path) -> Calibration:
    """Read ``a.txt``, ``b.txt``, ``c.txt`` and ``t.txt``: 256 lines of 256 numbers each, the lowest row first.

    Raises:
        DetectorError: a file is missing, is not such a matrix, or holds values for which no energy exists.
    """
    if not folder.is_dir():
        raise DetectorError(f"{folder}: no such folder; a calibration is a folder with a.txt, b.txt, c.txt and t.txt")
    a, b, c, t = (_load_matrix(folder / f"{name}.txt") for name in NAMES)
    _require(a > 0.0, folder / "a.txt", "a must be above 0")
    _require(c >= 0.0, folder / "c.txt", "c must not be negative")
    return Calibration.of(a, b, c, t)


def _load_matrix(path: Path) -> NDArray[np.float64]:
    try:
        with path.open(encoding="utf-8") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty file: its shape is reported below
            matrix = np.loadtxt(file, dtype=np.float64, ndmin=2)
    except OSError as error:
        raise DetectorError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, UnicodeDecodeError) as error:
        raise DetectorError(f"{path}: not a matrix of numbers: {error}") from None
    if matrix.shape != (SENSOR_PIXELS, SENSOR_PIXELS):
        found = f"{matrix.shape[0]} x {matrix.shape[1]}" if matrix.size else "nothing"
        raise DetectorError(f"{path}: holds {found}; {SENSOR_PIXELS} lines of {SENSOR_PIXELS} numbers are needed")
    _require(np.isfinite(matrix), path, "every value must be a finite number")
    return matrix.ravel()


def _require(good: NDArray[np.bool_], path: Path, rule: str) -> None:
    if not good.all():
        row, column = divmod(int(np.argmin(good)), SENSOR_PIXELS)
        raise DetectorError(f"{path}: line {row + 1}, column {column + 1}: {rule}")
