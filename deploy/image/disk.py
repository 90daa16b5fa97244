"""Assembly of the disk image from a partition table and the contents of the partitions."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from radron.deploy.image.errors import ImageError
from radron.deploy.image.layout import DISK_GUID, IMAGE_BYTES, MIB, PARTITIONS, Partition
from radron.deploy.image.tools import run


def make_disk(file: Path, contents: dict[Partition, Path]) -> None:
    """Write a disk image with a partition table and the given contents of the partitions, and zeros elsewhere.

    The file is sparse (zeros take no space).

    Raises:
        ImageError: the content of a partition is too large.
    """
    for partition, content in contents.items():
        size = content.stat().st_size
        if size > partition.size:
            raise ImageError(f"{partition.name}: {size / MIB:.0f} MiB do not fit into its {partition.size / MIB:.0f} MiB")
    with file.open("wb") as disk:
        disk.truncate(IMAGE_BYTES)
    table = ["sgdisk", "--disk-guid", DISK_GUID]
    for part in PARTITIONS:
        number, sectors = str(part.number), (part.start // 512, (part.start + part.size) // 512 - 1)
        table += ["--new", f"{number}:{sectors[0]}:{sectors[1]}", "--typecode", f"{number}:{part.kind}"]
        table += ["--change-name", f"{number}:{part.name}", "--partition-guid", f"{number}:{part.guid}"]
    run([*table, str(file)])
    with file.open("r+b") as disk:
        for partition, content in contents.items():
            disk.seek(partition.start)
            _copy_sparse(content, disk)


def _copy_sparse(content: Path, disk: BinaryIO) -> None:
    with content.open("rb") as source:
        while block := source.read(MIB):
            if block.count(0) == len(block):
                disk.seek(len(block), 1)
            else:
                disk.write(block)
