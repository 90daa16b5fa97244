"""Output files: written completely or not at all, and never over an input or anything but a regular file."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from radron.agent.errors import OutputError


def check_output(path: Path, inputs: Iterable[Path] = ()) -> None:
    """Raise an error for an output path to which nothing can, or must, be written.

    Raises:
        OutputError: ``path`` is one of the ``inputs`` (also by a link), a folder, a device or another special file, a link to
            nowhere, or protected; its folder is missing or not writable; or it is ``-``.
    """
    if str(path) == "-":
        raise OutputError("-: standard output is not supported; give the name of a file")
    folder = _followed(path).parent
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; give the name of a file")
    if not folder.is_dir():
        raise OutputError(f"{path}: the folder {folder} does not exist; create it first")
    if path.exists():
        if not path.is_file():
            raise OutputError(f"{path}: is a device or another special file; give the name of a regular file")
        for source in inputs:
            if source.exists() and path.samefile(source):
                raise OutputError(f"{path}: is the input; give another name, or the output would overwrite it")
        if not os.access(path, os.W_OK):
            raise OutputError(f"{path}: no permission to overwrite it")
    if not os.access(folder, os.W_OK):
        raise OutputError(f"{path}: no permission to write in {folder}")
    try:
        tempfile.TemporaryFile(dir=folder).close()  # fails in folders such as /proc, whatever their permissions
    except OSError as error:
        raise OutputError(f"{path}: no file can be created in {folder}: {error.strerror or error}") from None


def _followed(path: Path) -> Path:
    """The file itself where ``path`` is a link to it."""
    if not path.is_symlink():
        return path
    try:
        target = path.resolve()
        there = target.parent.is_dir()
    except (OSError, RuntimeError):  # links that lead to each other
        there = False
    if not there:
        raise OutputError(f"{path}: is a link to {path.readlink()}, which cannot be written; remove the link")
    return target


def cache_folder() -> Path:
    """Return the folder for files that can be computed again: $XDG_CACHE_HOME/radron, by default ~/.cache/radron.

    For a user without a home directory it is a folder of that user in /tmp.
    """
    caches = os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(caches or Path.home() / ".cache") / "radron"
    except RuntimeError:  # neither HOME nor an entry in the user database, as in a container with --user
        return Path(tempfile.gettempdir()) / f"radron-{os.getuid()}"


def try_folder(folder: Path) -> None:
    """Test that files can be written to a folder, which is created if it is missing. Raise OSError if that fails."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder) as file:
        file.write(b"\0")
        file.flush()


def write_durably(path: Path, content: bytes) -> None:
    """Replace the content of a file atomically: after a power cut the file has the old or the new content, never a part.

    After the return it always has the new content. Files of one folder may be written at the same time, also files with names
    that differ in the suffix only.

    Raises:
        OSError: the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f"{path.name}.new")
    with fresh.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)  # else the name of the file may still lead to the older one after a power cut
    finally:
        os.close(folder)


@contextmanager
def replacing(path: Path, inputs: Iterable[Path] = ()) -> Iterator[Path]:
    """Give a temporary path beside ``path`` to write to; the file replaces ``path`` once the ``with`` block ends without an
    error.

    A link stays a link: the file that it points to is replaced.

    Raises:
        OutputError: as for ``check_output``, or the disk is full or fails.
    """
    check_output(path, inputs)
    path = _followed(path)
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")  # the suffix stays: writers choose the format by it
    try:
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            temporary.unlink()


def printable(text: str) -> str:
    """Return a text from outside, safe for a terminal: control characters, which could overwrite true lines, become "?"."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
