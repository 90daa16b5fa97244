"""A package without a wheel for a drone's computer is named."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from radron.deploy.image.wheels import Platform

DEPLOY = str(Path(sys.executable).parent / "radron-deploy")


@pytest.mark.slow
def test_a_package_that_is_not_to_be_had_is_named(tmp_path: Path) -> None:
    """No index: the agent's first requirement is missing."""
    (tmp_path / "agent").mkdir()
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "radron"\nversion = "0.1.0"\ndependencies = ["osqp>=1.0"]\n')
    (tmp_path / "constraints.txt").write_text("osqp==1.1.3\n")
    author = ("-c", "user.name=anna", "-c", "user.email=anna@example.org")
    for words in (("init",), (*author, "commit", "--allow-empty", "--message", "first")):
        subprocess.run(["git", *words], check=True, cwd=tmp_path, capture_output=True)
    command = [DEPLOY, "packages", "--machine", "arm64", "--python", "3.12", "--source", str(tmp_path), "--cache", str(tmp_path)]
    environment = {**os.environ, "PIP_NO_INDEX": "1", "SOURCE_DATE_EPOCH": "0"}
    told = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=tmp_path)
    assert told.returncode == 2
    assert told.stderr == (
        "radron-deploy: the packages for Python 3.12 on arm64: there is no wheel of osqp in the pinned version, "
        f"or the package index is not reached (all that pip said: {tmp_path}/install.log)\n"
    )


def test_the_platform_tags_are_those_that_a_computer_runs() -> None:
    tags = Platform("3.12", "aarch64", 39).tags
    assert (tags[0], tags[-1]) == ("manylinux_2_39_aarch64", "manylinux2014_aarch64")
    assert "manylinux_2_28_aarch64" in tags
    assert "manylinux_2_40_aarch64" not in tags
