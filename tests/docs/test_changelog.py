"""Changelog: fragments that a release can collect, and a page for each version."""

import re
import tomllib

import pytest

from support import docs_pages

CONFIG = tomllib.loads((docs_pages.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["towncrier"]
KINDS = [kind["directory"] for kind in CONFIG["type"]]
CHANGELOG = docs_pages.ROOT / CONFIG["filename"]
MAX_PAGE_LINES = 80


def fault(name, text):
    """What keeps a fragment from its release; None if nothing does."""
    if not re.fullmatch(rf"\+[a-z0-9]+(-[a-z0-9]+)*\.({'|'.join(KINDS)})\.md", name):
        return f"{name}: not +NAME.KIND.md, with small letters, digits and hyphens; kinds: {', '.join(KINDS)}"
    if not text.strip().endswith("."):
        return f"{name}: no sentence"
    return None


def test_fragments_are_well_named():
    files = (docs_pages.ROOT / CONFIG["directory"]).glob("*")
    assert [found for file in files if (found := fault(file.name, file.read_text(encoding="utf-8")))] == []


@pytest.mark.parametrize("name", ["clock.fixed.md", "+clock.repaired.md", "+Clock.fixed.md", "+clock.fixed.txt", "+clock.md"])
def test_fragments_with_bad_names_are_found(name):
    assert (
        fault(name, "Fix it.") == f"{name}: not +NAME.KIND.md, with small letters, digits and hyphens; kinds: {', '.join(KINDS)}"
    )


def test_fragments_without_a_sentence_are_found():
    assert fault("+clock-steps.fixed.md", "\n") == "+clock-steps.fixed.md: no sentence"
    assert fault("+clock-steps.fixed.md", "Fix steps of a clock.\n") is None


def test_each_version_has_a_page():
    text = CHANGELOG.read_text(encoding="utf-8")
    start = "<!-- towncrier release notes start -->"
    assert text.count(start) == 1
    head, *pages = text.partition(start)[2].split("\n## ")
    assert head.strip() == ""
    assert pages
    for page in pages:
        assert re.match(r"\d+\.\d+\.\d+( \(\d{4}-\d\d-\d\d\))?\n", page), page.splitlines()[0]
        assert page.count("\n") <= MAX_PAGE_LINES
