"""Ctrl-C at any moment ends a command that flies: code 130, one line, no partial file, no worker left."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

# The command itself, which tells of each step of the progress at once.
COMMAND = """
import radron.sim.cli, radron.sim.commands.console
radron.sim.commands.console._PLAIN_EVERY_S = 0.0
radron.sim.cli.main()
"""
SHORT = ("--set", "source.activity_bq=3e10", "--set", "end.track_s=2")  # strong enough for detection within seconds
Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts radron-sim in a process group of its own, as a terminal does; leftover processes are killed in the end."""
    processes: list[subprocess.Popen[str]] = []

    def run(*arguments: object) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-c", COMMAND, *map(str, arguments)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
            env={name: value for name, value in os.environ.items() if not name.endswith("NUM_THREADS")},
        )  # fmt: skip
        processes.append(process)
        return process

    yield run
    for process in processes:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def wait_for(process: subprocess.Popen[str], lines: int, containing: str) -> None:
    """Read the error stream up to so many such lines."""
    assert process.stderr is not None
    seen = 0
    while seen < lines:
        line = process.stderr.readline()
        assert line, "it ended before"
        seen += containing in line


@pytest.mark.slow
@pytest.mark.parametrize("steps", [0, 1, 5, 20])
def test_a_flight(start: Start, tmp_path: Path, steps: int) -> None:
    process = start("run", "paper-demo", "--out", tmp_path / "out", "--json", tmp_path / "result.json")
    wait_for(process, 1, "preparing")
    wait_for(process, steps, "x real time")
    os.killpg(process.pid, signal.SIGINT)
    output, errors = process.communicate(timeout=30.0)
    assert process.returncode == 130
    assert output in ("", "Solver interrupted\n")  # OSQP says so where the signal went to another thread
    progress = ("x real time", "preparing")
    said = [line for line in errors.splitlines() if not any(words in line for words in progress)]
    assert said == ["paper-demo: interrupted; nothing is written"]
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.slow
def test_a_campaign_goes_on_where_it_was_interrupted(start: Start, tmp_path: Path) -> None:
    arguments = ("campaign", "paper-static-solo", "--runs", 3, "--workers", 2, "--out", tmp_path, "--estimator", "paper", *SHORT)
    process = start(*arguments)
    wait_for(process, 1, "1 of 3 runs")
    workers = psutil.Process(process.pid).children(recursive=True)
    os.killpg(process.pid, signal.SIGINT)
    output, errors = process.communicate(timeout=30.0)
    assert process.returncode == 130
    assert output in ("", "Solver interrupted\n")  # OSQP says so where the signal went to another thread
    said = [line for line in errors.splitlines() if " of 3 runs" not in line]
    assert len(said) == 1
    assert said[0].startswith("campaign: interrupted; ")
    _, alive = psutil.wait_procs(workers, timeout=10.0)
    assert not alive
    kept = (tmp_path / "runs.jsonl").read_text()
    assert 1 <= len(kept.splitlines()) < 3
    again = start(*arguments)
    _, errors = again.communicate(timeout=300.0)
    assert again.returncode == 0
    assert f"{len(kept.splitlines())} of 3 runs exist already" in errors
    assert sorted(json.loads(line)["seed"] for line in (tmp_path / "runs.jsonl").read_text().splitlines()) == [0, 1, 2]
    assert set(kept.splitlines()) <= set((tmp_path / "runs.jsonl").read_text().splitlines())
