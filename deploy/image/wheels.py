"""Python packages of the agent as wheels for an onboard computer's Python, in pinned versions."""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

from radron.deploy.image.errors import ImageError
from radron.deploy.image.tools import run

_MIN_GLIBC = 5  # of the platform tags of wheels
ONBOARD = ("protocol", "agent")  # packages of this project on board


@dataclass(frozen=True, slots=True)
class Platform:
    """The kind of computer for which Python packages are made.

    ``python``: version of Python. ``machine``: processor as from ``uname -m``. ``glibc``: minor version of the C library, such as
    36 for 2.36.
    """

    python: str
    machine: str
    glibc: int

    @property
    def tags(self) -> list[str]:
        """Platform tags of the Python packages that fit this computer, best first."""
        numbered = [f"manylinux_2_{minor}_{self.machine}" for minor in range(self.glibc, _MIN_GLIBC - 1, -1)]
        return [*numbered, f"manylinux2014_{self.machine}"]


IMAGE = Platform("3.11", "x86_64", 36)  # Debian 12


def make_wheels(
    source: Path, folder: Path, epoch: int, log: Path, platform: Platform = IMAGE, besides: tuple[str, ...] = ()
) -> list[Path]:
    """Fetch and build all Python packages (wheels) of the agent into ``folder``; packages that are there already are kept.

    Args:
        source: the checkout.
        folder: cache of the wheels.
        epoch: date of the files in our own wheel, seconds since 1970.
        log: file to which pip's output is appended.
        platform: target platform of the wheels.
        besides: further packages besides the agent's dependencies.

    Returns:
        The wheels to install, sorted by name.

    Raises:
        ImageError: a package cannot be fetched or built.
    """
    folder.mkdir(parents=True, exist_ok=True)
    needed = tomllib.loads((source / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    with tempfile.TemporaryDirectory(prefix="radron-wheels-") as name:
        work = Path(name)
        report = work / "wheels"
        command = [sys.executable, "-m", "pip", "download", "--dest", str(report), "--find-links", str(folder)]
        command += ["--only-binary=:all:", "--python-version", platform.python, "--implementation", "cp"]
        command += [part for tag in platform.tags for part in ("--platform", tag)]
        try:
            run([*command, "--constraint", str(source / "constraints.txt"), *needed, *besides], log)
        except ImageError as error:
            raise ImageError(_missing(log) or str(error)) from None
        make_own_wheel(source, work, report, epoch, log)
        for wheel in report.iterdir():
            shutil.copyfile(wheel, folder / wheel.name)
        return sorted(folder / wheel.name for wheel in report.iterdir())


def _missing(log: Path) -> str | None:
    """Return the error for the package without a wheel, from pip's log, as its last line does not name it; None if unknown."""
    said = log.read_text(encoding="utf-8", errors="replace").rpartition("\n$ ")[2]
    found = re.search(r"^ERROR: (?:Cannot install|No matching distribution found for) ([A-Za-z0-9._-]+)", said, re.MULTILINE)
    if found is None:
        return None
    return (
        f"there is no wheel of {found[1]} in the pinned version, or the package index is not reached (all that pip said: {log})"
    )


def make_own_wheel(source: Path, work: Path, out: Path, epoch: int, log: Path) -> None:
    """Build this project's own Python package (wheel) with the parts that run on board.

    The package is built from a copy, so that no stray file of the checkout gets on board.

    Raises:
        ImageError: the wheel cannot be built.
    """
    copy = work / "source"
    copy.mkdir()
    for file in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copyfile(source / file, copy / file)
    for package in ONBOARD:
        shutil.copytree(source / package, copy / package, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(out), str(copy)]
    try:
        run(command, log, env={"SOURCE_DATE_EPOCH": str(epoch)})
    except ImageError as error:
        raise ImageError(f"radron's own package: {error}") from None
