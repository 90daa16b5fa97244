"""Scripts and units that are installed: correct shell, correct units, and the same as the image's."""

from __future__ import annotations

import io
import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest

from radron.deploy.computer.install import SYSTEM_FILES, scripts

DEPLOY = Path(__file__).parents[3] / "deploy"
ROOTFS = DEPLOY / "image/contents/rootfs"
SCRIPTS = [*(DEPLOY / "computer/contents").glob("*.sh"), ROOTFS / "usr/lib/radron/bench", ROOTFS / "usr/lib/radron/provision"]


def unpacked(folder: Path) -> Path:
    with tarfile.open(fileobj=io.BytesIO(scripts())) as archive:
        archive.extractall(folder, filter="data")
    return folder / "system"


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_the_scripts_are_correct(script: Path) -> None:
    subprocess.run(["sh", "-n", str(script)], check=True)


def test_units_and_scripts_are_those_of_the_image(tmp_path: Path) -> None:
    system = unpacked(tmp_path)
    for name in SYSTEM_FILES:
        assert (system / name).read_bytes() == (ROOTFS / name).read_bytes()
    assert (system / "usr/lib/radron/bench").stat().st_mode & 0o111


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_the_units_load_where_there_is_no_config_partition(tmp_path: Path) -> None:
    system = unpacked(tmp_path)
    for program in ("opt/radron/bin/radron-agent", "opt/radron/bin/radron-update", "usr/lib/radron/provision"):
        (system / program).parent.mkdir(parents=True, exist_ok=True)
        (system / program).write_text("#!/bin/sh\n")
        (system / program).chmod(0o755)
    for name in ("sysinit.target", "multi-user.target", "network.target", "basic.target", "shutdown.target"):
        (system / f"etc/systemd/system/{name}").write_text("[Unit]\nDescription=stand-in\n")
    command = ["systemd-analyze", "verify", f"--root={system}", "--man=no", "radron-agent.service"]
    command += ["radron-provision.service", "radron-clock.path", "radron-clock.service"]
    judged = subprocess.run(command, capture_output=True, text=True, check=False)
    if "unrecognized option" in judged.stderr:
        pytest.skip("this systemd-analyze knows no --root (before version 250)")
    assert [line for line in judged.stderr.splitlines() if "radron" in line] == []
    assert judged.returncode == 0, judged.stderr


def test_uninstall_knows_all_that_install_brings() -> None:
    removed = (DEPLOY / "computer/contents/uninstall.sh").read_text()
    for name in SYSTEM_FILES:
        assert f"/{name}" in removed or f"/{Path(name).parent} " in removed
