"""The soak test's parts in lockstep, short ones: an hour of them is not part of the tests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_missions_in_lockstep_are_sampled_and_leave_nothing_over(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "benchmarks/soak.py"), "--lockstep", "10", "--missions", "3", "--live", "0"]
    done = subprocess.run([*command, "--out", str(tmp_path)], capture_output=True, text=True, timeout=600.0, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    long, short = json.loads((tmp_path / "soak.json").read_text())
    assert len(long["time_s"]) >= 2
    assert long["entries"][-1] > long["entries"][0]
    assert len(short["time_s"]) == 3
