"""Child processes that never outlive their parent, however it ends."""

from __future__ import annotations

import asyncio
import ctypes
import os
import signal
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

_PR_SET_PDEATHSIG = 1
_OVERRIDES = "RADRON_"  # environment overrides for another agent are not passed on: these agents have their files
_PRCTL = ctypes.CDLL(None, use_errno=True).prctl
KILL_S = 2.0  # time for a killed process to be gone; else it is stuck in the kernel


class Child:
    """A child process in a session of its own. The kernel kills it when its parent ends."""

    def __init__(self, name: str, process: asyncio.subprocess.Process, log: Path | None) -> None:
        """Use :meth:`start` to start a process."""
        self.name = name
        self._process = process
        self._log = log

    @classmethod
    async def start(
        cls,
        name: str,
        command: Sequence[str],
        *,
        log: Path | None = None,
        append: bool = False,
        piped: bool = False,
        folder: Path | None = None,
        extra: Mapping[str, str] = MappingProxyType({}),
    ) -> Child:
        """Start a child process.

        Args:
            name: for messages.
            command: program and arguments.
            log: file for its standard error; None: this process's own.
            append: continue the log of an earlier process.
            piped: connect its standard input and output to ``stdin`` and ``stdout``; else it has none.
            folder: working directory; None: this process's. With one, its standard output goes into the log too.
            extra: additional environment variables.
        """
        pipe = asyncio.subprocess.PIPE if piped else asyncio.subprocess.DEVNULL
        environment = {name: value for name, value in os.environ.items() if not name.startswith(_OVERRIDES)}
        with log.open("ab" if append else "wb") if log is not None else open(os.dup(2), "wb") as errors:
            process = await asyncio.create_subprocess_exec(
                *command,
                stdin=pipe,
                stdout=pipe if folder is None else errors,
                stderr=errors,
                cwd=folder,
                env=environment | dict(extra),
                start_new_session=True,
                preexec_fn=_die_with(os.getpid()),
            )
        return cls(name, process, log)

    @property
    def pid(self) -> int:
        """Process id, which is also the id of its process group."""
        return self._process.pid

    @property
    def stdin(self) -> asyncio.StreamWriter:
        """Standard input of a piped process."""
        assert self._process.stdin is not None
        return self._process.stdin

    @property
    def stdout(self) -> asyncio.StreamReader:
        """Standard output of a piped process."""
        assert self._process.stdout is not None
        return self._process.stdout

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process; None while it runs."""
        return self._process.returncode

    async def ended(self) -> None:
        """Wait for the end of the process."""
        await self._process.wait()

    def last_line(self) -> str:
        """Last line of the process's log; empty without one."""
        if self._log is None:
            return ""
        with self._log.open(encoding="utf-8", errors="replace") as lines:
            last = deque((line.strip() for line in lines if line.strip()), maxlen=1)
        return last[0] if last else ""

    async def stop(self, grace_s: float) -> None:
        """End the process by SIGTERM and the end of its input; after ``grace_s`` seconds kill its process group."""
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
        self._process._transport.close()  # type: ignore[attr-defined]  # or it complains once the loop is closed


def _die_with(parent: int) -> Callable[[], None]:
    def arm() -> None:
        _PRCTL(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # the parent has ended already
            os._exit(1)

    return arm
