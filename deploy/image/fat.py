"""FAT file systems in files, by mtools: no mount, no root; equal content gives equal bytes."""

from __future__ import annotations

import zlib
from pathlib import Path

from radron.deploy.image.tools import run


def make_fat(file: Path, size: int, label: str, content: Path, epoch: int) -> None:
    """Make a FAT32 file system in ``file`` with the files of the folder ``content``.

    ``size``: bytes. ``label``: name of the file system. ``epoch``: date of the files, seconds since 1970.

    Raises:
        ImageError: the file system cannot be made, such as for lack of space in it.
    """
    with file.open("wb") as disk:
        disk.truncate(size)
    serial = f"{zlib.crc32(label.encode()):08x}"
    run(["mkfs.vfat", "-F", "32", "-s", "1", "-n", label.upper(), "-i", serial, "--invariant", str(file)])
    names = [str(path) for path in sorted(content.iterdir())]
    if names:
        dated = {"SOURCE_DATE_EPOCH": str(epoch), "MTOOLS_SKIP_CHECK": "1", "TZ": "UTC"}
        run(["mcopy", "-s", "-Q", "-o", "-i", str(file), *names, "::"], env=dated)
