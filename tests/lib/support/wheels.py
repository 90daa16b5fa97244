"""Wheels as a release has them, built from copies of the sources alone."""

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("protocol", "agent", "sim", "station", "deploy")
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")


def wheel_of(source: Path, folder: Path) -> Path:
    """Build the wheel of a project into an empty folder."""
    command = (*PIP, "wheel", source, "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", folder)
    subprocess.run(command, check=True, cwd=folder)
    (wheel,) = folder.glob("*.whl")
    return wheel


def radron_wheel(folder: Path) -> Path:
    """Build the wheel of radron from a copy of its sources below ``folder``."""
    source, out = folder / "source", folder / "wheel"
    out.mkdir()
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    return wheel_of(source, out)
