"""Writing of an image to a drone's disk, together with the drone's configuration partition, and verification of the disk.

The first MiB, which holds the partition table, is cleared first and written last. An incompletely written disk therefore has no
partitions: no computer starts from it, and it cannot be mistaken for a drone's disk.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from radron.deploy.image.errors import ImageError
from radron.deploy.image.layout import CONFIG, IMAGE_BYTES, MIB

_BLOCK = 4 * MIB
_REREAD = 0x125F  # BLKRRPART
Progress = Callable[[str, int, int], None]  # present step, bytes done, bytes in all


def flash(image: Path, config: Path, target: Path, progress: Progress) -> None:
    """Write a disk image and a drone's configuration partition to a disk, and verify every byte.

    ``config``: file with the configuration partition. ``target``: the disk; its content is lost. ``progress``: called with the
    present step, the bytes done and all bytes.

    Raises:
        ImageError: not an image of this release; the disk cannot be written, or reads back different bytes.
    """
    check_image(image)
    with _composed(image, config) as source, _opened(target) as disk:
        _put(disk, target, 0, bytes(MIB))
        os.fsync(disk.fileno())
        _write(source, disk, target, progress)
        _verify(source, disk, target, progress)
        head = source(0, MIB)
        _put(disk, target, 0, head)
        os.fsync(disk.fileno())
        _forget_cached(disk)
        if _get(disk, target, 0, MIB) != head:
            raise ImageError(f"{target}: does not hold what was written: the disk is broken; take another one")
    _reread_partitions(target)


def check_image(image: Path) -> None:
    """Check by size and partition table that a file is a complete image of this release.

    Raises:
        ImageError: the file is no such image, or is truncated.
    """
    try:
        size = image.stat().st_size
        with image.open("rb") as file:
            file.seek(512)
            signature = file.read(8)
    except OSError as error:
        raise ImageError(f"{image}: cannot be read: {error.strerror}") from None
    if signature != b"EFI PART" or size != IMAGE_BYTES:
        raise ImageError(f"{image}: is no image of this release, or not all of one; make it with `radron-deploy image build`")


@contextmanager
def _composed(image: Path, config: Path) -> Iterator[Callable[[int, int], bytes]]:
    """Yield a reader of the image's bytes, ``read(start, length)``, with the drone's config partition in its place."""
    with image.open("rb") as whole, config.open("rb") as part:

        def read(start: int, length: int) -> bytes:
            whole.seek(start)
            data = bytearray(whole.read(length))
            first, end = max(start, CONFIG.start), min(start + length, CONFIG.start + CONFIG.size)
            if first < end:
                part.seek(first - CONFIG.start)
                data[first - start : end - start] = part.read(end - first)
            return bytes(data)

        yield read


@contextmanager
def _opened(target: Path) -> Iterator[BinaryIO]:
    """Open the disk exclusively: the kernel refuses a disk with a mounted partition."""
    try:
        exclusive = os.O_EXCL if target.is_block_device() else 0
        descriptor = os.open(target, os.O_RDWR | exclusive | os.O_CLOEXEC)
    except OSError as error:
        raise ImageError(f"{target}: cannot be written: {error.strerror}") from None
    with os.fdopen(descriptor, "r+b", buffering=0) as disk:
        yield disk


def _write(source: Callable[[int, int], bytes], disk: BinaryIO, target: Path, progress: Progress) -> None:
    for start in range(MIB, IMAGE_BYTES, _BLOCK):
        progress("writing", start, IMAGE_BYTES)
        _put(disk, target, start, source(start, min(_BLOCK, IMAGE_BYTES - start)))
        if start // _BLOCK % 16 == 0:
            os.fsync(disk.fileno())  # the progress counts bytes on the disk, not in memory
    progress("writing", IMAGE_BYTES, IMAGE_BYTES)
    os.fsync(disk.fileno())
    _forget_cached(disk)


def _verify(source: Callable[[int, int], bytes], disk: BinaryIO, target: Path, progress: Progress) -> None:
    for start in range(MIB, IMAGE_BYTES, _BLOCK):
        progress("verifying", start, IMAGE_BYTES)
        length = min(_BLOCK, IMAGE_BYTES - start)
        if _get(disk, target, start, length) != source(start, length):
            raise ImageError(f"{target}: does not hold what was written at {start / MIB:.0f} MiB: it is broken; take another one")
    progress("verifying", IMAGE_BYTES, IMAGE_BYTES)


def _put(disk: BinaryIO, target: Path, start: int, data: bytes) -> None:
    try:
        os.lseek(disk.fileno(), start, os.SEEK_SET)
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(disk.fileno(), rest) :]
    except OSError as error:
        raise ImageError(f"{target}: cannot be written at {start / MIB:.0f} MiB: {error.strerror}; run this again") from None


def _get(disk: BinaryIO, target: Path, start: int, length: int) -> bytes:
    parts: list[bytes] = []
    try:
        os.lseek(disk.fileno(), start, os.SEEK_SET)
        while length > 0 and (part := os.read(disk.fileno(), length)):
            parts.append(part)
            length -= len(part)
    except OSError as error:
        raise ImageError(f"{target}: cannot be read at {start / MIB:.0f} MiB: {error.strerror}; take another disk") from None
    return b"".join(parts)


def _forget_cached(disk: BinaryIO) -> None:
    """Drop the cached pages, so that the next reads come from the disk itself."""
    with suppress(OSError):
        os.posix_fadvise(disk.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def _reread_partitions(target: Path) -> None:
    """Make the kernel read the new partition table; if this fails, the kernel reads it at the next insertion of the disk."""
    if target.is_block_device():
        with suppress(OSError), target.open("rb") as disk:
            fcntl.ioctl(disk, _REREAD)
