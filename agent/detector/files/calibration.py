"""Energy calibration of each pixel, from time over threshold: ToT = a E + b - c / (E - t)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.files.pixetxml import read_pixet_xml
from radron.agent.detector.readout import SENSOR_PIXELS, SENSOR_THICKNESS_MM
from radron.agent.detector.sensor import DRIFT_NS, drift_time_ns
from radron.agent.errors import DetectorError

NAMES = ("a", "b", "c", "t")
DRIFT_FILE = "drift.txt"
DRIFT_RANGE_NS = (10.0, 1000.0)  # of the time that a drift across the sensor may take
NOMINAL = (1.6, 24.0, 60.0, 1.8)  # a (counts/keV), b (counts), c (counts keV), t (keV)
MAX_BAD_SHARE = 0.2  # of the pixels, beyond which a calibration is refused
RANGE_KEV = (10.0, 1500.0)  # energies for which a pixel's time over threshold must be finite and rising
PIXELS = SENSOR_PIXELS**2
FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Calibration:
    """Converts each pixel's time over threshold (ToT), in 25 ns counts, into energy E (keV).

    Each pixel has the constants a, b, c, t of ToT = a E + b - c / (E - t). With u = E - t the relation reads a u^2 - y u - c = 0,
    y = ToT - (a t + b), whose positive root is the energy above t: E = t + (y + sqrt(y^2 + 4 a c)) / (2 a).

    table: (65536, 4) of t, a t + b, 4 a c and 1 / (2 a), by matrix index, or (1, 4) for all pixels; NaN for a bad pixel.
    bad_pixels: their number. thickness_mm: of the sensor. drift_ns: drift time of electrons across the sensor's thickness.
    """

    table: FloatArray
    bad_pixels: int = field(default=0)
    thickness_mm: float = field(default=SENSOR_THICKNESS_MM)
    drift_ns: float = field(default=DRIFT_NS)

    @property
    def good_share(self) -> float:
        """Share (0 .. 1) of the pixels that have a usable calibration."""
        return 1.0 - self.bad_pixels / PIXELS

    @property
    def good_pixels(self) -> NDArray[np.bool_]:
        """Mask (65536,) of the pixels that have a usable calibration, by matrix index."""
        return np.broadcast_to(~np.isnan(self.table[:, 0]), PIXELS)

    def energy_kev(self, index: NDArray[np.uint16], tot: NDArray[np.uint16]) -> FloatArray:
        """Convert N hits to energies (N,) in keV; NaN for bad pixels.

        index: (N,) matrix indices of the pixels. tot: (N,) times over threshold in 25 ns counts.
        """
        rows = self.table if len(self.table) == 1 else self.table.take(index, axis=0)
        t, start, curvature, slope = rows.T
        y = tot - start
        energy: FloatArray = t + (y + np.sqrt(np.maximum(y * y + curvature, 0.0))) * slope
        return energy

    @property
    def constants(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The constants a, b, c and t of every pixel, (65536,) each by matrix index; NaN for bad pixels."""
        t, start, curvature, slope = np.broadcast_to(self.table, (PIXELS, 4)).T
        a = 0.5 / slope
        return a, start - a * t, curvature / (4.0 * a), t.copy()

    def with_gain(self, gain: FloatArray | float) -> Calibration:
        """Return a corrected calibration for a camera whose pixels read ``gain`` times the true energy by this one.

        gain: (65536,) by matrix index, or one number for all pixels; pixels of gain NaN become bad.
        """
        a, b, c, t = self.constants
        return Calibration.of(a * gain, b, c, t, np.isnan(a * gain), self.thickness_mm, self.drift_ns)

    @classmethod
    def of(
        cls,
        a: FloatArray,
        b: FloatArray,
        c: FloatArray,
        t: FloatArray,
        bad: NDArray[np.bool_] | None = None,
        thickness_mm: float = SENSOR_THICKNESS_MM,
        drift_ns: float = DRIFT_NS,
    ) -> Calibration:
        """Make a calibration from the four constants of every pixel: (65536,) each by matrix index, or (1,) for all; E and t in
        keV.

        bad: mask (65536,) of pixels to be left out; None: no pixel.
        """
        with np.errstate(all="ignore"):  # of bad pixels
            table = np.column_stack((t, a * t + b, 4.0 * a * c, 0.5 / a))
        if bad is not None:
            table[bad] = np.nan
        return cls(table, 0 if bad is None else int(np.count_nonzero(bad)), thickness_mm, drift_ns)

    @classmethod
    def nominal(cls) -> Calibration:
        """Return a calibration with typical constants, equal for every pixel: for a camera without a calibration of its own."""
        a, b, c, t = (np.array([value]) for value in NOMINAL)
        return cls.of(a, b, c, t)


def calibration_files(path: Path) -> tuple[Path, ...]:
    """Return the files of a calibration: the files in its folder, or Pixet's configuration file alone."""
    if not path.is_dir():
        return (path,)
    drift = path / DRIFT_FILE
    return (*(path / f"{name}.txt" for name in NAMES), *([drift] if drift.exists() else []))


def load_calibration(path: Path) -> Calibration:
    """Read a camera's calibration: a folder, or the configuration file of Pixet (the manufacturer's software).

    The folder holds ``a.txt``, ``b.txt``, ``c.txt`` and ``t.txt``, 256 lines of 256 numbers each, the lowest row first, and may
    hold ``drift.txt``, the electrons' drift time across the sensor, ns (``radron-agent calibrate``). The configuration is an XML
    file as the camera's manufacturer delivers it; its bias voltage and thickness give the drift time. Bad pixels are masked.

    Raises:
        DetectorError: a file is missing, is not a calibration, or more than a fifth of its pixels are bad.
    """
    masked, thickness_mm, drift_ns = np.zeros(PIXELS, np.bool_), SENSOR_THICKNESS_MM, DRIFT_NS
    if path.is_dir():
        a, b, c, t = (_load_matrix(path / f"{name}.txt") for name in NAMES)
        drift_ns = _load_drift_ns(path / DRIFT_FILE)
    elif path.is_file():
        found = read_pixet_xml(path)
        a, b, c, t = found.constants
        masked, thickness_mm = found.masked, found.thickness_mm
        if found.bias_v is not None:
            drift_ns = drift_time_ns(thickness_mm, found.bias_v)
    else:
        raise DetectorError(
            f"{path}: no such file or folder; a calibration is a folder with a.txt, b.txt, c.txt and t.txt, or Pixet's XML file"
        )
    bad = masked | bad_pixels(a, b, c, t)
    if bad.mean() > MAX_BAD_SHARE:
        raise DetectorError(
            f"{path}: {np.count_nonzero(bad):,} of {PIXELS:,} pixels are masked or have no energy that rises with the time over "
            f"threshold from {RANGE_KEV[0]:g} to {RANGE_KEV[1]:g} keV; at most {MAX_BAD_SHARE:.0%} may"
        )
    return Calibration.of(a, b, c, t, bad, thickness_mm, drift_ns)


def write_calibration(folder: Path, calibration: Calibration) -> None:
    """Write a calibration to a folder, as ``load_calibration`` reads it; bad pixels get zeros in b, c and t.

    Raises:
        OSError: the folder cannot be written to.
    """
    bad = np.isnan(calibration.constants[0])
    for name, values in zip(NAMES, calibration.constants, strict=True):
        matrix = np.where(bad, float(name == "a"), values).reshape(SENSOR_PIXELS, SENSOR_PIXELS)
        np.savetxt(folder / f"{name}.txt", matrix, fmt="%.7g")
    (folder / DRIFT_FILE).write_text(f"{calibration.drift_ns:.2f}\n", encoding="ascii")


def load_flight_calibration(path: Path) -> Calibration:
    """Read the calibration of a camera that is to fly, and check that the estimators know the response of its sensor.

    Raises:
        DetectorError: as ``load_calibration``, or the sensor has a thickness for which the estimators have no response.
    """
    calibration = load_calibration(path)
    if abs(calibration.thickness_mm - SENSOR_THICKNESS_MM) > 0.01 * SENSOR_THICKNESS_MM:
        raise DetectorError(
            f"{path}: a sensor of {calibration.thickness_mm:g} mm; the estimators know the response of {SENSOR_THICKNESS_MM:g} mm"
            " only; its files can be read with radron-agent cones"
        )
    return calibration


def bad_pixels(a: FloatArray, b: FloatArray, c: FloatArray, t: FloatArray) -> NDArray[np.bool_]:
    """Return a mask (N,) of the pixels whose calibration is unusable: its time over threshold does not rise with energy, or is
    infinite.

    a, b, c, t: (N,) constants of the pixels. The slope a + c / (E - t)^2 must be positive over ``RANGE_KEV``: c = 0 is a straight
    line; a negative c must be outweighed at the lowest energy. Zeros in b, c and t together mean that the pixel was not
    calibrated.
    """
    finite = np.isfinite(a) & np.isfinite(b) & np.isfinite(c) & np.isfinite(t)
    with np.errstate(invalid="ignore", over="ignore"):
        above = RANGE_KEV[0] - t
        rising = (a > 0.0) & (above > 0.0) & (a * above * above + c > 0.0)
    empty = (b == 0.0) & (c == 0.0) & (t == 0.0)
    bad: NDArray[np.bool_] = ~(finite & rising) | empty
    return bad


def _load_drift_ns(path: Path) -> float:
    """The drift time in a file with one number; the default one where there is no such file."""
    if not path.exists():
        return DRIFT_NS
    try:
        drift_ns = float(path.read_text(encoding="utf-8-sig")[:100])
    except (OSError, ValueError):
        drift_ns = 0.0
    if not DRIFT_RANGE_NS[0] <= drift_ns <= DRIFT_RANGE_NS[1]:
        low, high = DRIFT_RANGE_NS
        raise DetectorError(f"{path}: not a drift time; it holds one number, {low:g} to {high:g} ns")
    return drift_ns


def _load_matrix(path: Path) -> FloatArray:
    try:
        with path.open(encoding="utf-8-sig") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty file: its shape is reported below
            matrix = np.loadtxt(file, dtype=np.float64, ndmin=2)
    except OSError as error:
        raise DetectorError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, UnicodeDecodeError) as error:
        raise DetectorError(f"{path}: not a matrix of numbers: {error}") from None
    if matrix.shape != (SENSOR_PIXELS, SENSOR_PIXELS):
        found = f"{matrix.shape[0]} x {matrix.shape[1]}" if matrix.size else "nothing"
        raise DetectorError(f"{path}: holds {found}; {SENSOR_PIXELS} lines of {SENSOR_PIXELS} numbers are needed")
    return matrix.ravel()
