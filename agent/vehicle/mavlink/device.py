"""The serial device of an autopilot's link: whether it is there, and may be opened."""

from __future__ import annotations

import os
import re
from pathlib import Path

from radron.agent.errors import VehicleError

_SERIAL = re.compile(r"serial(?:_flowcontrol)?://(?P<device>[^:]+)(?::\d+)?$")
_USUAL = ("ttyACM*", "ttyUSB*", "ttyTHS*", "ttyAMA*")


def check_device(address: str) -> None:
    """Check that the serial device of an address exists and can be opened; addresses of other kinds pass.

    MAVSDK reports of any failure only that the connection failed.

    Raises:
        VehicleError: the device is missing, is no serial device, or access is not permitted.
    """
    match = _SERIAL.match(address)
    if match is None:
        return
    device = Path(match["device"])
    if not device.exists():
        found = sorted(str(path) for pattern in _USUAL for path in Path("/dev").glob(pattern))
        there = f"here are {', '.join(found)}" if found else "no serial device is connected to this computer"
        raise VehicleError(f"{address}: there is no device {device}; {there}")
    if not device.is_char_device():
        raise VehicleError(f"{address}: {device} is no serial device")
    if not os.access(device, os.R_OK | os.W_OK):
        if is_new(device.stat().st_rdev):
            raise VehicleError(f"{address}: {device} has just been plugged in, and is being set up")
        group = _group(device)
        hint = f"add this user to the group {group} (`sudo usermod -aG {group} $USER`), and log in again"
        if group == "root":
            hint = "it belongs to root alone: give it to a group, such as dialout, by a udev rule"
        raise VehicleError(f"{address}: no permission to open {device}; {hint}")


def is_new(number: int, root: Path = Path("/")) -> bool:
    """Whether the operating system (udev) has not yet set the group and mode of a device that was just connected.

    Afterwards its database has a note of the device.

    Args:
        number: of the device, as in ``st_rdev``.
        root: of the file system.
    """
    name = f"{os.major(number)}:{os.minor(number)}"
    is_udevs = (root / "run/udev/control").exists() and (root / "sys/dev/char" / name).exists()
    return is_udevs and not (root / "run/udev/data" / f"c{name}").exists()


def _group(device: Path) -> str:
    try:
        return device.group()
    except KeyError:
        return str(device.stat().st_gid)
