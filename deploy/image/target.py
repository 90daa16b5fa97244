"""Checks of the disk to be overwritten, by ``lsblk``: its type, its content and the permission to erase it."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

import msgspec

from radron.deploy.image.errors import ImageError
from radron.deploy.image.layout import MIN_DISK_BYTES
from radron.deploy.image.tools import need, run

GB = 1e9


class Device(msgspec.Struct, frozen=True, kw_only=True):
    """A disk or a partition, as ``lsblk --json --bytes --paths`` describes it.

    ``ro``: read-only. ``rm``: removable. ``tran``: bus, such as ``usb``. ``children``: partitions of a disk.
    """

    name: str
    type: str
    size: int
    ro: bool = False
    rm: bool = False
    tran: str | None = None
    model: str | None = None
    serial: str | None = None
    fstype: str | None = None
    label: str | None = None
    partlabel: str | None = None
    mountpoints: list[str | None] = []
    children: list[Device] = []

    @property
    def all(self) -> list[Device]:
        """This device, its partitions, and the volumes in the partitions."""
        return [self, *(one for child in self.children for one in child.all)]

    @property
    def is_removable(self) -> bool:
        """Whether the device is not part of this computer: a stick, a card, or a disk in a USB case."""
        return self.rm or self.tran == "usb"


class _Listing(msgspec.Struct, frozen=True):
    blockdevices: list[Device]


@dataclass(frozen=True, slots=True)
class Target:
    """A disk or file to which an image will be written. ``size``: bytes. ``device``: None for a file."""

    path: Path
    size: int
    device: Device | None

    def described(self) -> list[str]:
        """Return a description of the disk to be erased: one line for the disk, and one for each partition."""
        if self.device is None:
            return [f"{self.path}: a file of {self.size / GB:.1f} GB"]
        disk = self.device
        named = " ".join(part.strip() for part in (disk.model, disk.serial) if part) or "no name"
        kind = "removable" if disk.is_removable else "a file as a disk" if disk.type == "loop" else "BUILT INTO THIS COMPUTER"
        lines = [f"{disk.name}: {named}, {disk.size / GB:.1f} GB, {disk.tran or 'unknown bus'}, {kind}"]
        for part in disk.all[1:]:
            what = ", ".join(text for text in (part.fstype, part.label, part.partlabel) if text) or "unknown content"
            lines.append(f"    {part.name}: {part.size / GB:.1f} GB, {what}")
        return lines if disk.children else [*lines, "    no partitions"]


def find_target(path: Path, internal: bool) -> Target:
    """Find the disk at a path, and check that it may be overwritten.

    Args:
        path: a block device, or a plain file of the size of a disk.
        internal: accept also disks that are not removable.

    Raises:
        ImageError: no whole disk, too small, read-only, in use, or built into this computer and not ``internal``.
    """
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise ImageError(f"{path}: {error.strerror}; `lsblk` lists this computer's disks") from None
    if stat.S_ISREG(mode):
        return _large_enough(Target(path, path.stat().st_size, None))
    if not stat.S_ISBLK(mode):
        raise ImageError(f"{path}: is neither a disk nor a file; `lsblk` lists this computer's disks")
    need("lsblk")
    columns = "NAME,TYPE,SIZE,RO,RM,TRAN,MODEL,SERIAL,FSTYPE,LABEL,PARTLABEL,MOUNTPOINTS"
    if _is_without_medium(path.resolve()):  # lsblk does not list such drives
        raise _empty(path)
    listed = run(["lsblk", "--json", "--bytes", "--paths", "--output", columns, str(path.resolve())])
    device = msgspec.json.decode(listed, type=_Listing).blockdevices[0]
    return check_device(path, device, internal, os.access(path, os.W_OK))


def check_device(path: Path, device: Device, internal: bool, writable: bool = True) -> Target:
    """Check that a device listed by ``lsblk`` may be overwritten, and return it as the target.

    ``internal``: accept also a disk that is not removable. Raises ImageError as :func:`find_target`.
    """
    if device.size == 0:
        raise _empty(path)
    if device.type not in ("disk", "loop"):
        raise ImageError(f"{path}: is a {device.type}, not a whole disk; give the disk that it is on")
    used = [(one.name, place) for one in device.all for place in one.mountpoints if place is not None]
    for name, place in used:
        if place == "/" or place.startswith(("/boot", "/usr", "/efi")):
            raise ImageError(f"{path}: this computer runs from it ({name} is {place}); give another disk")
    if used:
        name, place = used[0]
        what = f"`swapoff {name}`" if place == "[SWAP]" else f"`umount {name}`"
        raise ImageError(f"{path}: {name} is in use as {place}; run {what} if nobody needs it")
    volumes = [one for one in device.all if one.type not in ("disk", "part", "loop")]
    if volumes:
        raise ImageError(f"{path}: {volumes[0].name} ({volumes[0].type}) is active on it; close that first")
    if device.ro:
        raise ImageError(f"{path}: is write-protected; look for a switch on it")
    if not writable:
        raise ImageError(f"{path}: no permission to write; run this with sudo")
    if not device.is_removable and device.type != "loop" and not internal:
        raise ImageError(f"{path}: is built into this computer, not a removable disk; if you mean it, add --internal")
    return _large_enough(Target(path, device.size, device))


def _is_without_medium(device: Path) -> bool:
    """Whether the device is a drive without a disk in it, such as an empty card reader."""
    try:
        return int(Path("/sys/class/block", device.name, "size").read_text()) == 0
    except OSError:
        return False


def _empty(path: Path) -> ImageError:
    return ImageError(f"{path}: there is no disk in it: put one in, or give another one; `lsblk` lists this computer's disks")


def _large_enough(target: Target) -> Target:
    if target.size < MIN_DISK_BYTES:
        raise ImageError(
            f"{target.path}: is too small: {target.size / GB:.1f} GB; a drone needs {MIN_DISK_BYTES / GB:.1f} GB, better 32 GB"
        )
    return target
