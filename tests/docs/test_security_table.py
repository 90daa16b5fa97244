"""The table of threats names tests that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROWS = [line for line in (ROOT / "docs" / "security.md").read_text().splitlines() if re.match(r"\|.*\| `test_\w+\.py`", line)]


@pytest.mark.parametrize("row", ROWS)
def test_each_threat_has_a_test(row: str) -> None:
    names: list[str] = []
    for word in re.findall(r"`([\w.]+)`", row.rsplit(" | ", maxsplit=1)[-1]):
        if word.endswith(".py"):
            names = [name for file in ROOT.glob(f"tests/**/{word}") for name in re.findall(r"def (test_\w+)", file.read_text())]
            assert names
        else:
            assert any(word in name for name in names), word


def test_there_are_thirty_attacks_and_more() -> None:
    assert len(ROWS) > 30
