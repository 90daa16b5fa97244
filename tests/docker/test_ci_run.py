"""``.ci/run`` with its parts replaced: its installations, and its last lines."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PASSED = "3 passed, 1 skipped in 0.10s"


def program(path: Path, script: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


class Checkout:
    """A checkout in which every part of ``.ci/run`` says at once how it ended, on a machine without an engine."""

    def __init__(self, folder: Path, *, engine: bool = False) -> None:
        self.folder = folder
        self.programs = folder / "programs"
        (folder / ".ci").mkdir()
        shutil.copy(ROOT / ".ci/run", folder / ".ci/run")
        for name in ("bash", "cat", "dirname", "grep", "head", "mktemp", "rm", "tail", "tee", "timeout"):
            found = shutil.which(name)
            assert found is not None
            self.programs.mkdir(exist_ok=True)
            (self.programs / name).symlink_to(found)
        program(self.programs / "make", f'[ "$1" != test ] || echo "{PASSED}"')
        program(self.programs / "id", "echo 0")
        program(self.programs / "chromium", "")
        program(self.programs / "docker", f"exit {int(not engine)}")
        program(self.programs / "apt-get", f'echo "$@" >> {folder}/installed')
        program(folder / ".venv/bin/radron-sim", 'case "$*" in *emulated*) ;; *) exit 77 ;; esac')
        program(folder / ".venv/bin/python", "echo no qemu; exit 77")
        program(folder / "deploy/docker/test.sh", "echo flown")

    def run(self) -> tuple[int, list[str]]:
        """Its exit code, and the lines that it prints."""
        done = subprocess.run([self.folder / ".ci/run"], env={**os.environ, "PATH": str(self.programs)}, capture_output=True,
            text=True, timeout=30.0, check=False)  # fmt: skip
        return done.returncode, done.stdout.splitlines()

    @property
    def installed(self) -> str:
        """The words given to apt-get."""
        words = self.folder / "installed"
        return words.read_text() if words.exists() else ""


def test_the_last_lines_name_all_that_was_skipped_and_then_the_tests(tmp_path: Path) -> None:
    """A skip of the containers in the middle of 33 minutes of output was not seen."""
    checkout = Checkout(tmp_path)
    program(tmp_path / "deploy/docker/test.sh", "echo trying; echo no docker engine: no kernel for it >&2; exit 77")
    code, lines = checkout.run()
    assert code == 0
    assert lines[-4:] == [
        "SKIPPED: the test on a real PX4 (make px4-test): no PX4_BIN",
        "SKIPPED: the test of the containers (make docker-test): no docker engine: no kernel for it",
        "SKIPPED: the test of the image (make image-smoke): no qemu",
        PASSED,
    ]


@pytest.mark.parametrize("engine", [False, True])
def test_an_engine_is_installed_where_there_is_none(tmp_path: Path, engine: bool) -> None:
    checkout = Checkout(tmp_path, engine=engine)
    code, _ = checkout.run()
    assert code == 0
    assert ("docker.io" in checkout.installed) is not engine


def test_a_failure_in_the_containers_fails_the_run(tmp_path: Path) -> None:
    checkout = Checkout(tmp_path)
    program(tmp_path / "deploy/docker/test.sh", "exit 1")
    code, lines = checkout.run()
    assert code == 1
    assert "make docker-test: failed with code 1" in lines
    assert lines[-1] == PASSED
