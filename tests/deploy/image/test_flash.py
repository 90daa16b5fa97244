"""Writing to a disk, here a sparse file: its content afterwards, also after an interruption or a write error."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from radron.deploy.image import flash as flashing
from radron.deploy.image.errors import ImageError
from radron.deploy.image.flash import flash
from radron.deploy.image.layout import MIB, Partition

# A small layout, so that the tests take no time.
ESP, CONFIG, ROOT = (Partition(i, name, "", (1 + 8 * i) * MIB, 8 * MIB) for i, name in enumerate(("esp", "config", "root-a")))
IMAGE_BYTES, DISK_BYTES = 26 * MIB, 40 * MIB


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flashing, "CONFIG", CONFIG)
    monkeypatch.setattr(flashing, "IMAGE_BYTES", IMAGE_BYTES)


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """Like an image where it matters: a signature, and something in each partition."""
    file = tmp_path / "nuc.img"
    with file.open("wb") as disk:
        disk.truncate(IMAGE_BYTES)
        for start, data in ((512, b"EFI PART"), (ESP.start, b"esp"), (CONFIG.start, b"empty"), (ROOT.start + 5 * MIB, b"root")):
            disk.seek(start)
            disk.write(data)
    return file


@pytest.fixture
def config(tmp_path: Path) -> Path:
    file = tmp_path / "config.fat"
    with file.open("wb") as part:
        part.truncate(CONFIG.size)
        part.write(b"drone d2")
        part.seek(CONFIG.size - 3)
        part.write(b"end")
    return file


@pytest.fixture
def disk(tmp_path: Path) -> Path:
    """A disk that was in use before: garbage at its beginning, and where the partitions will be."""
    file = tmp_path / "disk"
    with file.open("wb") as old:
        old.truncate(DISK_BYTES)
        old.write(b"x" * 2 * MIB)
        old.seek(ROOT.start)
        old.write(b"y" * MIB)
    return file


def at(file: Path, start: int, length: int) -> bytes:
    with file.open("rb") as stream:
        stream.seek(start)
        return stream.read(length)


def nothing(what: str, done: int, total: int) -> None:
    """A progress bar that shows nothing."""


def test_the_disk_is_the_image_with_the_drones_partition_in_it(image: Path, config: Path, disk: Path) -> None:
    seen: list[tuple[str, int, int]] = []
    flash(image, config, disk, lambda *progress: seen.append(progress))
    assert at(disk, 0, CONFIG.start) == at(image, 0, CONFIG.start)
    assert at(disk, CONFIG.start, CONFIG.size) == config.read_bytes()
    rest = CONFIG.start + CONFIG.size
    digests = [hashlib.sha256(at(file, rest, IMAGE_BYTES - rest)).digest() for file in (disk, image)]
    assert digests[0] == digests[1]
    assert [what for what, done, total in seen if done == total] == ["writing", "verifying"]
    assert disk.stat().st_size == DISK_BYTES


def test_an_interrupted_disk_has_no_partitions_and_can_be_begun_again(image: Path, config: Path, disk: Path) -> None:
    def interrupt(what: str, done: int, total: int) -> None:
        if done > total // 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        flash(image, config, disk, interrupt)
    assert at(disk, 0, MIB) == bytes(MIB)
    assert at(disk, ESP.start, 3) == b"esp"
    flash(image, config, disk, nothing)
    assert at(disk, 512, 8) == b"EFI PART"


def test_a_disk_that_does_not_keep_what_was_written_is_found_out(
    image: Path, config: Path, disk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forgetful(what: str, done: int, total: int) -> None:
        if what == "verifying" and done <= ROOT.start:
            with disk.open("r+b") as broken:
                broken.seek(ROOT.start + 5 * MIB)
                broken.write(b"r00t")

    with pytest.raises(ImageError, match=r"disk: does not hold what was written at \d+ MiB: it is broken"):
        flash(image, config, disk, forgetful)
    assert at(disk, 0, MIB) == bytes(MIB)


def test_a_write_error_is_one_line_that_says_where(
    image: Path, config: Path, disk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.write

    def failing(descriptor: int, data: bytes) -> int:
        if os.lseek(descriptor, 0, os.SEEK_CUR) > 10 * MIB:
            raise OSError(5, "Input/output error")
        return real(descriptor, data)

    monkeypatch.setattr(flashing.os, "write", failing)
    with pytest.raises(ImageError, match=r"disk: cannot be written at 13 MiB: Input/output error; run this again"):
        flash(image, config, disk, nothing)


@pytest.mark.parametrize("damage", ["cut off", "no table"])
def test_what_is_no_image_is_refused_before_anything_is_written(image: Path, config: Path, disk: Path, damage: str) -> None:
    with image.open("r+b") as broken:
        if damage == "cut off":
            broken.truncate(IMAGE_BYTES - MIB)
        else:
            broken.write(bytes(MIB))
    with pytest.raises(ImageError, match=r"nuc.img: is no image of this release, or not all of one"):
        flash(image, config, disk, nothing)
    assert at(disk, 0, MIB) == b"x" * MIB
