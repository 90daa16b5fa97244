"""A drone's computer for `make image-test`: updated once, and kept at moments of that, where runs with power cuts begin."""

from __future__ import annotations

import itertools
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from radron.deploy.image.layout import ESP, ROOT_A, ROOT_B
from support.computers.cutdisk import Content, CutDisk
from support.computers.dronedisk import BOOT_S, Drone
from support.computers.machine import Machine

ON_TRIAL = r"radron-update: slot B, .*, is on trial, attempt \d of 3"
PROVISIONED = r"radron-provision: this is radron-d1"
IN_MESH = r'"event": "mesh is up"'
UPDATED = r"radron-update: updated from .* to .*, slot B"
SETTLED = r"radron-settle.service: Deactivated successfully"
_HEAD = b"# GRUB Environment Block\n"


@dataclass(frozen=True, slots=True)
class Kept:
    """A computer to begin from: its disk, and the state of the running machine (None: it is off)."""

    content: Content
    state: Path | None = None


class Bench:
    """The drone, the bundle of its update, and its computer as it was at moments of the update (``kept``)."""

    def __init__(self, drone: Drone, image: Path, bundle: Path) -> None:
        self.drone, self.image, self.bundle = drone, image, bundle
        self.kept: dict[str, Kept] = {"flashed": Kept(Content())}
        self._on: Run | None = None
        with drone.disk.open("rb") as content:
            content.seek(ESP.start)
            found = content.read(ESP.size).index(_HEAD + b"ORDER=")
            content.seek(ROOT_A.start + 40)  # squashfs: bytes used
            self.root_bytes = int.from_bytes(content.read(8), "little")
        self.variables = range(ESP.start + found, ESP.start + found + 512)  # of the boot loader: where they are on the disk
        self.data = range(ROOT_B.start + ROOT_B.size + 1024, ROOT_B.start + ROOT_B.size + 2048)  # its superblock

    def run(self, name: str) -> Run:
        """A computer from a kept moment on; only one is on at a time."""
        self.close()
        folder = self.drone.folder / f"run-{len([*self.drone.folder.glob('run-*')]):02d}"
        folder.mkdir()
        self._on = Run(self, folder, self.kept[name])
        return self._on

    def close(self) -> None:
        """Switch off the running computer."""
        if self._on is not None:
            self._on.close()
            self._on = None


class Run:
    """A computer from a kept moment on, in a folder of its own, with a serial log for each power-on."""

    def __init__(self, bench: Bench, folder: Path, kept: Kept) -> None:
        self._bench, self._folder = bench, folder
        self._times = itertools.count()
        self._switch_on(kept)

    def _switch_on(self, kept: Kept) -> None:
        folder = self._folder / f"{next(self._times)}"
        folder.mkdir()
        self.disk = CutDisk(self._bench.drone.disk, folder / "disk.nbd", f"{self._folder.name}, {folder.name}", kept.content)
        self.machine: Machine = self._bench.drone.boot(folder, self.disk.drive, state=kept.state)

    def keep(self, name: str, content: Content | None = None) -> None:
        """Keep this moment under a name: the machine, which goes on; or only the content of a disk."""
        if content is not None:
            self._bench.kept[name] = Kept(content)
            return
        with self.machine.saved(self._folder / f"{name}.state") as state:
            self._bench.kept[name] = Kept(self.disk.content(), state)

    def cut(self) -> None:
        """Pull the plug."""
        self.disk.lose_power()
        self.machine.power_off()

    def cut_by_disk(self) -> None:
        """Wait until the disk loses its power."""
        assert self.disk.cut.wait(BOOT_S), self.machine.text[-2000:]
        self.machine.power_off()

    def again(self) -> None:
        """Switch on after a cut."""
        before = self.disk
        self._switch_on(Kept(before.content()))
        before.close()

    def boots(self) -> str:
        """Wait until the boot loader has chosen a slot, and return the slot."""
        return self.machine.wait_for(r"radron: booting slot ([AB]), attempt \d", BOOT_S)[1]

    def decides(self, told: str) -> str:
        """The slot that boots, at once; it becomes this drone, says what became of the update, and is confirmed."""
        slot = self.boots()
        for line in (PROVISIONED, told, SETTLED):
            self.machine.wait_for(line, BOOT_S)
        # GRUB says it on both of its consoles, and the firmware shows both on the serial line.
        assert len(set(re.findall(r"radron: booting slot \w, attempt \d", self.machine.text))) == 1
        now = self.variables()
        assert (now[f"{slot}_OK"], now[f"{slot}_TRY"]) == ("1", "0")
        assert now["ORDER"].startswith(slot)
        return slot

    def variables(self) -> dict[str, str]:
        """The boot loader's, as they are on the disk."""
        text = self.disk.read(self._bench.variables).decode("ascii").rstrip("#")
        return dict(line.split("=", 1) for line in text.splitlines()[1:])

    def close(self) -> None:
        """Switch off for good."""
        self.machine.power_off()
        self.disk.close()


class Push:
    """``radron-deploy push`` of a bundle; its output so far is ``said``. The push ends with the block."""

    def __init__(self, drone: Drone, bundle: Path) -> None:
        self._process, self.said = drone.push("--bundle", str(bundle)), ""
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def __enter__(self) -> Push:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self.ended()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.said += line

    def wait_for(self, text: str) -> None:
        """Wait until it says so."""
        until(lambda: text in self.said or self._process.poll() is not None, BOOT_S)
        assert text in self.said, self.said

    def ended(self) -> int:
        """Its exit code, once it has ended."""
        code = self._process.wait(BOOT_S)
        self._reader.join()
        return code


def until(met: Callable[[], bool], within_s: float) -> None:
    """Wait for a condition."""
    deadline_s = time.monotonic() + within_s
    while not met():
        assert time.monotonic() < deadline_s
        time.sleep(0.1)
