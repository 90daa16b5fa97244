"""Which disks may be erased: decided from the output of ``lsblk``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from radron.deploy.image.errors import ImageError
from radron.deploy.image.layout import MIN_DISK_BYTES
from radron.deploy.image.target import Device, check_device, find_target

STICK: dict[str, Any] = {"name": "/dev/sdb", "type": "disk", "size": 32_000_000_000, "rm": True, "tran": "usb", "model": "Stick"}
PART: dict[str, Any] = {"name": "/dev/sdb1", "type": "part", "size": 31_000_000_000, "fstype": "vfat", "label": "PHOTOS"}


def device(**changes: Any) -> Device:
    return msgspec.convert(STICK | changes, Device)


def part(**changes: Any) -> dict[str, Any]:
    return PART | changes


def test_a_removable_disk_may_be_erased_and_what_is_on_it_is_shown() -> None:
    target = check_device(Path("/dev/sdb"), device(children=[PART]), internal=False)
    assert target.described() == ["/dev/sdb: Stick, 32.0 GB, usb, removable", "    /dev/sdb1: 31.0 GB, vfat, PHOTOS"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"type": "part"}, r"/dev/sdb: is a part, not a whole disk"),
        ({"children": [part(mountpoints=[None, "/media/anna/PHOTOS"])]}, r"/dev/sdb1 is in use as /media.*`umount /dev/sdb1`"),
        ({"children": [part(mountpoints=["[SWAP]"])]}, r"`swapoff /dev/sdb1`"),
        ({"children": [part(mountpoints=["/"])]}, r"this computer runs from it \(/dev/sdb1 is /\)"),
        ({"children": [part(children=[part(name="/dev/dm-0", type="crypt", mountpoints=["/"])])]}, r"this computer runs from it"),
        ({"children": [part(children=[part(name="/dev/dm-0", type="lvm")])]}, r"/dev/dm-0 \(lvm\) is active on it"),
        ({"ro": True}, r"is write-protected"),
        ({"rm": False, "tran": "nvme"}, r"is built into this computer.*add --internal"),
        ({"size": 0}, r"/dev/sdb: there is no disk in it"),
        ({"size": MIN_DISK_BYTES - 1}, r"is too small: 4.4 GB; a drone needs 4.4 GB"),
    ],
)
def test_any_other_disk_is_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ImageError, match=message) as caught:
        check_device(Path("/dev/sdb"), device(**changes), internal=False)
    assert "\n" not in str(caught.value)


def test_a_disk_in_a_usb_case_is_removable_although_its_medium_is_not() -> None:
    check_device(Path("/dev/sdb"), device(rm=False), internal=False)


def test_a_built_in_disk_is_erased_only_on_request_and_is_shown_as_one() -> None:
    target = check_device(Path("/dev/sdb"), device(rm=False, tran="nvme"), internal=True)
    assert "BUILT INTO THIS COMPUTER" in target.described()[0]


def test_a_loop_device_is_shown_as_one() -> None:
    assert "a file as a disk" in check_device(Path("/dev/loop0"), device(type="loop", rm=False, tran=None), False).described()[0]


def test_a_disk_without_permission_is_refused() -> None:
    with pytest.raises(ImageError, match=r"no permission to write; run this with sudo"):
        check_device(Path("/dev/sdb"), device(), internal=False, writable=False)


def test_a_file_must_exist_and_be_large_enough(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"No such file or directory; `lsblk` lists"):
        find_target(tmp_path / "sdx", internal=False)
    with pytest.raises(ImageError, match=r"neither a disk nor a file"):
        find_target(tmp_path, internal=False)
    file = tmp_path / "disk"
    file.touch()
    with pytest.raises(ImageError, match=r"is too small"):
        find_target(file, internal=False)
    with file.open("wb") as disk:
        disk.truncate(MIN_DISK_BYTES)
    assert find_target(file, internal=False).size == MIN_DISK_BYTES
