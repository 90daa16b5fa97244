"""The table of a ``.t3pa`` file: its delimiter and columns, and rows of text turned into whole numbers.

Columns are separated by tabs (as the manufacturer's software exports them), semicolons, commas or blanks, and further columns, of
any content, are ignored. Blank lines and a byte order mark are skipped.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.readout import SENSOR_PIXELS
from radron.agent.errors import DetectorError

INDEX, MATRIX, TOA, TOT, FTOA, OVERFLOW = range(6)  # columns of a parsed table
COLUMNS = ("index", "matrix index", "toa", "tot", "ftoa", "overflow")
NO_INDEX = -1  # in the first column, where the file does not number its rows
MAX_CHIPS = 16
CHIP_PIXELS = SENSOR_PIXELS**2
_SHORT = (MATRIX, TOA, TOT)  # columns of rows with three values
_MAX_TOA = 1 << 56
_MAX_TOT = 1 << 16
_FTOA_STEPS = 32


@dataclass(frozen=True, slots=True)
class Layout:
    """The format of the rows in a ``.t3pa`` file: delimiter and columns.

    ``delimiter``: None: blanks; ``places``: position of each of ``COLUMNS`` in a row (None: missing); ``notes``: for the user.
    """

    delimiter: str | None
    places: tuple[int | None, ...]
    notes: tuple[str, ...] = ()

    @property
    def numbered(self) -> bool:
        """Whether the rows of the file have an index column, which restarts with each measurement."""
        return self.places[INDEX] is not None

    def is_row(self, text: bytes) -> bool:
        """Return whether a line of the file has a whole number in every column."""
        fields = text.decode("latin-1").strip("\r\n").split(self.delimiter)
        places = [place for place in self.places if place is not None]
        return max(places) < len(fields) and all(fields[place].strip().lstrip("-").isdigit() for place in places)


def find_layout(path: Path, header: bytes, row: bytes) -> Layout:
    """Return the format of a ``.t3pa`` file's rows from its header line and its first row (empty: a file without rows).

    Raises:
        DetectorError: a required column is missing.
    """
    text = header.decode("utf-8-sig", errors="replace").strip().lower()
    if re.match(r"frame \d+ *\(", text):
        raise DetectorError(
            f"{path}: a cluster log (.clog), whose hits have no time of their own; export the measurement as .t3pa"
        )
    delimiter = _delimiter(text)
    names = _names(text, delimiter)
    missing = [name for name in COLUMNS[MATRIX:] if name not in names]
    if missing:
        raise DetectorError(
            f"{path}: line 1: not the header of a .t3pa file (no column {missing[0]!r}); "
            "export the measurement as Timepix3 pixels, ASCII"
        )
    first = row.decode("latin-1").strip("\r\n")
    if delimiter is not None and delimiter not in first:
        delimiter = _delimiter(first)
    if len(first.strip().split(delimiter)) == len(_SHORT):
        short = tuple(_SHORT.index(column) if column in _SHORT else None for column in range(len(COLUMNS)))
        return Layout(delimiter, short, ("rows of three values: matrix index, ToA and ToT; FToA is taken as 0",))
    return Layout(delimiter, tuple(names.index(name) if name in names else None for name in COLUMNS))


def parse_rows(path: Path, layout: Layout, lines: list[bytes], line: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Convert N lines of text to a table (N, 6) of whole numbers, columns as in ``COLUMNS``, and their line numbers (N,).

    ``line``: number of the first line.

    Raises:
        DetectorError: names the first line that is not a row of whole numbers, or whose numbers are out of range.
    """
    return _parse(path, layout, lines, np.arange(line, line + len(lines)))


def _parse(
    path: Path, layout: Layout, lines: list[bytes], numbers: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    table = np.zeros((len(lines), len(COLUMNS)), np.int64)
    table[:, INDEX] = NO_INDEX
    if not lines:
        return table, numbers
    present = [column for column, place in enumerate(layout.places) if place is not None]
    places = [place for place in layout.places if place is not None]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # nothing but blank lines
            read = np.loadtxt(lines, np.int64, delimiter=layout.delimiter, comments=None, ndmin=2, usecols=places)
    except (ValueError, OverflowError):
        read = np.empty((0, 0), np.int64)
    if len(read) != len(lines):
        full = [k for k, text in enumerate(lines) if text.strip()]
        if len(full) == len(lines):
            raise _broken(path, layout, lines, numbers)
        return _parse(path, layout, [lines[k] for k in full], numbers[full])
    table[:, present] = read
    check_ranges(path, table, numbers)
    return table, numbers


def check_ranges(path: Path, table: NDArray[np.int64], numbers: NDArray[np.int64], what: str = "line") -> None:
    """Raise DetectorError for the first row of a table (N, 6) whose numbers are out of range.

    ``numbers``: (N,) line or record numbers, for the error. ``what``: the word for a row.
    """
    _, matrix, toa, tot, ftoa, overflow = table.T
    rules = (
        ((matrix >= 0) & (matrix < MAX_CHIPS * CHIP_PIXELS), f"the matrix index is not in 0 .. {MAX_CHIPS * CHIP_PIXELS - 1}"),
        ((toa >= 0) & (toa < _MAX_TOA), "ToA is out of range"),
        ((tot >= 0) & (tot < _MAX_TOT), "ToT is out of range"),
        ((ftoa >= 0) & (ftoa < _FTOA_STEPS), "FToA is not in 0 .. 31"),
        ((overflow >= 0) & (overflow <= 1), "Overflow is not 0 or 1"),
    )
    for good, problem in rules:
        if not good.all():
            raise DetectorError(f"{path}: {what} {numbers[good.argmin()]}: {problem}")


def _broken(path: Path, layout: Layout, lines: list[bytes], numbers: NDArray[np.int64]) -> DetectorError:
    """Return the error for the first of the lines that is not a row."""
    for number, text in zip(numbers.tolist(), lines, strict=True):
        if not layout.is_row(text):
            shown = text[:60].decode("ascii", errors="replace").strip()
            return DetectorError(f"{path}: line {number}: not a row of whole numbers, as its header has them: {shown!r}")
    return DetectorError(f"{path}: lines {numbers[0]} to {numbers[-1]}: numbers that are too large")


def _delimiter(text: str) -> str | None:
    return next((mark for mark in "\t;," if mark in text), None)


def _names(text: str, delimiter: str | None) -> list[str]:
    if delimiter is None:  # the name of two words is found before the blanks separate
        return [name.replace("_", " ") for name in re.sub(r"matrix +index", "matrix_index", text).split()]
    return [name.strip() for name in text.split(delimiter)]
