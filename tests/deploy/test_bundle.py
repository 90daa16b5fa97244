"""Bundles: signed for the swarm's drones, as RAUC itself judges; and which of them a computer installs."""

from __future__ import annotations

import random
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from cryptography.x509.oid import ExtendedKeyUsageOID

from radron.agent.update.errors import UpdateError as Refused
from radron.agent.update.install import Updater, run_told
from radron.deploy.image.errors import ImageError
from radron.deploy.image.layout import IMAGE_BYTES, ROOT_A
from radron.deploy.image.tools import run
from radron.deploy.pki import release
from radron.deploy.pki.authority import PkiFolder
from radron.deploy.update import bundle
from radron.deploy.update.bundle import (
    BundleManifest,
    build_bundle,
    extract_root,
    manifest_file,
    read_bundle_manifest,
    write_bundle,
)
from radron.deploy.update.errors import UpdateError
from radron.protocol.identity import Role
from radron.protocol.messages import Stage
from radron.protocol.onboard import Needs, Release, Report, Trial
from support.computers.onboard import NEW, OLD, OnboardFiles, well

LACKING = [name for name in ("rauc", "mksquashfs") if shutil.which(name) is None]
needs_rauc = pytest.mark.skipif(
    bool(LACKING), reason=f"not installed: {', '.join(LACKING)} (apt-get install rauc squashfs-tools)"
)


def make_authority(folder: Path) -> PkiFolder:
    """An authority with a release certificate, ``folder/builder``, and a drone's, ``folder/d1``."""
    pki = PkiFolder(folder)
    pki.init("radron", passphrase, time.time_ns())
    for name, role in (("builder", Role.RELEASE), ("d1", Role.DRONE)):
        pki.issue(name, role, None, folder / name, passphrase, time.time_ns())
    return pki


def passphrase() -> str:
    return "four quite ordinary words"


@pytest.fixture(scope="module")
def signed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path, Release], Path]:
    """Makes a small bundle, signed by a release certificate of an authority."""
    folder = tmp_path_factory.mktemp("bundles")
    (folder / "root").mkdir()
    (folder / "root/release").write_bytes(random.Random(0).randbytes(20_000))  # RAUC takes none of 4 KiB

    def make(authority: Path, release: Release) -> Path:
        made = folder / f"{authority.name}-{release.version}-{len(list(folder.iterdir()))}.raucb"
        content = made.with_suffix(".d")
        content.mkdir()
        command = ["mksquashfs", str(folder / "root"), str(content / "root.squashfs"), "-quiet", "-no-progress"]
        subprocess.run(command, check=True, capture_output=True)
        builder = authority / "builder"
        write_bundle(content, release, builder / "certificate.pem", builder / "key.pem", made, folder / "log")
        return made

    return make


class Aboard:
    """A computer with the drone's authority, and RAUC as far as it needs no D-Bus: it inspects; writing is told to the slots."""

    def __init__(self, folder: Path, authority: Path) -> None:
        self.files = OnboardFiles(folder)
        self.files.boot()
        self.said: list[str] = []
        self.reboots = 0
        self.report: Report | None = well()
        self.rauc_fails = False
        keyring = f"[keyring]\npath={authority / 'ca.pem'}\ncheck-purpose=codesign\n"
        self.settings = folder / "system.conf"
        self.settings.write_text(f"[system]\ncompatible=radron-nuc\nbootloader=noop\nbundle-formats=verity\n\n{keyring}")

    @property
    def updater(self) -> Updater:
        slots, records = self.files.slots, self.files.records
        return Updater(slots, records, OLD, lambda: self.report, self._reboot, self.said.append, time.time_ns, self._run)

    def _reboot(self) -> None:
        self.reboots += 1

    def _run(self, command: list[str], tell: Callable[[str], None]) -> tuple[int, list[str]]:
        if command[1] == "info":
            return run_told(["rauc", f"--conf={self.settings}", *command[1:]], tell)
        trial = self.files.records.trial
        assert trial is not None  # before anything is written
        self.files.slots.answer("set-state", "B", "bad")
        if self.rauc_fails:
            return 1, ["LastError: Installation error: Input/output error"]
        self.files.slots.answer("set-primary", "B")
        return 0, ["installing 100%"]


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_authority(tmp_path_factory.mktemp("pki")).folder


@pytest.fixture
def aboard(tmp_path: Path, authority: Path) -> Aboard:
    return Aboard(tmp_path / "computer", authority)


@needs_rauc
def test_a_bundle_of_our_authority_is_installed_and_put_on_trial(
    aboard: Aboard, authority: Path, signed: Callable[[Path, Release], Path]
) -> None:
    aboard.updater.install(signed(authority, NEW))
    trial = aboard.files.records.trial
    assert trial is not None
    assert (trial.slot, trial.release, trial.before) == ("B", NEW, OLD)
    assert (trial.needs.alive, trial.needs.autopilot, trial.needs.camera) == (("d2", "d3"), True, True)
    assert (aboard.files.slots.primary, aboard.reboots) == ("B", 1)
    assert aboard.files.records.slots == {"B": NEW}
    assert aboard.said[-1] == "starting slot B"


@needs_rauc
def test_a_foreign_signature_is_refused_and_nothing_is_written(
    aboard: Aboard, tmp_path: Path, signed: Callable[[Path, Release], Path]
) -> None:
    foreign = signed(make_authority(tmp_path / "foreign").folder, NEW)
    with pytest.raises(Refused, match="foreign signature: it is not signed by a release certificate of this swarm's authority"):
        aboard.updater.install(foreign)
    (tmp_path / "cut.raucb").write_bytes(foreign.read_bytes()[:3000])
    with pytest.raises(Refused, match=r"cut.raucb: is no bundle, or is damaged"):
        aboard.updater.install(tmp_path / "cut.raucb")
    assert (aboard.files.slots.primary, aboard.files.records.trial, aboard.reboots) == ("A", None, 0)


@needs_rauc
def test_a_certificate_for_links_signs_no_releases(
    aboard: Aboard, authority: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, signed: Callable[[Path, Release], Path]
) -> None:
    """Though the same authority has issued it, and its key could sign."""
    monkeypatch.setattr(release.ExtendedKeyUsageOID, "CODE_SIGNING", ExtendedKeyUsageOID.CLIENT_AUTH)
    pki = PkiFolder(tmp_path / "pki")
    shutil.copytree(authority, pki.folder)
    pki.issue("builder", Role.RELEASE, None, pki.folder / "builder", passphrase, time.time_ns())
    with pytest.raises(ImageError, match=r"does not specify extended key usage code signing|unsuitable certificate purpose"):
        signed(pki.folder, NEW)  # the operator's computer notices first
    monkeypatch.setattr(bundle, "run", lambda command, log: run(command, log) if command[-3] == "bundle" else "")
    with pytest.raises(Refused, match="is signed by a certificate that may not sign releases"):
        aboard.updater.install(signed(pki.folder, NEW))
    with pytest.raises(UpdateError, match=r"d1: is a certificate with the role drone, not release; make one with"):
        build_bundle(an_image(tmp_path), authority / "d1", tmp_path / "out.raucb", lambda text: None)


@needs_rauc
def test_an_older_release_is_refused_unless_told(
    aboard: Aboard, authority: Path, signed: Callable[[Path, Release], Path]
) -> None:
    older = signed(authority, Release(version="0.0.9", build="20261125T000000Z-c"))
    with pytest.raises(Refused, match=r"^0\.0\.9 \(c\) is older than what runs here, 0\.1\.0 \(aaaaaaaaaaaa\).*--older"):
        aboard.updater.install(older)
    assert aboard.reboots == 0
    aboard.updater.install(older, older=True)
    assert aboard.reboots == 1


@needs_rauc
def test_no_update_while_armed_or_in_flight_or_on_trial(
    aboard: Aboard, authority: Path, signed: Callable[[Path, Release], Path]
) -> None:
    new = signed(authority, NEW)
    aboard.report = msgspec.structs.replace(well(), armed=True)
    with pytest.raises(Refused, match="its vehicle is armed: no update before it has landed and is disarmed"):
        aboard.updater.install(new)
    aboard.report = msgspec.structs.replace(well(), stage=Stage.SURVEY)
    with pytest.raises(Refused, match=r"a flight is under way \(survey\)"):
        aboard.updater.roll_back()
    aboard.report = well()
    trial = Trial(slot="A", release=OLD, before=NEW, needs=Needs(), begun_ns=1)
    aboard.files.records.begin(trial)
    with pytest.raises(Refused, match="is on trial in slot A: wait until that is decided"):
        aboard.updater.install(new)
    aboard.files.records.begin(msgspec.structs.replace(trial, slot="B"))  # left by an updater that was killed
    aboard.updater.install(new)
    assert aboard.reboots == 1


@needs_rauc
def test_a_bundle_that_cannot_be_written_leaves_the_slot_in_service(
    aboard: Aboard, authority: Path, signed: Callable[[Path, Release], Path]
) -> None:
    aboard.rauc_fails = True
    with pytest.raises(Refused, match="not installed: Installation error: Input/output error; slot A stays in service"):
        aboard.updater.install(signed(authority, NEW))
    assert (aboard.files.slots.primary, aboard.files.records.trial, aboard.reboots) == ("A", None, 0)


def test_only_one_update_at_a_time_is_installed(aboard: Aboard) -> None:
    aboard.files.records.put_slot("B", NEW)
    assert not aboard.files.records.busy
    with aboard.files.records.changing():
        assert aboard.files.records.busy
        with pytest.raises(Refused, match="another update is being installed: wait for its end"):
            aboard.updater.roll_back()
    aboard.updater.roll_back()
    assert aboard.reboots == 1


def test_going_back_needs_a_release_that_has_worked(aboard: Aboard) -> None:
    with pytest.raises(Refused, match="slot B holds no release that has worked here"):
        aboard.updater.roll_back()
    aboard.files.records.put_slot("B", NEW)
    aboard.updater.roll_back()
    trial = aboard.files.records.trial
    assert trial is not None
    assert (trial.slot, trial.release, aboard.files.slots.primary, aboard.reboots) == ("B", NEW, "B", 1)


@needs_rauc
def test_the_root_file_system_of_an_image_becomes_a_bundle(
    tmp_path: Path, authority: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    image = an_image(tmp_path)
    out = tmp_path / "new.raucb"
    monkeypatch.chdir(authority.parent)
    made = build_bundle(image, Path(authority.name, "builder"), out, lambda text: None)
    assert made.release == Release(version="0.2.0", build="20261123T000000Z-abc")
    assert read_bundle_manifest(out) == made
    with pytest.raises(
        UpdateError, match="holds no certificate for releases; make one with `radron-deploy pki issue NAME --role release`"
    ):
        build_bundle(image, tmp_path, out, lambda text: None)
    extract_root(image, tmp_path / "again.squashfs")
    root = (tmp_path / "root.squashfs").read_bytes()
    assert (tmp_path / "again.squashfs").read_bytes()[: len(root)] == root
    out.write_bytes(out.read_bytes()[:-1])
    with pytest.raises(UpdateError, match=r"is not all of the bundle that new.raucb.json describes; copy it again"):
        read_bundle_manifest(out)


def an_image(folder: Path) -> Path:
    """An image with nothing but a root file system, ``root.squashfs``."""
    (folder / "root").mkdir()
    (folder / "root/file").write_bytes(random.Random(0).randbytes(20_000))
    root, image = folder / "root.squashfs", folder / "nuc.img"
    subprocess.run(["mksquashfs", str(folder / "root"), str(root), "-quiet", "-no-progress"], check=True, capture_output=True)
    with image.open("wb") as disk:
        disk.truncate(IMAGE_BYTES)
        disk.seek(512)
        disk.write(b"EFI PART")
        disk.seek(ROOT_A.start)
        disk.write(root.read_bytes())
    listed = '{"version": "0.2.0", "commit": "abc", "epoch": 1795392000, "sha256": "", "packages": {}, "wheels": {}}'
    (folder / "nuc.img.json").write_text(listed)
    return image


def test_a_bundle_without_its_description_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.raucb"
    file.write_bytes(b"x")
    with pytest.raises(UpdateError, match=r"a.raucb.json: cannot be read \(No such file or directory\)"):
        read_bundle_manifest(file)
    manifest_file(file).write_bytes(msgspec.json.encode(BundleManifest(release=NEW, sha256="0", size=1)))
    assert read_bundle_manifest(file).release == NEW


@pytest.mark.parametrize(
    ("one", "other"),
    [("0.1.0", "0.2.0"), ("0.9.0", "0.10.0"), ("1.0.0rc1", "1.0.0"), ("1.0.0-beta.1", "1.0.0"), ("1.0.0", "1.0.1")],
)
def test_releases_are_ordered_by_version_and_then_by_date(one: str, other: str) -> None:
    assert Release(version=one, build="2").is_older_than(Release(version=other, build="1"))
    assert not Release(version=other, build="1").is_older_than(Release(version=one, build="2"))
    assert OLD.is_older_than(msgspec.structs.replace(OLD, build=NEW.build))
    assert not OLD.is_older_than(OLD)
