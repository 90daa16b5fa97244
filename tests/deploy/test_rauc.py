"""The real RAUC, with our boot loader backend: a bundle is written to the slot that does not run, and that slot comes first."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from radron.agent.update.errors import UpdateError
from radron.agent.update.install import Updater, run_told
from radron.deploy.pki.authority import PkiFolder
from radron.protocol.identity import Role
from support.computers.onboard import NEW, OLD, OnboardFiles, well

LACKING = [name for name in ("rauc", "dbus-daemon", "mksquashfs") if shutil.which(name) is None]
BUS = """<busconfig><type>system</type><listen>unix:path={folder}/bus</listen><auth>EXTERNAL</auth>
<policy context="default"><allow send_destination="*" eavesdrop="true"/><allow eavesdrop="true"/><allow own="*"/><allow user="*"/>
</policy></busconfig>"""
SETTINGS = """[system]
compatible=radron-nuc
bootloader=custom
statusfile={folder}/status
mountprefix={folder}/mnt
[handlers]
bootloader-custom-backend={folder}/bootloader
[keyring]
path={folder}/pki/ca.pem
check-purpose=codesign
[slot.rootfs.0]
device={folder}/root-a
type=raw
bootname=A
[slot.rootfs.1]
device={folder}/root-b
type=raw
bootname=B
"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(LACKING), reason=f"not installed: {', '.join(LACKING)} (apt-get install rauc dbus squashfs-tools)"),
    pytest.mark.skipif(os.geteuid() != 0 or not Path("/dev/loop-control").exists(), reason="RAUC mounts bundles: needs root"),
]


class Rauc:
    """RAUC's service on a bus of its own; the slots are files."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.files = folder, OnboardFiles(folder / "computer")
        self.files.boot()
        for name in ("root-a", "root-b"):
            with (folder / name).open("wb") as slot:
                slot.truncate(4 << 20)
        pki = PkiFolder(folder / "pki")
        pki.init("radron", lambda: "four quite ordinary words", time.time_ns())
        pki.issue("builder", Role.RELEASE, None, folder / "builder", lambda: "four quite ordinary words", time.time_ns())
        code = "from pathlib import Path; import sys; from radron.agent.update.slots import Slots; "
        code += f"print(Slots(Path({str(self.files.grubenv)!r}), Path({str(self.files.cmdline)!r})).answer(*sys.argv[1:]))"
        (folder / "bootloader").write_text(f'#!/bin/sh\nexec {sys.executable} -c {shlex.quote(code)} "$@"\n')
        (folder / "bootloader").chmod(0o755)
        (folder / "bus.conf").write_text(BUS.format(folder=folder))
        self.settings = folder / "system.conf"
        self.settings.write_text(SETTINGS.format(folder=folder))
        (folder / "mnt").mkdir()
        self.environment = {**os.environ, "DBUS_SYSTEM_BUS_ADDRESS": f"unix:path={folder}/bus"}
        self._processes = [self._start("dbus-daemon", f"--config-file={folder}/bus.conf", "--nofork", "--nopidfile")]
        wait_until((folder / "bus").exists)
        self._processes.append(self._start("rauc", f"--conf={self.settings}", "--override-boot-slot=A", "service"))
        owned = [
            "dbus-send",
            "--system",
            "--print-reply",
            "--dest=org.freedesktop.DBus",
            "/",
            "org.freedesktop.DBus.GetNameOwner",
        ]
        wait_until(lambda: self._quiet([*owned, "string:de.pengutronix.rauc"]) == 0)

    def _start(self, *command: str) -> subprocess.Popen[bytes]:
        with (self.folder / f"{command[0]}.log").open("wb") as log:
            return subprocess.Popen(command, env=self.environment, stdout=log, stderr=log)

    def _quiet(self, command: list[str]) -> int:
        return subprocess.run(command, env=self.environment, capture_output=True, check=False).returncode

    def bundle(self, padding: int) -> Path:
        """A small bundle. Not of the verity format: that needs a module that the kernel of a container's host may lack."""
        content, tree, out = self.folder / "content", self.folder / "tree", self.folder / "new.raucb"
        tree.mkdir()
        (tree / "file").write_bytes(os.urandom(padding))
        content.mkdir()
        subprocess.run(["mksquashfs", str(tree), str(content / "root.squashfs"), "-quiet", "-no-progress"], check=True)
        update = f"[update]\ncompatible=radron-nuc\nversion={NEW.version}\nbuild={NEW.build}\n\n"
        (content / "manifest.raucm").write_text(update + "[image.rootfs]\nfilename=root.squashfs\n")
        signer = [f"--cert={self.folder}/builder/certificate.pem", f"--key={self.folder}/builder/key.pem"]
        subprocess.run(["rauc", *signer, "bundle", str(content), str(out)], check=True, capture_output=True)
        return out

    @property
    def updater(self) -> Updater:
        slots, records = self.files.slots, self.files.records
        return Updater(slots, records, OLD, well, lambda: None, lambda text: None, time.time_ns, self._run)

    def _run(self, command: list[str], tell: Callable[[str], None]) -> tuple[int, list[str]]:
        where = [f"DBUS_SYSTEM_BUS_ADDRESS={self.environment['DBUS_SYSTEM_BUS_ADDRESS']}"]
        inspects = [f"--conf={self.settings}"] if command[1] == "info" else []
        return run_told(["env", *where, command[0], *inspects, *command[1:]], tell)

    def close(self) -> None:
        for process in reversed(self._processes):
            process.terminate()
            process.wait()


@pytest.fixture
def rauc(tmp_path: Path) -> Iterator[Rauc]:
    made = Rauc(tmp_path)
    yield made
    made.close()


def test_rauc_writes_the_other_slot_and_puts_it_first(rauc: Rauc) -> None:
    bundle = rauc.bundle(100_000)
    rauc.updater.install(bundle)
    written = (rauc.folder / "content/root.squashfs").read_bytes()
    assert (rauc.folder / "root-b").read_bytes()[: len(written)] == written
    assert not any((rauc.folder / "root-a").read_bytes())
    assert (rauc.files.slots.primary, rauc.files.slots.attempts("B")) == ("B", 0)
    assert rauc.files.boot() == "B"


def test_a_slot_that_cannot_be_written_leaves_the_one_in_service_first(rauc: Rauc) -> None:
    (rauc.folder / "root-b").unlink()  # as a disk that lacks the partition
    with pytest.raises(UpdateError, match=r"new.raucb: not installed: .*root-b.*; slot A stays in service"):
        rauc.updater.install(rauc.bundle(100_000))
    assert rauc.files.slots.primary == "A"
    assert rauc.files.records.trial is None
    assert rauc.files.boot() == "A"


def wait_until(done: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 30.0
    while not done():
        assert time.monotonic() < deadline_s
        time.sleep(0.05)
