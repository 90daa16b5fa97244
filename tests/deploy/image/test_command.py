"""``radron-deploy image flash`` as it is called: every refusal is one line, before anything is written."""

from __future__ import annotations

import sys
from pathlib import Path

import msgspec
import pytest

from radron.deploy import cli
from radron.deploy.image import command, target
from radron.deploy.image import flash as flashing
from radron.deploy.image.build import Manifest, manifest_file
from radron.deploy.image.layout import MIB
from support.computers.fleets import FLEET, make_fleet

IMAGE_BYTES = 4 * MIB


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Fleet file, image and disk, all small."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(flashing, "IMAGE_BYTES", IMAGE_BYTES)
    monkeypatch.setattr(target, "MIN_DISK_BYTES", 2 * IMAGE_BYTES)
    make_fleet(tmp_path)
    (tmp_path / "nuc.img").write_bytes(bytes(512) + b"EFI PART" + bytes(IMAGE_BYTES - 520))
    manifest = Manifest(version="0.1.0", commit="abc", epoch=0, sha256="", packages={}, wheels={})
    manifest_file(tmp_path / "nuc.img").write_bytes(msgspec.json.encode(manifest))
    (tmp_path / "disk").write_bytes(b"photos" + bytes(2 * IMAGE_BYTES))
    return tmp_path


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The line that refuses a command."""
    monkeypatch.setattr(sys, "argv", ["radron-deploy", "image", "flash", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line.removeprefix("radron-deploy: ")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("nuc.img", "disk", "--drone", "d2", "--erase", "sdb"), "'sdb' is not 'disk': nothing was written"),
        (("nuc.img", "disk", "--drone", "d9", "--erase", "disk"), "fleet.toml: there is no drone 'd9'; its drones are d1, d2"),
        (("nuc.img", "sdx", "--drone", "d2"), "sdx: No such file or directory; `lsblk` lists this computer's disks"),
        (("disk", "disk", "--drone", "d2"), "disk: is no image of this release, or not all of one; make it"),
        (("nuc.img", "nuc.img", "--drone", "d2"), "nuc.img: is too small: 0.0 GB; a drone needs 0.0 GB, better 32 GB"),
        (("nuc.img", "disk", "--drone", "d2", "--erase", "disk"), "pki/ca.pem: there is no authority"),
    ],
)  # fmt: skip
def test_what_cannot_be_written_is_refused_before_anything_is(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], line: str
) -> None:
    before = (folder / "disk").read_bytes()
    assert refused(monkeypatch, capsys, *words, "--fleet", "fleet.toml").startswith(line)
    assert (folder / "disk").read_bytes() == before


def test_an_image_of_another_release_than_the_fleets_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "fleet.toml").write_text(FLEET.replace('version = "0.1.0"', 'version = "0.2.0"'))
    line = refused(monkeypatch, capsys, "nuc.img", "disk", "--drone", "d2", "--fleet", "fleet.toml")
    assert line == "nuc.img: is radron 0.1.0, and fleet.toml wants version = '0.2.0'; correct one of them"


def test_an_interrupted_one_says_so(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "_make_config", lambda *_: None)
    monkeypatch.setattr(flashing, "flash", interrupted)
    line = refused(monkeypatch, capsys, "nuc.img", "disk", "--drone", "d2", "--fleet", "fleet.toml", "--erase", "disk")
    assert line == "interrupted: disk is erased but not complete, and no computer starts from it; run this again"
