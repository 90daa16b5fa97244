"""Which partitions and files of two images differ."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from radron.deploy.image import compare, flash
from radron.deploy.image.compare import differences
from radron.deploy.image.layout import MIB, Partition

CONFIG, ROOT_A = Partition(1, "config", "", MIB, MIB), Partition(2, "root-a", "", 2 * MIB, 4 * MIB)
IMAGE_BYTES = 7 * MIB


def image(folder: Path, name: str, version: str) -> Path:
    root = folder / name
    (root / "etc").mkdir(parents=True)
    (root / "etc/release").write_text(version)
    (root / "etc/same").write_text("same")
    squashed = folder / f"{name}.squashfs"
    pack = ["mksquashfs", str(root), str(squashed), "-quiet", "-no-progress", "-all-time", "0", "-mkfs-time", "0", "-all-root"]
    subprocess.run(pack, check=True, stdout=subprocess.DEVNULL)
    file = folder / f"{name}.img"
    with file.open("wb") as disk:
        disk.truncate(IMAGE_BYTES)
        disk.seek(512)
        disk.write(b"EFI PART")
        disk.seek(ROOT_A.start)
        disk.write(squashed.read_bytes())
    return file


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compare, "PARTITIONS", (CONFIG, ROOT_A))
    monkeypatch.setattr(compare, "ROOT_A", ROOT_A)
    monkeypatch.setattr(flash, "IMAGE_BYTES", IMAGE_BYTES)


@pytest.mark.skipif(shutil.which("mksquashfs") is None, reason="squashfs-tools is not installed")
def test_the_partition_and_the_file_that_differ_are_named(tmp_path: Path) -> None:
    one, same, other = image(tmp_path, "one", "1"), image(tmp_path, "same", "1"), image(tmp_path, "other", "2")
    assert differences(one, same) == []
    assert differences(one, other) == ["root-a: differs", "    etc/release: differs in content"]
    with same.open("r+b") as disk:
        disk.seek(CONFIG.start)
        disk.write(b"x")
    assert differences(one, same) == ["config: differs"]
