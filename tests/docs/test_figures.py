"""The scripts that draw the figures of the documentation run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

FIGURES = Path(__file__).parents[2] / "docs" / "figures"


@pytest.mark.slow
def test_the_estimators_figures_are_drawn(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(FIGURES / "estimator.py"), "cone", "--out", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "estimator-cone.png").read_bytes().startswith(b"\x89PNG")
