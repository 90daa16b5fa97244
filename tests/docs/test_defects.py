"""The defects in ``docs/defects.toml``, and the page that shows them."""

import ast
import re
import sys
from functools import cache
from typing import get_args

import msgspec
import pytest

from support import docs_pages

sys.path.insert(0, str(docs_pages.DOCS / "reference"))
try:
    import defects
finally:
    sys.path.pop(0)

ROWS = defects.defects()
PAGE = docs_pages.DOCS / "faults-found.md"
MAX_SENTENCES = 2
MAX_SENTENCES_OF_A_FIX = 1


def sentences(text):
    return [part for part in re.split(r"(?<=[.!?])\s+(?=[A-Z`])", text) if part]


def shown():
    """The page with its tables."""
    return defects.with_tables(PAGE.read_text(encoding="utf-8"))


@cache
def functions_of(file):
    return {node.name for node in ast.walk(ast.parse((docs_pages.ROOT / file).read_text())) if isinstance(node, ast.FunctionDef)}


def test_ids_are_unique():
    ids = [row.id for row in ROWS]
    assert sorted(set(ids)) == sorted(ids)


@pytest.mark.parametrize("field", ["kind", "status"])
def test_unknown_kind_or_status_is_refused(field, monkeypatch, tmp_path):
    first = msgspec.to_builtins(ROWS[0])
    monkeypatch.setattr(defects, "SOURCE", tmp_path / "defects.toml")
    defects.SOURCE.write_bytes(msgspec.toml.encode({"defect": [first]}))
    assert defects.defects() == ROWS[:1]
    defects.SOURCE.write_bytes(msgspec.toml.encode({"defect": [{**first, field: "other"}]}))
    with pytest.raises(msgspec.ValidationError, match=rf"defect\[0\]\.{field}"):
        defects.defects()


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.id)
def test_rows_are_short(row):
    assert 1 <= len(sentences(row.what)) <= MAX_SENTENCES
    assert len(sentences(row.fix)) <= MAX_SENTENCES_OF_A_FIX
    assert all(text.endswith(".") for text in (row.what, row.fix) if text)


@pytest.mark.parametrize("row", [row for row in ROWS if row.test], ids=lambda row: row.id)
def test_tests_of_rows_exist(row):
    file, _, function = row.test.partition("::")
    assert (docs_pages.ROOT / file).is_file(), f"docs/defects.toml, {row.id}: {file}"
    assert not function or function in functions_of(file), f"docs/defects.toml, {row.id}: {row.test}"


def test_every_row_is_on_the_page_once_under_its_status():
    page = shown()
    assert "<!-- defects" not in page
    for status in get_args(defects.Status):
        section = re.split(r"^## ", page.partition(f"\n## {status.capitalize()}\n")[2], maxsplit=1, flags=re.M)[0]
        found = re.findall(r'^\| <a id="([\w-]+)"></a>', section, re.M)
        assert sorted(found) == sorted(row.id for row in ROWS if row.status == status)


def test_page_explains_every_kind():
    assert re.findall(r"^\| `(\w+)` \|", PAGE.read_text(encoding="utf-8"), re.M) == list(get_args(defects.Kind))


def test_links_of_the_page_resolve():
    """Also the ones within rows, which are not in the written page."""
    page = shown()
    here = docs_pages.anchors(page) | set(re.findall(r'<a id="([\w-]+)">', page))
    for target in docs_pages.links(page):
        file, _, anchor = target.partition("#")
        other = PAGE.parent / file
        assert not file or other.is_file(), target
        known = here if not file else docs_pages.anchors(other.read_text(encoding="utf-8")) if anchor else {""}
        assert anchor in known, target
