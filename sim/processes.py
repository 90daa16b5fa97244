"""Processes that do not outlive the one that started them, however that one ends."""

from __future__ import annotations

import asyncio
import ctypes
import os
import signal
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_OVERRIDES = "RADRON_"  # what somebody has set for another agent is not for ours: they have their files
_PRCTL = ctypes.CDLL(None, use_errno=True).prctl
KILL_S = 2.0  # what was killed is gone by then, or stuck in the kernel


class Child:
    """A process in a session of its own. The kernel kills it when its parent has gone."""

    def __init__(self, name: str, process: asyncio.subprocess.Process, log: Path | None) -> None:
        """Use :meth:`start`."""
        self.name = name
        self._process = process
        self._log = log

    @classmethod
    async def start(cls, name: str, command: Sequence[str], *, log: Path | None = None, piped: bool = False) -> Child:
        """Start a process; no Zenoh session may be open yet, as that does not survive a fork.

        Args:
            name: for messages.
            command: its words.
            log: file for its error stream; none: this process's own.
            piped: its standard input and output are ``stdin`` and ``stdout``; else it has none.
        """
        pipe = asyncio.subprocess.PIPE if piped else asyncio.subprocess.DEVNULL
        environment = {name: value for name, value in os.environ.items() if not name.startswith(_OVERRIDES)}
        with log.open("wb") if log is not None else open(os.dup(2), "wb") as errors:
            process = await asyncio.create_subprocess_exec(
                *command,
                stdin=pipe,
                stdout=pipe,
                stderr=errors,
                env=environment,
                start_new_session=True,
                preexec_fn=_dies_with(os.getpid()),
            )
        return cls(name, process, log)

    @property
    def pid(self) -> int:
        """Process id, that of its process group too."""
        return self._process.pid

    @property
    def stdin(self) -> asyncio.StreamWriter:
        """Of a piped process."""
        assert self._process.stdin is not None
        return self._process.stdin

    @property
    def stdout(self) -> asyncio.StreamReader:
        """Of a piped process."""
        assert self._process.stdout is not None
        return self._process.stdout

    @property
    def exit_code(self) -> int | None:
        """None while it runs."""
        return self._process.returncode

    def last_line(self) -> str:
        """The last thing in its log."""
        if self._log is None:
            return ""
        with self._log.open(encoding="utf-8", errors="replace") as lines:
            last = deque((line.strip() for line in lines if line.strip()), maxlen=1)
        return last[0] if last else ""

    async def stop(self, grace_s: float) -> None:
        """Ask it to end, by SIGTERM and the end of its input; after ``grace_s`` kill its whole group."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        with suppress(ProcessLookupError):
            self._process.terminate()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._process.wait(), grace_s)
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)
        with suppress(TimeoutError):
            await asyncio.wait_for(self._process.wait(), KILL_S)


def _dies_with(parent: int) -> Callable[[], None]:
    def arm() -> None:
        _PRCTL(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before
            os._exit(1)

    return arm
