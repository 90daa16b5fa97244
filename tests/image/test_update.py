"""`make image-test`: updates of a drone's computer in QEMU, as a technician makes them, and with releases that do not work.

Its agent waits for an autopilot that never comes; what must answer after an update is what answered before.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import msgspec
import pytest

from radron.deploy.digest import digest
from radron.deploy.image.build import read_manifest
from radron.deploy.image.layout import ROOT_B
from radron.deploy.image.rootfs import COMPRESSION
from radron.deploy.update.bundle import BundleManifest, extract_root, manifest_file, write_bundle
from radron.protocol.onboard import Release
from support.computers.cutbench import SETTLED, Bench, Kept, Push, Run
from support.computers.cutdisk import BLOCK_BYTES, Content
from support.computers.dronedisk import BOOT_S, ROOT, Drone
from support.computers.machine import lacking

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif("IMAGE_TEST" not in os.environ, reason="builds and boots a disk image: `make image-test` runs it"),
    pytest.mark.skipif(lacking() is not None, reason=lacking() or ""),
]
_LATER = "20990101T000000Z-broken"  # so that it is not an older one


def refused(drone: Drone, bundle: Path) -> str:
    """The output of a push that must fail."""
    with Push(drone, bundle) as push:
        assert push.ended() == 1, push.said
    return push.said


def signed(drone: Drone, name: str, release: Release, root: Path, signer: Path) -> Path:
    """A bundle of a root file system, with its description."""
    content, out = drone.folder / f"{name}.d", drone.folder / f"{name}.raucb"
    content.mkdir()
    shutil.copyfile(root, content / "root.squashfs")
    write_bundle(content, release, signer / "certificate.pem", signer / "key.pem", out, drone.folder / "rauc.log")
    shutil.rmtree(content)
    manifest = BundleManifest(release=release, sha256=digest(out), size=out.stat().st_size)
    manifest_file(out).write_bytes(msgspec.json.encode(manifest))
    return out


@pytest.mark.smoke
def test_a_push_is_over_when_the_agent_of_the_new_release_is_well(bench: Bench) -> None:
    bench.run("updated")
    now = bench.drone.status()
    assert (now.slot, now.attempts, now.trial) == ("B", 0, None)
    assert now.outcome is not None
    assert now.outcome.kind == "good"
    assert "Active: failed" not in bench.drone.ssh("systemctl status radron-settle radron-agent")


def test_bundles_that_are_foreign_or_older_are_refused_and_nothing_is_changed(bench: Bench) -> None:
    bench.run("in service")
    drone, small = bench.drone, bench.drone.folder / "small.squashfs"
    command = ["mksquashfs", str(ROOT / "agent"), str(small), "-quiet", "-no-progress"]
    subprocess.run(command, check=True, capture_output=True)
    older = signed(drone, "older", Release(version="0.0.1", build="20200101T000000Z-old"), small, drone.folder / "builder")
    assert "0.0.1 (old) is older than what runs there" in refused(drone, older)
    (drone.folder / "other").mkdir()
    other = Drone(drone.folder / "other")  # with an authority of its own
    release = Release(version=read_manifest(bench.image).version, build="20990101T000000Z-foreign")
    foreign = signed(drone, "foreign", release, small, other.folder / "builder")
    assert "foreign signature" in refused(drone, foreign)
    now = drone.status()
    assert (now.slot, now.attempts, now.trial, now.outcome) == ("A", 0, None, None)


def fallen_back(bench: Bench, run: Run, because: str) -> None:
    """Three attempts at slot B, and then slot A, which says so."""
    for attempt in (1, 2, 3):
        run.machine.wait_for(rf"radron: booting slot B, attempt {attempt}", 2 * BOOT_S)
    run.machine.wait_for(
        rf"radron-update: the update to .* failed after 3 attempts \({because}.*\): slot A runs again", 2 * BOOT_S
    )
    run.machine.wait_for(SETTLED, BOOT_S)
    now = bench.drone.status()
    assert (now.slot, now.attempts, now.trial) == ("A", 0, None)
    assert now.outcome is not None
    assert now.outcome.kind == "fell back"
    assert run.variables()["B_OK"] == "0"


def test_a_bundle_without_a_system_falls_back_unaided_and_the_push_tells_it(bench: Bench) -> None:
    folder, run = bench.drone.folder, bench.run("in service")
    whole, tree, root = folder / "whole.squashfs", folder / "kernel", folder / "kernel.squashfs"
    extract_root(bench.image, whole)
    subprocess.run(["unsquashfs", "-q", "-n", "-d", str(tree), str(whole), "vmlinuz", "initrd.img", "boot"], check=True)
    whole.unlink()
    subprocess.run(["mksquashfs", str(tree), str(root), "-quiet", "-no-progress", *COMPRESSION], check=True)
    release = Release(version=read_manifest(bench.image).version, build=_LATER)
    broken = signed(bench.drone, "broken", release, root, folder / "builder")
    with Push(bench.drone, broken) as push:
        fallen_back(bench, run, "it did not start, or lost its power")
        assert push.ended() == 1
        assert "failed after 3 attempts (it did not start" in push.said


def test_a_release_whose_agent_does_not_start_falls_back_unaided(bench: Bench) -> None:
    root = without_agent(bench.image, bench.drone.folder).read_bytes()
    blocks = {(ROOT_B.start + at) // BLOCK_BYTES: root[at : at + BLOCK_BYTES] for at in range(0, len(root), BLOCK_BYTES)}
    written = bench.kept["to be booted"].content
    bench.kept["broken"] = Kept(Content(written.stored | written.cached | blocks))
    fallen_back(bench, bench.run("broken"), "the agent does not report")


def without_agent(image: Path, folder: Path) -> Path:
    """The image's root file system with an agent that ends at once, and less patience with it; in whole blocks."""
    root, tree = folder / "root.squashfs", folder / "tree"
    extract_root(image, root)
    subprocess.run(["unsquashfs", "-q", "-n", "-d", str(tree), str(root)], check=True)
    root.unlink()
    (pilot,) = tree.glob("opt/radron/lib/python3*/site-packages/radron/agent/shell/running.py")
    pilot.write_text("raise RuntimeError('a release that does not work')\n")
    shutil.rmtree(pilot.parent / "__pycache__")
    unit = tree / "etc/systemd/system/radron-settle.service"
    unit.write_text(unit.read_text().replace("radron-update settle", "radron-update settle --deadline 30"))
    subprocess.run(["mksquashfs", str(tree), str(root), "-no-progress", "-quiet", *COMPRESSION], check=True)
    shutil.rmtree(tree)
    assert root.stat().st_size % BLOCK_BYTES == 0
    return root
