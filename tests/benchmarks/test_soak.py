"""The soak test's parts in lockstep, short ones: an hour of them is not part of the tests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from soak import Series

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


def test_a_flight_that_was_over_early_and_memory_that_grows_are_flaws() -> None:
    series = Series("agent", until_s=3600.0)
    for place in range(100):
        series.add(10.0 * place, 100 * place, 100.0 + 0.3 * place, {"threads": 3 + (place > 80)})
    early, slope = series.flaws
    assert early == "agent: over after 990 s of 3600 s"
    assert slope == "agent: 3000 B for each entry, and 2000 are allowed"
