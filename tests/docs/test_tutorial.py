"""The tutorial's own scenario and own figure, written into an empty folder and run there."""

import os
import subprocess
import sys

import pytest

from support import docs_pages


@pytest.mark.slow
def test_the_own_scenario_flies_and_the_own_figure_is_drawn(tmp_path):
    written = docs_pages.files(docs_pages.DOCS / "tutorial.md", tmp_path)
    assert {path.name for path in written} == {"corner.toml", "figure.py"}
    environment = {**os.environ, "MPLBACKEND": "agg"}
    run = subprocess.run(
        [sys.executable, "figure.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("Source estimate: (5")  # at (55, 5) m
    assert (tmp_path / "corner.png").stat().st_size > 10_000
