"""Input files of users: read up to a limit, and text with or without a byte order mark."""

from __future__ import annotations

import codecs
from pathlib import Path

from radron.agent.errors import ConfigError

_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def read_bytes(path: Path, max_bytes: int, where: str, hint: str) -> bytes:
    """Read a whole file of limited size.

    ``where`` and ``hint``: begin and end of the text of the errors.

    Raises:
        ConfigError: the file cannot be read, or is larger than ``max_bytes``.
    """
    try:
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as error:
        raise ConfigError(f"{where}: cannot be read: {error.strerror}") from None
    if len(data) > max_bytes:
        raise ConfigError(f"{where}: more than {max_bytes // 1_000_000} MB: {hint}")
    return data


def refuse_stream(path: Path) -> None:
    """Raise ConfigError if a path is a pipe or a device, for functions that read a file more than once.

    A missing file passes: its reader reports it.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise ConfigError(f"{path}: is a pipe or a device, which can be read only once; save it to a file, and name that")


def text_of(data: bytes) -> str:
    """Decode the bytes of a text file: UTF-8, or UTF-16 with a byte order mark, as editors and spreadsheets on Windows write
    them.

    Raises:
        ValueError: another encoding; the text names the first wrong byte, and quotes nothing of the file.
    """
    try:
        return data.decode("utf-16" if data.startswith(_UTF_16) else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8: {error.reason} at byte {error.start}") from None


def read_text(path: Path) -> str:
    """Read a text file. Raise OSError if it cannot be read, and ValueError if its encoding is wrong, as ``text_of`` does."""
    return text_of(path.read_bytes())
