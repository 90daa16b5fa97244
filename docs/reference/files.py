"""The page of all files: each with the first sentence of its docstring, or of the comment at its head."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

import fields

ROOT = Path(__file__).parents[2]
TREES = (
    "protocol",
    "agent",
    "sim",
    "station",
    "deploy",
    "benchmarks",
    "docs",
    "tests/lib/support",
    "tests/fuzz",
    "tests/faults/planted",
)
KINDS = {".py": "", ".js": "//", ".sh": "#"}  # suffix -> mark of a comment; Python has docstrings
_LIBRARIES = "leaflet"  # a folder of files as released by their authors
_END = re.compile(r"(?<!\bSec)(?<!\bEq)(?<!\bal)\.(?=\s|$)")

_INTRO = """# Files

Every file of the packages, the benchmarks, the generators of the documentation and the test tools, by folder. Each line is the
first sentence of the file's docstring. The tests have the folders of the packages. Where to start:
`CONTRIBUTING.md` has a table of folders, the flow of the data and the places of the decisions.

This page is generated from the files.
"""


def paths() -> list[Path]:
    """Return all listed files, relative to the root, by folder."""
    found = (path.relative_to(ROOT) for tree in TREES for path in (ROOT / tree).rglob("*") if path.suffix in KINDS)
    return sorted((path for path in found if _LIBRARIES not in path.parts), key=lambda path: (path.parent.parts, path.name))


def first_sentence(path: Path) -> str:
    """Return the first sentence of a file's docstring or head comment in one line; empty without either."""
    text = (ROOT / path).read_text(encoding="utf-8")
    mark = KINDS[path.suffix]
    head = _comment(text, mark) if mark else ast.get_docstring(ast.parse(text)) or ""
    line = " ".join(head.strip().split("\n\n")[0].split())
    end = _END.search(line)
    return line[: end.start()] if end else line.rstrip(":;,")


def page() -> str:
    """Return the page as Markdown: a section for each folder."""
    folders: dict[str, list[Path]] = defaultdict(list)
    for path in paths():
        folders[path.parent.as_posix()].append(path)
    return "\n".join([_INTRO, *(_section(folder, files) for folder, files in folders.items())])


def _section(folder: str, files: list[Path]) -> str:
    about = "".join(f"{_cell(path)}.\n\n" for path in files if path.name == "__init__.py" and first_sentence(path))
    rows = "".join(f"| `{path.name}` | {_cell(path)} |\n" for path in files if path.name != "__init__.py")
    table = f"| file | content |\n|---|---|\n{rows}" if rows else ""
    return f"## {folder} {{ #{re.sub(r'[^a-z0-9]+', '-', folder.lower())} }}\n\n{about}{table}"


def _cell(path: Path) -> str:
    text = fields.markdown(first_sentence(path)).replace("|", "\\|")
    return "".join(part if place % 2 else fields.markdown_line(part) for place, part in enumerate(re.split(r"(`[^`]*`)", text)))


def _comment(text: str, mark: str) -> str:
    """Return the block of comment lines at the head of a file; a shebang does not count."""
    lines: list[str] = []
    for line in text.splitlines():
        if line.startswith(mark) and not line.startswith("#!"):
            lines.append(line.removeprefix(mark).strip())
        elif lines:
            break
    return "\n".join(lines)
