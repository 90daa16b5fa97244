"""`make px4-test` from the start of the instances to the report, on emulated vehicles that stand in for PX4's binary.

As with a real PX4: its arguments, environment and ports; the true state and the failsafe come by the ground-station link.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import psutil
import pytest

from support.live.run import stretched
from support.px4.ports import px4_ports

PROGRAM = Path(sysconfig.get_path("scripts")) / "radron-sim"
STANDIN = Path(__file__).parents[1] / "lib/support/px4/flying_standin.py"
LONGEST_S = 400.0


@pytest.mark.slow
def test_instances_of_a_binary_are_flown_and_judged_by_their_simulations_truth(tmp_path: Path) -> None:
    binary = tmp_path / "build" / "bin" / "px4"
    binary.parent.mkdir(parents=True)
    binary.write_text(f'#!/bin/sh\nexec {sys.executable} {STANDIN} "$@"\n')
    binary.chmod(0o755)
    rest = {name: value for name, value in os.environ.items() if not name.startswith("PX4_")}
    with px4_ports():
        done = subprocess.run(
            [PROGRAM, "px4-test", "--only", "killed", "--out", tmp_path / "out"],
            env=rest | {"PX4_BIN": str(binary)}, capture_output=True, text=True, timeout=LONGEST_S, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        left = [each for each in psutil.process_iter(["cmdline"]) if str(STANDIN) in (each.info["cmdline"] or ())]
        assert not left
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["truth"] == "simulation"
    assert report["vehicles"] == f"PX4, {binary}"
    (row,) = report["rows"]
    assert row["failures"] == []
    assert row["figures"]["failsafe after s"] < stretched(1.3)  # by the text; the heartbeat shows it up to 1 s later
    assert (tmp_path / "out" / "killed" / "map.png").stat().st_size > 10_000
