"""What ``make release`` refuses before it builds anything."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
GIT = ("git", "-c", "user.name=anna", "-c", "user.email=anna@example.org")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project of version 1.2.0, committed."""
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci/release", tmp_path / ".ci")
    (tmp_path / ".venv/bin").mkdir(parents=True)
    (tmp_path / ".venv/bin/python").symlink_to(sys.executable)
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "radron"\nversion = "1.2.0"\n')
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## 1.2.0\n\n- One change.\n")
    (tmp_path / ".gitignore").write_text(".venv\n")
    for words in (("init", "--quiet"), ("add", "."), ("commit", "--quiet", "--message", "first")):
        subprocess.run([*GIT, *words], cwd=tmp_path, check=True)
    return tmp_path


def refusal(project: Path, **options: str) -> str:
    """The line with which a release ends before it is built."""
    done = subprocess.run([project / ".ci/release"], env={**os.environ, **options}, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert not (project / "dist").exists()
    return done.stderr


def test_a_version_without_a_page_in_the_changelog(project: Path) -> None:
    (project / "CHANGELOG.md").write_text("# Changelog\n\n## 1.1.0\n")
    assert refusal(project) == "release: CHANGELOG.md has no section 1.2.0: run .venv/bin/towncrier build --version 1.2.0\n"


def test_a_key_that_is_not_there(project: Path) -> None:
    assert refusal(project, KEY="nobody@example.org") == "release: KEY=nobody@example.org: gpg has no such secret key\n"


def test_a_tag_of_a_tree_with_changes(project: Path) -> None:
    (project / "new").touch()
    assert refusal(project, TAG="1") == "release: TAG=1: the tree has changes: commit them first\n"


def test_a_tag_that_leaves_fragments(project: Path) -> None:
    (project / "changes").mkdir()
    (project / "changes/+x.fixed.md").write_text("Fix it.\n")
    subprocess.run([*GIT, "add", "."], cwd=project, check=True)
    subprocess.run([*GIT, "commit", "--quiet", "--message", "second"], cwd=project, check=True)
    assert "changes/ has fragments of no version" in refusal(project, TAG="1")


def test_a_tag_that_is_there(project: Path) -> None:
    subprocess.run(["git", "tag", "v1.2.0"], cwd=project, check=True)
    assert refusal(project, TAG="1") == "release: TAG=1: the tag v1.2.0 is there: raise the version in pyproject.toml\n"
