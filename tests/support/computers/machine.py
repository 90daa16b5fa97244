"""A virtual computer with UEFI that boots a disk, without hardware support; its serial line is a file."""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path

_FIRMWARE = Path("/usr/share/OVMF")
CODE, VARIABLES = _FIRMWARE / "OVMF_CODE_4M.fd", _FIRMWARE / "OVMF_VARS_4M.fd"
NEEDED = ("qemu-system-x86_64", "mmdebstrap", "mksquashfs", "unsquashfs", "grub-mkimage", "sgdisk", "mkfs.vfat", "mcopy", "rauc")


def lacking() -> str | None:
    """What this computer lacks to build and boot an image; None: nothing."""
    missing = [name for name in NEEDED if shutil.which(name, path="/usr/sbin:/usr/bin:/sbin:/bin") is None]
    missing += [str(file) for file in (CODE, VARIABLES) if not file.exists()]
    boot, build = "qemu-system-x86 ovmf", "mmdebstrap squashfs-tools grub-common grub-efi-amd64-bin gdisk dosfstools mtools rauc"
    return f"missing: {', '.join(missing)} (apt-get install {boot} {build})" if missing else None


class Machine:
    """One computer, switched on. ``ports``: of the host, forwarded to ports of the guest ("tcp:7447"). ``clock``: what its clock
    shows then, ``utc`` or such as ``2021-03-04T05:06:07``.
    """

    def __init__(self, folder: Path, disk: Path, ports: Mapping[int, str], clock: str = "utc") -> None:
        self.serial = folder / "serial.log"
        variables = folder / "uefi.fd"
        if not variables.exists():
            shutil.copyfile(VARIABLES, variables)
        forwards = []
        for host, guest in ports.items():
            kind, port = guest.split(":")
            forwards.append(f",hostfwd={kind}:127.0.0.1:{host}-10.0.2.15:{port}")
        options = {
            "machine": "q35",
            "accel": "tcg",
            "cpu": "max",
            "smp": "2",
            "m": "2048",
            "uuid": "a1b2c3d4-0000-4000-8000-00000000d002",
            "rtc": f"base={clock}",
            "serial": f"file:{self.serial}",
            "display": "none",
            "monitor": "none",
            "device": "i6300esb",  # a hardware watchdog
            "action": "watchdog=reset",
            "nic": "user,model=virtio-net-pci" + "".join(forwards),
        }
        drives = (f"if=pflash,readonly=on,file={CODE}", f"if=pflash,file={variables}", f"if=virtio,file={disk}")
        command = ["qemu-system-x86_64", *(part for name, value in options.items() for part in (f"-{name}", value))]
        self._process = subprocess.Popen(
            [*command, *(part for drive in drives for part in ("-drive", f"format=raw,{drive}"))],
            stdin=subprocess.DEVNULL,
            stdout=(folder / "qemu.log").open("ab"),
            stderr=subprocess.STDOUT,
        )

    def wait_for(self, pattern: str, timeout_s: float) -> re.Match[str]:
        """Wait until the serial line has said this; fails with its last lines otherwise."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            text = self.serial.read_text(errors="replace") if self.serial.exists() else ""
            found = re.search(pattern, text)
            if found is not None:
                return found
            ended, late = self._process.poll() is not None, time.monotonic() > deadline_s
            if ended or late:
                tail = "\n".join(text.splitlines()[-40:])
                raise AssertionError(f"{pattern!r} not {'before qemu ended' if ended else f'within {timeout_s:g} s'}:\n{tail}")
            time.sleep(0.2)

    def power_off(self) -> None:
        """As by pulling the plug."""
        self._process.kill()
        self._process.wait()
