"""`make image-test`: updates of a drone's computer in QEMU, with power cuts, and with a release that does not work.

One computer goes through all of it, in this order: each boot takes a minute and more. Its agent waits for an autopilot that never
comes; what must answer after an update is what answered before.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from dronedisk import BOOT_S, ROOT, Drone
from machine import Machine, lacking

from deploy.image.build import read_manifest
from deploy.remote import digest
from deploy.update.bundle import BundleManifest, build_bundle, extract_root, manifest_file, write_bundle
from protocol.onboard import Computer, Release

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif("IMAGE_TEST" not in os.environ, reason="builds and boots a disk image: `make image-test` runs it"),
    pytest.mark.skipif(lacking() is not None, reason=lacking() or ""),
]
_LATER = "20990101T000000Z-broken"  # so that it is not an older one


@pytest.fixture(scope="module")
def bench(image: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    made = Bench(Drone(tmp_path_factory.mktemp("drone")), image)
    yield made
    if made.machine is not None:
        made.machine.power_off()


class Bench:
    """A drone's computer, and the technician's files."""

    def __init__(self, drone: Drone, image: Path) -> None:
        self.drone, self.image = drone, image
        self.machine: Machine | None = None
        self.boots = 0
        drone.flash(image)

    def switch_on(self) -> Machine:
        """Switch on, with a serial log of its own."""
        self.boots += 1
        log = self.drone.folder / "serial.log"
        if log.exists():
            log.rename(self.drone.folder / f"serial-{self.boots}.log")
        self.machine = self.drone.boot()
        return self.machine

    def cut_power(self) -> None:
        """Pull the plug."""
        assert self.machine is not None
        self.machine.power_off()

    def status(self, within_s: float = BOOT_S) -> Computer:
        """What ``radron-update status`` tells; waits for the SSH server."""
        deadline_s = time.monotonic() + within_s
        while True:
            said = self.drone.ssh("/opt/radron/bin/radron-update status")
            if said.startswith("{"):
                return msgspec.json.decode(said, type=Computer)
            assert time.monotonic() < deadline_s, said
            time.sleep(1.0)

    def push(self, *arguments: str) -> subprocess.Popen[str]:
        """``radron-deploy push`` in the background."""
        pipe = subprocess.PIPE
        command = self.drone.at_host("push", *arguments)
        return subprocess.Popen(command, env=self.drone.environment, cwd=ROOT, stdout=pipe, stderr=subprocess.STDOUT, text=True)

    def refused(self, *arguments: str) -> str:
        """The output of a push that must fail."""
        pushed = self.push(*arguments)
        said, _ = pushed.communicate(timeout=BOOT_S)
        assert pushed.returncode == 1, said
        return said

    def signed(self, name: str, release: Release, root: Path, signer: Path) -> Path:
        """A bundle of a root file system, with its description."""
        content, out = self.drone.folder / f"{name}.d", self.drone.folder / f"{name}.raucb"
        content.mkdir()
        shutil.copyfile(root, content / "root.squashfs")
        write_bundle(content, release, signer / "certificate.pem", signer / "key.pem", out, self.drone.folder / "rauc.log")
        shutil.rmtree(content)
        manifest = BundleManifest(release=release, sha256=digest(out), size=out.stat().st_size)
        manifest_file(out).write_bytes(msgspec.json.encode(manifest))
        return out


def test_an_update_survives_two_power_cuts_in_the_first_boots_of_the_new_slot(bench: Bench) -> None:
    bundle = bench.drone.folder / "new.raucb"
    build_bundle(bench.image, bench.drone.folder / "builder", bundle, print)
    bench.switch_on().wait_for(r"radron: booting slot A, attempt 1", BOOT_S)
    before = bench.status()
    assert (before.slot, before.attempts, before.outcome, before.trial) == ("A", 0, None, None)

    pushed = bench.push("--bundle", str(bundle))
    assert bench.machine is not None
    bench.machine.wait_for(r"radron: booting slot B, attempt 1", 2 * BOOT_S)
    bench.cut_power()  # in the first boot
    bench.switch_on().wait_for(r"radron: booting slot B, attempt 2", BOOT_S)
    bench.machine.wait_for(r"slot B, .*, is on trial, attempt 2 of 3", BOOT_S)
    bench.cut_power()  # before the agent is well
    bench.switch_on().wait_for(r"radron: booting slot B, attempt 3", BOOT_S)
    bench.machine.wait_for(r"radron-update: updated from .* to .*, slot B", BOOT_S)

    said, _ = pushed.communicate(timeout=BOOT_S)  # it has waited all the time
    assert pushed.returncode == 0, said
    now = bench.status()
    assert (now.slot, now.attempts, now.trial) == ("B", 0, None)
    assert now.outcome is not None
    assert now.outcome.kind == "good"
    assert "Active: failed" not in bench.drone.ssh("systemctl status radron-settle radron-agent")


def test_bundles_that_are_foreign_or_older_are_refused_and_nothing_is_changed(bench: Bench) -> None:
    small, made = bench.drone.folder / "small.squashfs", read_manifest(bench.image)
    command = ["mksquashfs", str(ROOT / "agent"), str(small), "-quiet", "-no-progress"]
    subprocess.run(command, check=True, capture_output=True)
    older = bench.signed("older", Release(version="0.0.1", build="20200101T000000Z-old"), small, bench.drone.folder / "builder")
    assert "0.0.1 (old) is older than what runs there" in bench.refused("--bundle", str(older))
    (bench.drone.folder / "other").mkdir()
    other = Drone(bench.drone.folder / "other")  # with an authority of its own
    release = Release(version=made.version, build="20990101T000000Z-foreign")
    foreign = bench.signed("foreign", release, small, other.folder / "builder")
    assert "foreign signature" in bench.refused("--bundle", str(foreign))
    now = bench.status()
    assert (now.slot, now.trial) == ("B", None)


def test_a_release_whose_agent_does_not_start_falls_back_unaided_and_tells_it(bench: Bench) -> None:
    made, folder = read_manifest(bench.image), bench.drone.folder
    root, tree = folder / "root.squashfs", folder / "tree"
    extract_root(bench.image, root)
    subprocess.run(["unsquashfs", "-no-progress", "-quiet", "-d", str(tree), str(root)], check=True, capture_output=True)
    root.unlink()
    (pilot,) = tree.glob("opt/radron/lib/python3*/site-packages/agent/shell/running.py")
    pilot.write_text("raise RuntimeError('a release that does not work')\n")
    shutil.rmtree(pilot.parent / "__pycache__")
    unit = tree / "etc/systemd/system/radron-settle.service"
    unit.write_text(unit.read_text().replace("radron-update settle", "radron-update settle --deadline 30"))
    command = [
        "mksquashfs",
        str(tree),
        str(root),
        "-comp",
        "lzo",
        "-Xalgorithm",
        "lzo1x_1_15",
        "-b",
        "256K",
        "-no-progress",
        "-quiet",
    ]
    subprocess.run(command, check=True, capture_output=True)
    shutil.rmtree(tree)
    broken = bench.signed("broken", Release(version=made.version, build=_LATER), root, folder / "builder")

    pushed = bench.push("--bundle", str(broken))
    assert bench.machine is not None
    for attempt in (1, 2, 3):
        bench.machine.wait_for(rf"radron: booting slot A, attempt {attempt}", 2 * BOOT_S)
    bench.machine.wait_for(r"radron-update: the update to .* failed after 3 attempts .*: slot B runs again", 2 * BOOT_S)
    said, _ = pushed.communicate(timeout=BOOT_S)
    assert pushed.returncode == 1, said
    assert "failed after 3 attempts (the agent does not report" in said
    now = bench.status()
    assert now.slot == "B"
    assert now.outcome is not None
    assert now.outcome.kind == "fell back"
