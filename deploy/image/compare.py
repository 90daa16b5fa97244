"""Comparison of two disk images: which partitions differ, and which files of the root file system."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from radron.deploy.digest import digest
from radron.deploy.image.flash import check_image
from radron.deploy.image.layout import MIB, PARTITIONS, ROOT_A, ROOT_B, Partition
from radron.deploy.image.tools import need, run

_MAX_NAMED_FILES = 50  # named files


def differences(one: Path, other: Path) -> list[str]:
    """Return the differences of two disk images, one line each; empty for equal images.

    Raises:
        ImageError: a file is no image, or a program is missing.
    """
    for image in (one, other):
        check_image(image)
    if digest(one) == digest(other):
        return []
    found = [part for part in PARTITIONS if not _equal(one, other, part.start, part.size)]
    lines = [f"{part.name}: differs" for part in found]
    if not _equal(one, other, 0, MIB):
        lines.insert(0, "partition table: differs")
    for part in found:
        if part in (ROOT_A, ROOT_B):
            need("unsquashfs")
            lines += _files_that_differ(one, other, part)
    return lines


def unpack_root(image: Path, part: Partition, folder: Path) -> None:
    """Unpack the root file system of a system partition of an image into a new folder.

    Without the rights of root, device files and owners are not made.

    Raises:
        ImageError: the file system cannot be unpacked.
    """
    unpack = ["unsquashfs", "-no-progress", "-no-xattrs", "-ignore-errors", "-no-exit-code"]
    run([*unpack, "-offset", str(part.start), "-dest", str(folder), str(image)])


def _equal(one: Path, other: Path, start: int, size: int) -> bool:
    with one.open("rb") as first, other.open("rb") as second:
        first.seek(start)
        second.seek(start)
        for _ in range(0, size, MIB):
            if first.read(MIB) != second.read(MIB):
                return False
    return True


def _files_that_differ(one: Path, other: Path, part: Partition) -> list[str]:
    with tempfile.TemporaryDirectory(prefix="radron-compare-") as name:
        listed = []
        for number, image in enumerate((one, other)):
            folder = Path(name) / str(number)
            unpack_root(image, part, folder)
            listed.append(_tree(folder))
    first, second = listed
    names = [name for name in sorted(first.keys() | second.keys()) if first.get(name) != second.get(name)]
    lines = [f"    {name}: {_difference(first.get(name), second.get(name))}" for name in names[:_MAX_NAMED_FILES]]
    if not names:
        return ["    the same files with the same content, dates and rights: stored differently"]
    return lines if len(names) <= _MAX_NAMED_FILES else [*lines, f"    and {len(names) - _MAX_NAMED_FILES} more"]


_Entry = tuple[str, int, int]  # content or target, mode, date


def _tree(folder: Path) -> dict[str, _Entry]:
    found = {}
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(parent) / name
            status = path.lstat()
            content = os.readlink(path) if path.is_symlink() else digest(path) if stat.S_ISREG(status.st_mode) else ""
            found[str(path.relative_to(folder))] = (content, status.st_mode, int(status.st_mtime))
    return found


def _difference(one: _Entry | None, other: _Entry | None) -> str:
    if one is None or other is None:
        return f"only in the {'second' if one is None else 'first'}"
    return "differs in " + " and ".join(
        what for what, a, b in zip(("content", "rights", "date"), one, other, strict=True) if a != b
    )
