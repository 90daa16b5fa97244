"""The pages of the documentation, and the code blocks, links and headings in them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[3]
DOCS = ROOT / "docs"
FENCE = re.compile(r"^ {0,3}```(\w*)([^\n]*)\n(.*?)^ {0,3}```\s*$", re.M | re.S)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
TARGETS = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.M)


class Block(NamedTuple):
    """A fenced block: its language, what its title names, and its text."""

    language: str
    title: str
    text: str


def written() -> list[Path]:
    """README, CONTRIBUTING and all pages that are written by hand."""
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]


def blocks(page: Path) -> list[Block]:
    """The fenced code blocks of a page."""
    found = FENCE.finditer(page.read_text(encoding="utf-8"))
    return [Block(language, _title(rest), text) for language, rest, text in (match.groups() for match in found)]


def files(page: Path, folder: Path) -> list[Path]:
    """Write a page's blocks titled with a file name into ``folder``, as a reader would; returns which."""
    written = []
    for block in blocks(page):
        if block.title:
            path = folder / block.title
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
            written.append(path)
    return written


def links(text: str) -> list[str]:
    """The targets of all links, code left out."""
    return LINK.findall(re.sub(r"`[^`]*`", "", FENCE.sub("", text)))


def anchors(text: str) -> set[str]:
    """The names that headings can be linked by."""
    names = set()
    for heading in re.findall(r"^#+ (.*)$", FENCE.sub("", text), re.M):
        given = re.search(r"\{ *#([\w-]+) *\}", heading)
        plain = re.sub(r"[^\w\- ]", "", re.sub(r"\{.*\}", "", heading).strip().lower())
        names.add(given.group(1) if given else re.sub(r"[ -]+", "-", plain))
    return names


def _title(rest: str) -> str:
    found = re.search(r'title="([^"]+)"', rest)
    return found.group(1) if found else ""


def toml(text: str) -> dict[str, Any]:
    """A block of TOML as a document."""
    return tomllib.loads(text)
