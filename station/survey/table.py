"""A recorded survey from a CSV file: a header, and a row for each record with time, place, height and counts by channel.

Columns: ``time_s`` (or ``epoch_s``); ``x_m`` and ``y_m`` (mission frame), or ``lat_deg`` and ``lon_deg``; ``height_m`` above
ground; ``live_s`` (without it a record is live until the next one); ``ch0``, ``ch1``, ... counts by channel. Others are ignored.
Commas separate them, or semicolons where numbers have decimal commas.
"""

from __future__ import annotations

import csv
import io
import lzma
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radron.agent.errors import ConfigError
from radron.agent.inputs import read_bytes, text_of

Array = NDArray[np.float64]

MAX_SURVEY_BYTES = 200_000_000
MIN_RECORDS = 3
MAX_RECORD_S = 60.0  # a longer gap between two records is none's live time
_CHANNEL = re.compile(r"ch(\d+)\Z")
_TIMES, _HEIGHTS, _LIVE = ("time_s", "epoch_s"), ("height_m",), "live_s"
_PLACES = (("x_m", "y_m"), ("lon_deg", "lat_deg"))


@dataclass(frozen=True, eq=False)
class Survey:
    """A recorded survey of N records and R channels.

    time_s: (N,) rising. place: (N, 2) east and north (m), or longitude and latitude (deg) if ``on_earth``. height_m: (N,) above
    ground. live_s: (N,) live time of each record. counts: (N, R). dropped: what was wrong with each unusable row, by line.
    """

    time_s: Array
    place: Array
    on_earth: bool
    height_m: Array
    live_s: Array
    counts: NDArray[np.int64]
    dropped: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time_s)


def read_survey(path: Path, time: str | None = None, height: str | None = None) -> Survey:
    """Read a survey from a CSV file, plain or compressed (.xz). Unusable rows are left out, and named in ``dropped``.

    time, height: names of these columns in a file with other names.

    Raises:
        ConfigError: the file cannot be read, lacks a column, or has fewer than ``MIN_RECORDS`` usable rows.
    """
    rows = _rows(_text(path))
    header = [name.strip() for name in next(rows, [])]
    names = _Columns(header, path, time, height)
    values: list[list[float]] = []
    dropped: list[str] = []
    last_s = -math.inf
    for line, row in enumerate(rows, start=2):
        if not any(cell.strip() for cell in row):
            continue
        found = names.parsed(row)
        if isinstance(found, list) and found[0] <= last_s:
            found = f"{names.time} does not rise"
        if isinstance(found, str):
            dropped.append(f"line {line}: {found}")
            continue
        last_s = found[0]
        values.append(found)
    if len(values) < MIN_RECORDS:
        reason = f"; {len(dropped)} are not, the first: {dropped[0]}" if dropped else ""
        raise ConfigError(f"{path}: {len(values)} usable records, at least {MIN_RECORDS} are needed{reason}")
    table = np.array(values)
    gaps_s = np.diff(table[:, 0])
    live_s = table[:, 4] if names.has_live else np.append(gaps_s, np.median(gaps_s))
    live_s = np.where(live_s > MAX_RECORD_S, np.median(gaps_s), live_s)
    counts = table[:, 5:].astype(np.int64)
    return Survey(table[:, 0], table[:, 1:3], names.on_earth, table[:, 3], live_s, counts, tuple(dropped))


def _rows(text: str) -> Iterator[list[str]]:
    """Rows of a file with commas between the values, or with semicolons and decimal commas."""
    if ";" not in text.partition("\n")[0]:
        yield from csv.reader(io.StringIO(text))
        return
    for row in csv.reader(io.StringIO(text), delimiter=";"):
        yield [cell.replace(",", ".") for cell in row]


def _text(path: Path) -> str:
    data = read_bytes(path, MAX_SURVEY_BYTES, str(path), "divide it")
    try:
        return text_of(lzma.decompress(data) if path.suffix == ".xz" else data)
    except (lzma.LZMAError, ValueError, EOFError) as error:
        raise ConfigError(f"{path}: not a CSV file: {error}") from None


class _Columns:
    """Places of the columns in the rows of a file."""

    def __init__(self, header: Sequence[str], path: Path, time: str | None, height: str | None) -> None:
        place = {name: index for index, name in reversed(list(enumerate(header)))}
        self._width = len(header)
        self.time = _one_of(place, (time,) if time else _TIMES, path, "--time")
        pair = next((pair for pair in _PLACES if all(name in place for name in pair)), None)
        if pair is None:
            raise ConfigError(f"{path}: no columns of a place; give {' or '.join(' and '.join(pair) for pair in _PLACES)}")
        self.on_earth = pair == _PLACES[1]
        above = _one_of(place, (height,) if height else _HEIGHTS, path, "--height")
        self.has_live = _LIVE in place
        live = [place[_LIVE]] if self.has_live else []
        channels = sorted((int(found[1]), index) for name, index in place.items() if (found := _CHANNEL.match(name)))
        if [number for number, _ in channels] != list(range(len(channels))) or not channels:
            raise ConfigError(f"{path}: {len(channels)} columns of channels; name them ch0, ch1, ... without gaps")
        self._fixed = [place[self.time], *(place[name] for name in pair), place[above], *live]
        self._channels = [index for _, index in channels]

    def parsed(self, row: Sequence[str]) -> list[float] | str:
        """Time, place, height, live time (0 if the file has none) and counts of a row, or what is wrong with it."""
        if len(row) != self._width:
            return f"{len(row)} values instead of {self._width}"
        try:
            fixed = [float(row[index]) for index in self._fixed]
            counts = [float(row[index]) for index in self._channels]
        except ValueError as error:
            return str(error)
        if not all(map(math.isfinite, fixed)):
            return "time, place, height or live time is not finite"
        if not self.has_live:
            fixed.append(0.0)
        if fixed[4] < 0.0:
            return "a negative live time"
        if self.on_earth and not (-180.0 <= fixed[1] <= 180.0 and -90.0 <= fixed[2] <= 90.0):
            return "no longitude or latitude"
        if not all(0.0 <= count < 1e9 and count.is_integer() for count in counts):
            return "counts are whole numbers from 0 on"
        return [*fixed, *counts]


def _one_of(place: dict[str, int], names: Sequence[str], path: Path, option: str) -> str:
    for name in names:
        if name in place:
            return name
    raise ConfigError(f"{path}: no column {' or '.join(names)}; name it with {option}")
