"""Result files that stay intact if the process is killed: whole files by renaming, and a file with one JSON line per run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from radron.agent.errors import ConfigError, OutputError
from radron.agent.outputs import check_output, replacing

Line = Mapping[str, Any]


def write_text(path: Path, text: str) -> None:
    """Write a text file completely or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def json_line(line: Line) -> str:
    """Return a flat object as one line of JSON; numbers have full precision, so that they are read back exactly."""
    return msgspec.json.encode(line).decode() + "\n"


def make_folder(path: Path) -> None:
    """Create a folder for the results of simulated flights.

    Raises:
        ConfigError: the folder cannot be created or written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise ConfigError(f"{path}: is not a folder; choose another --out") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be created: {error.strerror}; choose another --out") from None
    if not os.access(path, os.W_OK):
        raise ConfigError(f"{path}: cannot be written to; choose another --out")


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Turn an OSError into an OutputError that names the file."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None


class RunFile:
    """A JSON Lines file with the results of a campaign, one line for each simulated flight.

    Each line is safely on disk before the next is written. Opening the file reads the lines left by an earlier process; an
    incomplete last line, left when this process was killed, is cut off.
    """

    def __init__(self, path: Path) -> None:
        """Open or create the file.

        Raises:
            ConfigError: a line other than the last cannot be read.
            OutputError: the file cannot be read or written.
        """
        self.path = path
        check_output(path)
        with _told(path):
            content = path.read_bytes() if path.exists() else b""
            path.open("ab").close()
        whole, _, torn = content.rpartition(b"\n")
        self.lines: list[dict[str, Any]] = [self._parse(text, number) for number, text in enumerate(whole.splitlines(), 1)]
        if torn:
            os.truncate(path, len(content) - len(torn))

    def append(self, line: Line) -> None:
        """Add a line; on return it has reached the disk.

        Raises:
            OutputError: the line cannot be written completely; the next opening cuts it off.
        """
        with _told(self.path), self.path.open("ab") as stream:
            stream.write(json_line(line).encode())
            stream.flush()
            os.fsync(stream.fileno())
        self.lines.append(dict(line))

    def rewrite(self, lines: Iterable[Line]) -> None:
        """Replace all lines of the file."""
        kept = [dict(line) for line in lines]
        write_text(self.path, "".join(map(json_line, kept)))
        self.lines = kept

    def sort(self, key: Callable[[Line], Any]) -> None:
        """Sort the lines of the file by a ``key``."""
        self.rewrite(sorted(self.lines, key=key))

    def _parse(self, text: bytes, number: int) -> dict[str, Any]:
        try:
            line: dict[str, Any] = msgspec.json.decode(text, type=dict[str, Any])
        except msgspec.DecodeError as error:
            raise ConfigError(f"{self.path}:{number}: not a run: {error}; remove the line to fly that run again") from None
        return line
