"""Files that survive being killed: whole files by rename, and a JSON Lines file that grows by one line per run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec

from agent.errors import ConfigError

Line = Mapping[str, Any]


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path`` to write to; it takes the place of ``path`` once the block ends without an error."""
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")  # the suffix stays: writers choose the format by it
    try:
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text file as a whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def json_line(line: Line) -> str:
    """One flat object on one line; numbers as they are, so that reading them back gives the same bits."""
    return msgspec.json.encode(line).decode() + "\n"


def make_folder(path: Path) -> None:
    """Make an output folder.

    Raises:
        ConfigError: it cannot be made or written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be made: {error.strerror}; choose another --out") from None
    if not os.access(path, os.W_OK):
        raise ConfigError(f"{path}: cannot be written to; choose another --out")


class RunFile:
    """A JSON Lines file of runs: appended to line by line, each safely on the disk before the next.

    What a killed process left is read on opening; a last line without its end is what it was writing, and is cut off.
    """

    def __init__(self, path: Path) -> None:
        """Open or make the file.

        Raises:
            ConfigError: a line other than the last cannot be read.
        """
        self.path = path
        content = path.read_bytes() if path.exists() else b""
        whole, _, torn = content.rpartition(b"\n")
        self.lines: list[dict[str, Any]] = [self._parse(text, number) for number, text in enumerate(whole.splitlines(), 1)]
        if torn:
            os.truncate(path, len(content) - len(torn))

    def append(self, line: Line) -> None:
        """Add a line; on return it has reached the disk."""
        with self.path.open("ab") as stream:
            stream.write(json_line(line).encode())
            stream.flush()
            os.fsync(stream.fileno())
        self.lines.append(dict(line))

    def rewrite(self, lines: Iterable[Line]) -> None:
        """Replace the content."""
        kept = [dict(line) for line in lines]
        write_text(self.path, "".join(map(json_line, kept)))
        self.lines = kept

    def sort(self, key: Callable[[Line], Any]) -> None:
        """Put the lines in order."""
        self.rewrite(sorted(self.lines, key=key))

    def _parse(self, text: bytes, number: int) -> dict[str, Any]:
        try:
            line: dict[str, Any] = msgspec.json.decode(text, type=dict[str, Any])
        except msgspec.DecodeError as error:
            raise ConfigError(f"{self.path}:{number}: not a run: {error}; remove the line to fly that run again") from None
        return line
