"""Examination of a drone's computer by its own software, for ``radron-deploy doctor``: the result is fetched and shown."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from radron.agent.doctor.report import Report
from radron.deploy.remote import Host, RemoteError, run

BENCH = "/usr/lib/radron/bench"
_MISSING = f"test -x {BENCH} || {{ echo 'radron is not installed there: run `radron-deploy install`' >&2; exit 2; }}"


def options_of(write: bool, wait_s: float) -> list[str]:
    """Return the command-line options for ``radron-agent doctor``.

    ``write``: correct wrong parameters of the autopilot. ``wait_s``: how long to wait until everything is ready, seconds.
    """
    return ["--json", "--wait", f"{wait_s:g}", *(["--write"] if write else [])]


async def examine(host: Host, options: Sequence[str], tell: Callable[[str], None]) -> Report:
    """Let a drone examine itself (computer, clock, camera, autopilot, swarm), and return its report.

    ``options``: options of ``radron-agent doctor``. ``tell``: called with each line of progress.

    Raises:
        RemoteError: the drone is not reached, in flight, or has no agent.
    """
    # Codes 1 and 3 are results for the drone, not errors of the command.
    command = f"{_MISSING}; {BENCH} doctor {' '.join(options)} 2>&1 || {{ code=$?; test $code = 1 -o $code = 3 || exit $code; }}"
    said = await run(host, command, b"", lambda line: tell(line) if is_progress(line) else None)
    return report_in(said, host.error)


async def examine_here(config: Path | None, options: Sequence[str], tell: Callable[[str], None]) -> Report:
    """Examine the computer on which this program runs, as a drone, and return the report.

    Args:
        config: the drone file; None: the file of the installed agent, which is stopped meanwhile.
        options: options of ``radron-agent doctor``.
        tell: called with each line of progress.

    Raises:
        RemoteError: the computer cannot be examined.
    """
    installed = [BENCH, "doctor"]
    given = [str(Path(sys.executable).parent / "radron-agent"), "doctor", "--config", str(config)]
    command = installed if config is None else given
    if not Path(command[0]).exists():
        raise RemoteError(f"there is no {command[0]}: radron is not installed here; give --config DRONE.toml")
    process = await asyncio.create_subprocess_exec(
        *command, *options, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    assert process.stdout is not None
    said = []
    async for line in process.stdout:
        said.append(line.decode(errors="replace"))
        if is_progress(said[-1]):
            tell(said[-1].rstrip("\n"))
    if await process.wait() not in (0, 1, 3):
        raise RemoteError(
            said[-1].strip().removeprefix("radron-agent: ") if said else f"{command[0]} failed with code {process.returncode}"
        )
    return report_in("".join(said), RemoteError)


def is_progress(line: str) -> bool:
    """Return whether an output line of the examination reports progress; the report or an error follows at the end."""
    return not line.startswith(("{", "radron"))


def report_in(said: str, error: Callable[[str], RemoteError]) -> Report:
    """Read the report from the output of an examination.

    ``error``: makes an error that names the examined computer.

    Raises:
        RemoteError: no report, or a report of another version.
    """
    line = next((line for line in said.splitlines() if line.startswith("{")), None)
    if line is None:
        last = (said.strip().splitlines() or ["nothing"])[-1]
        raise error(f"its doctor gave no report; it said: {last[:200]}")
    try:
        return msgspec.json.decode(line, type=Report)
    except msgspec.MsgspecError as problem:
        raise error(f"its report is of another version of radron ({problem}): install the same one on both") from None
