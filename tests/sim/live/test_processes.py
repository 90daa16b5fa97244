"""Processes that do not outlive their parent."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil

from radron.sim.live.processes import Child

STUBBORN = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); time.sleep(60)"
PARENT = """
import asyncio, sys
from radron.sim.live.processes import Child
async def main():
    child = await Child.start("sleeper", ["sleep", "60"])
    print(child.pid, flush=True)
    await asyncio.sleep(60)
asyncio.run(main())
"""


def until_gone(pid: int, within_s: float) -> None:
    deadline_s = time.monotonic() + within_s
    while psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < deadline_s, f"{pid} is still there"
        time.sleep(0.02)


def test_a_child_dies_with_a_parent_that_is_killed() -> None:
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    try:
        pid = int(parent.stdout.readline())
        assert psutil.pid_exists(pid)
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.communicate()
    until_gone(pid, 20.0)


def test_a_child_that_does_not_end_is_killed() -> None:
    async def course() -> tuple[int | None, float]:
        child = await Child.start("stubborn", [sys.executable, "-c", STUBBORN], piped=True)
        await child.stdout.readline()
        began_s = time.monotonic()
        await child.stop(0.3)
        return child.exit_code, time.monotonic() - began_s

    code, took_s = asyncio.run(course())
    assert code == -signal.SIGKILL
    assert 0.3 <= took_s < 20.0  # by itself it would end after 60 s


def test_what_it_said_last_is_kept_and_nobodys_settings_reach_it(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("RADRON_ID", "somebody-else")
    script = "import os, sys; print('first', file=sys.stderr); sys.exit('RADRON_ID is ' + os.environ.get('RADRON_ID', 'not set'))"

    async def course() -> Child:
        child = await Child.start("talker", [sys.executable, "-c", script], log=tmp_path / "log")
        async with asyncio.timeout(10.0):
            while child.exit_code is None:
                await asyncio.sleep(0.02)
        await child.stop(1.0)
        return child

    child = asyncio.run(course())
    assert child.exit_code == 1
    assert child.last_line() == "RADRON_ID is not set"
