"""The list of tests that are known to pass on a second try."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
LISTED = tomllib.loads((ROOT / "tests/flaky.toml").read_text())["test"]


def test_each_flaky_test_exists_and_has_a_cause():
    for row in LISTED:
        path, name = row["id"].split("::")
        assert f"def {name.split('[')[0]}(" in (ROOT / path).read_text(), f"{row['id']}: no such test; take out its row"
        assert row["seen"]
        assert row["cause"]
    assert len({row["id"] for row in LISTED}) == len(LISTED)
