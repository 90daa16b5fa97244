"""The package as users install it: a wheel, imported from outside the tree."""

import os
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

from support.wheels import PACKAGES, PIP, ROOT, radron_wheel

FOLDERS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-dir"]


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
    """A folder with the installed wheel: the one named by WHEEL, or one built from a copy of the sources alone."""
    folder = tmp_path_factory.mktemp("wheel")
    target, given = folder / "installed", os.environ.get("WHEEL")
    wheel = Path(given) if given else radron_wheel(folder)
    run(*PIP, "install", wheel, "--no-deps", "--no-index", "--target", target, cwd=folder)
    return target


def test_every_module_of_the_tree_is_in_the_wheel(installed: Path) -> None:
    for package in PACKAGES:
        expected = {path.relative_to(ROOT) for path in (ROOT / package).rglob("*.py")}
        place = installed / "radron"
        assert expected == {path.relative_to(place) for path in (place / package).rglob("*.py")}
    assert not [package for package in PACKAGES if (installed / package).exists()]


def test_it_is_imported_from_outside_the_tree(installed: Path, tmp_path: Path) -> None:
    names = ", ".join(PACKAGES)
    code = f"from radron import {names}; import radron.sim.lockstep.flight\nfor module in ({names}): print(module.__file__)"
    places = run(sys.executable, "-c", code, cwd=tmp_path, PYTHONPATH=str(installed)).split()
    assert places == [str(installed / "radron" / package / "__init__.py") for package in PACKAGES]


@pytest.mark.parametrize("package", PACKAGES)
def test_tests_know_each_module_by_one_name(package: str) -> None:
    """With the root on the path, a test could change `agent.x`, a second module beside the tested `radron.agent.x`."""
    assert FOLDERS[f"radron.{package}"] == package
    assert find_spec(f"radron.{package}") is not None
    assert find_spec(package) is None, "run the tests by the command pytest, not by python -m pytest"


@pytest.mark.parametrize("folder", ["station/page", "deploy/image/contents", "deploy/computer/contents"])
def test_the_data_of_the_packages_are_inside(installed: Path, folder: str) -> None:
    shipped = {path.relative_to(ROOT) for path in (ROOT / folder).rglob("*") if path.is_file()}
    place = installed / "radron"
    assert shipped == {path.relative_to(place) for path in (place / folder).rglob("*") if path.is_file()}
    assert len(shipped) > 2


def test_the_shipped_scenarios_are_inside(installed: Path) -> None:
    shipped = sorted(path.name for path in (ROOT / "sim/scenarios").glob("*.toml"))
    assert "demo.toml" in shipped
    assert sorted(path.name for path in (installed / "radron/sim/scenarios").iterdir() if path.suffix == ".toml") == shipped


@pytest.mark.parametrize("command", ["radron-agent", "radron-sim"])
def test_its_commands_answer(installed: Path, tmp_path: Path, command: str) -> None:
    assert "Usage" in run(sys.executable, installed / "bin" / command, "--help", cwd=tmp_path, PYTHONPATH=str(installed))
