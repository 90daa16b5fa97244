"""A virtual computer with UEFI that boots a disk, without hardware support; its serial line is a file."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http.client import HTTPException
from pathlib import Path
from tempfile import gettempdir
from urllib.request import urlopen

from radron.deploy.image.build import PROGRAMS
from radron.deploy.image.errors import ImageError
from radron.deploy.image.rootfs import MIRROR, SUITE
from radron.deploy.image.tools import need

_FIRMWARE = Path("/usr/share/OVMF")
CODE, VARIABLES = _FIRMWARE / "OVMF_CODE_4M.fd", _FIRMWARE / "OVMF_VARS_4M.fd"
_NEEDED, _PACKAGES = ("qemu-system-x86_64", "rauc"), "qemu-system-x86 ovmf rauc"


def lacking() -> str | None:
    """Tools that this computer lacks to build and boot an image; None: nothing."""
    try:
        need(*PROGRAMS)
    except ImageError as error:
        return str(error)
    missing = [name for name in _NEEDED if shutil.which(name, path="/usr/sbin:/usr/bin:/sbin:/bin") is None]
    missing += [str(file) for file in (CODE, VARIABLES) if not file.exists()]
    return f"missing: {', '.join(missing)} (apt-get install {_PACKAGES})" if missing else None


def too_little_room() -> str | None:
    """That there is too little room for an image, a disk and kept states of a computer; None: there is enough."""
    free_gb = shutil.disk_usage(gettempdir()).free / 1e9
    return f"{gettempdir()}: {free_gb:.0f} GB free of the 20 GB that it needs" if free_gb < 20.0 else None


def no_archive() -> str | None:
    """Why Debian's packages cannot be fetched; None: they can."""
    try:
        urlopen(f"{MIRROR}/dists/{SUITE}/InRelease", timeout=30.0).close()
    except (OSError, HTTPException) as error:
        return f"{MIRROR} is not reached: {error}"
    return None


class Machine:
    """A computer, switched on.

    ``drive``: a file or what else QEMU takes for a disk; ``ports``: of the host, forwarded to ports of the guest ("tcp:7447");
    ``clock``: what its clock shows then, ``utc`` or such as ``2021-03-04T05:06:07``; ``state``: where ``saved`` has kept a
    running computer, which goes on; ``line``: a port of the host that is the far end of the line of a USB serial adapter.
    """

    def __init__(
        self,
        folder: Path,
        drive: Path | str,
        ports: Mapping[int, str],
        clock: str = "utc",
        state: Path | None = None,
        line: int | None = None,
    ) -> None:
        self.serial, self._control = folder / "serial.log", folder / "qmp"
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
            "qmp": f"unix:{self._control},server=on,wait=off",
            "device": "i6300esb",  # a hardware watchdog; the chipset's own does not reset the computer by default
            "global": "ICH9-LPC.noreboot=off",
            "action": "watchdog=reset",
            "nic": "user,model=virtio-net-pci" + "".join(forwards),
        }
        if state is not None:
            options["incoming"] = f"exec:cat {shlex.quote(str(state))}"
        drives = (f"if=pflash,readonly=on,file={CODE}", f"if=pflash,file={variables}", f"if=virtio,file={drive}")
        command = ["qemu-system-x86_64", *(part for name, value in options.items() for part in (f"-{name}", value))]
        if line is not None:
            command += ["-chardev", f"socket,id=line,host=127.0.0.1,port={line},nodelay=on"]
            command += ["-device", "qemu-xhci", "-device", "usb-serial,chardev=line"]
        self._process = subprocess.Popen(
            [*command, *(part for drive in drives for part in ("-drive", f"format=raw,{drive}"))],
            stdin=subprocess.DEVNULL,
            stdout=(folder / "qemu.log").open("ab"),
            stderr=subprocess.STDOUT,
        )
        if state is not None:
            self._migrated()
            self._tell("cont")

    @contextmanager
    def saved(self, state: Path) -> Iterator[Path]:
        """Stop for the block, with all but the disk's content kept in a file."""
        self._tell("stop")
        self._tell("migrate-set-parameters", {"max-bandwidth": 1 << 40})
        self._tell("migrate", {"uri": f"exec:cat > {shlex.quote(str(state))}"})
        self._migrated()
        yield state
        self._tell("cont")

    def _migrated(self, timeout_s: float = 120.0) -> None:
        deadline_s = time.monotonic() + timeout_s
        while (status := self._tell("query-migrate").get("status")) != "completed":
            assert status != "failed", self._tell("query-migrate")
            assert time.monotonic() < deadline_s, status
            time.sleep(0.1)

    def _tell(self, command: str, arguments: Mapping[str, object] | None = None, timeout_s: float = 30.0) -> dict[str, object]:
        """A command for QEMU itself, by its machine protocol; returns its answer."""
        with socket.socket(socket.AF_UNIX) as line:
            line.settimeout(timeout_s)
            deadline_s = time.monotonic() + timeout_s
            while line.connect_ex(str(self._control)) != 0:
                assert self._process.poll() is None, "qemu has ended"
                assert time.monotonic() < deadline_s, "qemu does not listen"
                time.sleep(0.05)
            with line.makefile("rw") as stream:
                stream.readline()  # its greeting
                for name, given in (("qmp_capabilities", {}), (command, arguments or {})):
                    stream.write(json.dumps({"execute": name, "arguments": given}) + "\n")
                    stream.flush()
                    answer: dict[str, dict[str, object]] = {}
                    while not {"return", "error"} & answer.keys():
                        answer = json.loads(stream.readline())
                    assert "return" in answer, answer
        return answer["return"]

    @property
    def text(self) -> str:
        """Output of the serial line so far."""
        return self.serial.read_text(errors="replace") if self.serial.exists() else ""

    def wait_for(self, pattern: str, timeout_s: float) -> re.Match[str]:
        """Wait until the serial line has said this; fails with its last lines otherwise."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            text = self.text
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


if __name__ == "__main__":
    reason = lacking() or too_little_room() or no_archive()
    if reason is not None:
        print(reason)
        sys.exit(77)
