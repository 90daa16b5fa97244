"""The parts of an image are the same bytes each time; `image build --twice` compares whole ones."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import BinaryIO

import pytest

from radron.deploy.image.disk import make_disk
from radron.deploy.image.layout import CONFIG, IMAGE_BYTES, MIB, ROOT_A
from radron.deploy.image.wheels import make_own_wheel

SOURCE = Path(__file__).parents[3]


def part_of(image: BinaryIO, start: int) -> bytes:
    image.seek(start)
    return image.read(2 * MIB)


@pytest.mark.slow
def test_our_own_wheel(tmp_path: Path) -> None:
    made = []
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        make_own_wheel(SOURCE, tmp_path / name, tmp_path / name / "wheels", 1_700_000_000, tmp_path / "log")
        (wheel,) = (tmp_path / name / "wheels").iterdir()
        made.append(wheel.read_bytes())
    assert made[0] == made[1]


@pytest.mark.skipif(shutil.which("sgdisk", path="/usr/sbin:/usr/bin:/sbin:/bin") is None, reason="gdisk is not installed")
def test_the_disk_with_its_partition_tables(tmp_path: Path) -> None:
    config, root, made = tmp_path / "config", tmp_path / "root", []
    config.write_bytes(b"config" + bytes(MIB) + b"end")
    root.write_bytes(b"root" * 1000)
    for name in ("one", "other"):
        disk = tmp_path / name
        make_disk(disk, {CONFIG: config, ROOT_A: root})
        with disk.open("rb") as image:
            parts = [part_of(image, start) for start in (0, CONFIG.start, ROOT_A.start, IMAGE_BYTES - MIB)]
        made.append((disk.stat().st_size, parts))
    assert made[0] == made[1]
