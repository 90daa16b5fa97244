"""Real disks of the kernel, none of which may be erased by mistake: loop devices, and the disk that this computer runs from."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from radron.deploy.image import flash as flashing
from radron.deploy.image.errors import ImageError
from radron.deploy.image.flash import flash
from radron.deploy.image.layout import MIB, MIN_DISK_BYTES, Partition
from radron.deploy.image.target import find_target


def told(*command: str) -> str:
    """Output of a command; empty if it fails or is missing."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


@contextmanager
def loop_device(folder: Path, size: int, *options: str) -> Iterator[Path]:
    """A sparse file as a disk."""
    file = folder / "disk.img"
    with file.open("wb") as disk:
        disk.truncate(size)
    device = told("losetup", "--find", "--show", *options, str(file))
    if not device:
        pytest.skip("loop devices cannot be made here (as root, with losetup)")
    try:
        yield Path(device)
    finally:
        subprocess.run(["losetup", "--detach", device], check=True)


@contextmanager
def mounted(device: Path, place: Path) -> Iterator[None]:
    """With a file system on it, in use; read-only, since the kernel writes to a new ext4 by itself for a while."""
    place.mkdir()
    told("mkfs.ext4", "-q", "-F", str(device))
    if subprocess.run(["mount", "--options", "ro", str(device), str(place)], capture_output=True, check=False).returncode != 0:
        pytest.skip("nothing can be mounted here")
    try:
        yield
    finally:
        subprocess.run(["umount", str(place)], check=True)


def test_a_disk_that_is_large_enough_may_be_erased(tmp_path: Path) -> None:
    with loop_device(tmp_path, MIN_DISK_BYTES) as device:
        target = find_target(device, internal=False)
    assert target.described() == [f"{device}: no name, 4.4 GB, unknown bus, a file as a disk", "    no partitions"]


def test_one_that_is_too_small_or_write_protected_is_refused(tmp_path: Path) -> None:
    with loop_device(tmp_path, MIN_DISK_BYTES - 512) as device, pytest.raises(ImageError, match=r"is too small: 4\.4 GB"):
        find_target(device, internal=False)
    with loop_device(tmp_path, MIN_DISK_BYTES, "--read-only") as device, pytest.raises(ImageError, match="is write-protected"):
        find_target(device, internal=False)


def test_a_drive_without_a_disk_is_told() -> None:
    empty = [disk.parent for disk in Path("/sys/block").glob("loop*/size") if disk.read_text().strip() == "0"]
    devices = [Path("/dev", disk.name) for disk in sorted(empty, key=lambda disk: int(disk.name.removeprefix("loop")))]
    if not devices or not devices[-1].is_block_device():
        pytest.skip("no loop device is free here")
    with pytest.raises(ImageError, match=rf"^{devices[-1]}: there is no disk in it"):
        find_target(devices[-1], internal=False)


def test_a_mounted_disk_is_refused_and_not_written_even_if_it_is_mounted_after_the_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flashing, "CONFIG", Partition(2, "config", "", 2 * MIB, MIB))
    monkeypatch.setattr(flashing, "IMAGE_BYTES", 4 * MIB)
    image, config = tmp_path / "nuc.img", tmp_path / "config.fat"
    image.write_bytes(bytes(512) + b"EFI PART" + bytes(4 * MIB - 520))
    config.write_bytes(bytes(MIB))
    with loop_device(tmp_path, MIN_DISK_BYTES) as device, mounted(device, tmp_path / "mount"):
        with pytest.raises(ImageError, match=rf"is in use as {tmp_path}/mount; run `umount {device}`"):
            find_target(device, internal=True)
        before = device.open("rb").read(4 * MIB)
        with pytest.raises(ImageError, match=rf"^{device}: cannot be written: Device or resource busy$"):
            flash(image, config, device, lambda *_: None)
        assert device.open("rb").read(4 * MIB) == before


def test_the_disk_that_this_computer_runs_from_is_refused(tmp_path: Path) -> None:
    part = told("findmnt", "--noheadings", "--output", "SOURCE", "--target", "/")
    disk = told("lsblk", "--noheadings", "--paths", "--nodeps", "--output", "PKNAME", part) or part
    if not Path(disk).is_block_device() or told("lsblk", "-dno", "TYPE", disk) != "disk" or not os.access(disk, os.R_OK):
        pytest.skip("this computer runs from no disk that it can see")
    with pytest.raises(ImageError, match=rf"^{disk}: this computer runs from it \(.* is /.*\); give another disk$"):
        find_target(Path(disk), internal=True)
