"""The package as users install it: a wheel, imported from outside the tree."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("protocol", "agent", "sim", "station", "deploy")


def run(*command: str | Path, cwd: Path, **environment: str) -> str:
    """Run a command and return its output; its error text if it fails."""
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the installed wheel, built from a copy of the tree that holds nothing but the sources."""
    folder = tmp_path_factory.mktemp("wheel")
    source, target = folder / "source", folder / "installed"
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")
    run(*pip, "wheel", ".", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, cwd=source)
    (wheel,) = folder.glob("radron-*.whl")
    run(*pip, "install", wheel, "--no-deps", "--no-index", "--target", target, cwd=folder)
    return target


def test_every_module_of_the_tree_is_in_the_wheel(installed: Path) -> None:
    for package in PACKAGES:
        expected = {path.relative_to(ROOT) for path in (ROOT / package).rglob("*.py")}
        assert expected == {path.relative_to(installed) for path in (installed / package).rglob("*.py")}


def test_it_is_imported_from_outside_the_tree(installed: Path, tmp_path: Path) -> None:
    names = ", ".join(PACKAGES)
    code = f"import {names}, agent.pilot, sim.lockstep.flight\nfor module in ({names}): print(module.__file__)"
    places = run(sys.executable, "-c", code, cwd=tmp_path, PYTHONPATH=str(installed)).split()
    assert places == [str(installed / package / "__init__.py") for package in PACKAGES]


def test_the_shipped_scenarios_are_inside(installed: Path) -> None:
    shipped = sorted(path.name for path in (ROOT / "sim/scenarios").glob("*.toml"))
    assert "demo.toml" in shipped
    assert sorted(path.name for path in (installed / "sim/scenarios").iterdir() if path.suffix == ".toml") == shipped


@pytest.mark.parametrize("command", ["radron-agent", "radron-sim"])
def test_its_commands_answer(installed: Path, tmp_path: Path, command: str) -> None:
    assert "Usage" in run(sys.executable, installed / "bin" / command, "--help", cwd=tmp_path, PYTHONPATH=str(installed))
