"""CONTRIBUTING: two pages, a table with every package, a diagram of files that are there, and a glossary of single terms."""

import re

import pytest

from support import docs_pages

MAX_LINES = 150  # two printed pages
TEXT = (docs_pages.ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
PACKAGES = ("protocol", "agent", "sim", "station", "deploy")


def table(heading):
    """The rows of the first table under a heading: the cells of each."""
    section = TEXT.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def packages(name):
    return [path.parent for path in sorted((docs_pages.ROOT / name).glob("*/__init__.py"))]


def test_it_has_two_pages():
    assert TEXT.count("\n") <= MAX_LINES


def test_every_package_has_an_owner_in_the_table():
    rows = table("Where things are")
    assert len(rows) <= 30
    folders = {name for row in rows for name in re.findall(r"`([^`]+)`", row[0])}
    parts = {f"{row[0].strip('`')}/{name}" for row in rows for name in re.findall(r"`([\w/]+)`", row[1])}
    wanted = {path.relative_to(docs_pages.ROOT).as_posix() for name in PACKAGES for path in packages(name)}
    assert {*PACKAGES, *wanted} - folders - parts == set()
    assert [name for name in folders if not (docs_pages.ROOT / name).is_dir()] == []


def test_the_files_of_the_data_flow_are_there():
    diagram = next(text for language, _, text in docs_pages.FENCE.findall(TEXT) if language == "text")
    named = re.findall(r"[\w/]+\.py", diagram)
    assert len(named) > 10
    assert [name for name in named if not (docs_pages.ROOT / "agent" / name).is_file()] == []


@pytest.mark.parametrize("heading", ["Where it is decided", "Add something"])
def test_each_row_leads_to_code_or_a_page(heading):
    for row in table(heading):
        assert re.search(r"`[\w/]+\.py`|\]\([\w/.#-]+\)", " ".join(row[1:])), row


def test_the_glossary_has_forty_terms_each_of_them_once():
    terms = [term for row in table("Glossary") for term in row[::2]]
    assert 35 <= len(terms) <= 50
    assert len(terms) == len(set(terms))
