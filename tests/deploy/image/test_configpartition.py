"""The config partition: the fleet's files and a certificate; errors of the programs that make it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path, PurePosixPath

import pytest

from radron.deploy.fleet.loading import load_fleet
from radron.deploy.image.configpartition import make_config
from radron.deploy.image.errors import ImageError
from radron.deploy.image.layout import CONFIG, MIB
from radron.deploy.image.tools import need, run
from support.computers.fleets import PIXELS, make_fleet

EPOCH = 1_700_000_000
without_tools = pytest.mark.skipif(
    shutil.which("mcopy") is None or shutil.which("mkfs.vfat", path="/usr/sbin:/sbin") is None,
    reason="mtools and dosfstools are not installed",
)


def issue(folder: Path) -> None:
    folder.mkdir()
    (folder / "key.pem").write_text("the key\n")


def made(folder: Path) -> Path:
    folder.mkdir()
    fleet = load_fleet(make_fleet(folder))
    (folder / "work").mkdir()
    make_config(folder / "config.fat", folder / "work", fleet, fleet.drone("d1"), issue, EPOCH)
    return folder / "config.fat"


@without_tools
def test_the_partition_holds_the_drones_files_and_only_the_owner_reads_it(tmp_path: Path) -> None:
    file = made(tmp_path / "one")
    assert file.stat().st_size == CONFIG.size
    assert file.stat().st_mode & 0o077 == 0
    for name, text in (("hostname", "radron-d1\n"), ("identity/key.pem", "the key\n"), ("calibration/t.txt", PIXELS)):
        assert subprocess.run(["mtype", "-i", str(file), f"::{name}"], capture_output=True, text=True, check=True).stdout == text


@without_tools
def test_equal_content_is_equal_bytes(tmp_path: Path) -> None:
    assert made(tmp_path / "one").read_bytes() == made(tmp_path / "other").read_bytes()


@without_tools
def test_what_does_not_fit_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fleet = load_fleet(make_fleet(tmp_path))
    large = {PurePosixPath("mission/hills.tif"): bytes(CONFIG.size + MIB)}
    monkeypatch.setattr("radron.deploy.image.configpartition.files_of", lambda *_: large)
    (tmp_path / "work").mkdir()
    with pytest.raises(ImageError, match=r"mcopy failed: .*(full|space)"):
        make_config(tmp_path / "config.fat", tmp_path / "work", fleet, fleet.drone("d1"), issue, EPOCH)


def test_missing_programs_are_named_with_their_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("radron.deploy.image.tools.shutil.which", lambda name, path: None)
    with pytest.raises(ImageError, match=r"missing on this computer: mcopy, sgdisk; .*`apt-get install gdisk mtools`"):
        need("mcopy", "sgdisk")


def test_a_failed_program_is_its_last_line_and_the_log_has_all(tmp_path: Path) -> None:
    log = tmp_path / "log"
    with pytest.raises(ImageError, match=r"sh failed: second \(all of it: .*log\)"):
        run(["sh", "-c", "echo first; echo second; exit 3"], log)
    assert "first\nsecond\n" in log.read_text()
    with pytest.raises(ImageError, match=r"sh failed: exit code 4"):
        run(["sh", "-c", "exit 4"])
    assert run(["sh", "-c", "echo out"]) == "out\n"
