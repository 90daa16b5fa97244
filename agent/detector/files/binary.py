"""Pixet's ``.t3p``: the rows of a ``.t3pa`` as binary records of 16 bytes, without their index and without a header.

A record is, little-endian: matrix index (4 bytes), ToA (8), overflow (1), FToA (1), ToT (2), in the order of the readout.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.files.table import FTOA, MATRIX, NO_INDEX, OVERFLOW, TOA, TOT, check_ranges
from radron.agent.errors import DetectorError

_RECORD = np.dtype([("matrix", "<u4"), ("toa", "<u8"), ("overflow", "u1"), ("ftoa", "u1"), ("tot", "<u2")])
_ROWS = 1 << 16
_MAX_INT = np.uint64((1 << 63) - 1)


def is_binary(start: bytes) -> bool:
    """Return whether a file that begins with these bytes holds binary records (``.t3p``) rather than text."""
    return b"\0" in start[: _RECORD.itemsize]


def binary_tables(path: Path, file: BinaryIO) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], bool]]:
    """Yield the records of a binary file, N at a time: table (N, 6), record numbers (N,), and whether the last record is
    incomplete.

    The columns of the table are in the order of ``table.COLUMNS``.

    Raises:
        DetectorError: a record whose numbers are out of range: the file is of another format.
    """
    number = 1
    while data := file.read(_ROWS * _RECORD.itemsize):
        whole = len(data) // _RECORD.itemsize
        records = np.frombuffer(data, _RECORD, whole)
        table = np.full((whole, 6), NO_INDEX, np.int64)
        for column, name in ((MATRIX, "matrix"), (TOT, "tot"), (FTOA, "ftoa"), (OVERFLOW, "overflow")):
            table[:, column] = records[name]
        table[:, TOA] = np.minimum(records["toa"], _MAX_INT).astype(np.int64)
        numbers = np.arange(number, number + whole)
        try:
            check_ranges(path, table, numbers, "record")
        except DetectorError as error:
            raise DetectorError(f"{error}; neither a .t3pa nor a .t3p file; export the measurement as .t3pa") from None
        yield table, numbers, len(data) % _RECORD.itemsize != 0
        number += whole
