"""The generated page of all files, and the rules for a file: a first sentence, and a length that can be read at a sitting."""

import re
import sys

import pytest

from support import docs_pages

MAX_LINES = 400  # of a file in a package (CONTRIBUTING.md)
PACKAGES = ("protocol", "agent", "sim", "station", "deploy")


@pytest.fixture(scope="module")
def files(reference):
    return sys.modules["files"]  # imported with the pages


def test_every_file_of_the_packages_has_a_row_with_its_first_sentence(files, reference):
    sections = re.split(r"^## ", reference["files.md"], flags=re.M)[1:]
    rows = {
        f"{section.split()[0]}/{name}": text.strip()
        for section in sections
        for name, text in re.findall(r"^\| `([^`]+)` \|(.*)\|$", section, re.M)
    }
    expected = [
        path.relative_to(docs_pages.ROOT).as_posix()
        for package in PACKAGES
        for path in (docs_pages.ROOT / package).rglob("*.py")
        if path.name != "__init__.py"
    ]
    assert [path for path in expected if len(rows.get(path, "").split()) < 2] == []


def test_every_package_says_what_it_owns(files):
    inits = [path for path in files.paths() if path.name == "__init__.py" and path.parts[0] in PACKAGES]
    assert [str(path) for path in inits if not files.first_sentence(path)] == []


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        (
            "wrapped.py",
            '"""Poses of the last\nseconds, in metres. Not more.\n\nMore.\n"""\n',
            "Poses of the last seconds, in metres",
        ),
        (
            "cited.py",
            '# a note\n"""Cones (paper, Sec. V-A; Baca et al. 2021). More."""\n',
            "Cones (paper, Sec. V-A; Baca et al. 2021)",
        ),
        ("word.py", '"""Errors on the terminal. More."""\n', "Errors on the terminal"),
        ("commented.py", "# a note\n" * 1000 + "x = 1\n", ""),
        ("bare.py", 'text = """Not a docstring."""\n', ""),
        ("page.js", "// The map: x east,\n// y north. More.\nlet a\n", "The map: x east, y north"),
        ("run.sh", "#!/bin/sh\n# Start of a container.\nset -eu\n# Later.\n", "Start of a container"),
    ],
)
def test_the_first_sentence_is_the_docstrings_or_the_head_comments(files, tmp_path, name, text, sentence):
    (tmp_path / name).write_text(text)
    assert files.first_sentence(tmp_path / name) == sentence


def test_no_file_of_the_packages_is_too_long(files):
    lengths = {path: (docs_pages.ROOT / path).read_text(encoding="utf-8").count("\n") for path in files.paths()}
    assert {str(path): lines for path, lines in lengths.items() if path.parts[0] in PACKAGES and lines > MAX_LINES} == {}
