"""Planted bugs: mistakes on purpose, each a replacement of text in one file, applied to a copy of the packages.

To get the packages with one of them into a folder, and to fly them by PYTHONPATH=FOLDER:

    python tests/faults/planted/bugs.py ID FOLDER
"""

from __future__ import annotations

import hashlib
import shutil
import sys
import tomllib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("agent", "protocol", "sim")
NAMESPACE = "radron"  # folder of a copy: its packages are imported by this name
LISTS = {"written": "written.toml", "drawn": "drawn.toml"}


class BugError(Exception):
    """A bug that is not well-formed, or does not fit the code any more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bug:
    """A mistake: in ``file`` (from the root of the repository) the text ``old``, which occurs there once, becomes ``new``.

    ``origin``: written or drawn. ``live``: code of the processes around the pilot program, which lockstep does not run.
    ``reach``: the features of missions that exercise that code: kinds of faults, messages that an autopilot does not send
    any more, "estimated" frames, a "moving" source.
    """

    id: str
    origin: str
    subject: str
    title: str
    file: str
    old: str
    new: str
    harm: str = ""
    live: bool = False
    reach: tuple[str, ...] = ()

    def changed(self, text: str) -> str:
        """The file's text with the bug.

        Raises:
            BugError: the old text does not occur exactly once.
        """
        count = text.count(self.old)
        if not self.old or count != 1:
            raise BugError(f"{self.id}: its old text occurs {count} times in {self.file}: write the same mistake into the code")
        return text.replace(self.old, self.new)

    def plant(self, root: Path) -> None:
        """Change the file in a copy of the packages; raises BugError."""
        path = root / self.file
        if not path.is_file():
            raise BugError(f"{self.id}: there is no {self.file} any more; write the same mistake where that code is now")
        path.write_text(self.changed(path.read_text(encoding="utf-8")), encoding="utf-8")


def load_bugs(folder: Path = Path(__file__).parent) -> list[Bug]:
    """All bugs, the written ones first; raises BugError for a bad entry and for an id that is used twice."""
    bugs = [bug for origin, name in LISTS.items() for bug in _read(folder / name, origin)]
    twice = [name for name, count in Counter(bug.id for bug in bugs).items() if count > 1]
    if twice:
        raise BugError(f"ids that are used twice: {', '.join(twice)}")
    return bugs


def copy_packages(root: Path, to: Path) -> None:
    """Copy the packages, with their compiled code; times are kept, so that it stays valid."""
    for package in PACKAGES:
        shutil.copytree(root / package, to / package)


def fingerprint(root: Path) -> str:
    """A hash of the packages' sources and data: findings are valid for these only."""
    digest = hashlib.blake2b(digest_size=8)
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _read(path: Path, origin: str) -> list[Bug]:
    try:
        return [
            Bug(origin=origin, **(entry | {"reach": tuple(entry.get("reach", ()))}))
            for entry in tomllib.loads(path.read_text(encoding="utf-8")).get("bug", [])
        ]
    except (TypeError, tomllib.TOMLDecodeError) as error:
        raise BugError(f"{path.name}: {error}") from None


def main() -> None:
    """Write the packages with one bug into a folder."""
    if len(sys.argv) != 3:
        sys.exit((__doc__ or "").strip())
    wanted, folder = sys.argv[1], Path(sys.argv[2])
    bug = next((bug for bug in load_bugs() if bug.id == wanted), None)
    if bug is None:
        sys.exit(f"no bug {wanted!r}: the ids are in {', '.join(LISTS.values())} beside this script")
    copy_packages(ROOT, folder / NAMESPACE)
    bug.plant(folder / NAMESPACE)


if __name__ == "__main__":
    main()
