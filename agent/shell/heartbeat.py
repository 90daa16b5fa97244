"""The agent's side of its watchdog: a heartbeat with every step, and its own end after a stall.

Written by hand: no library exits before the event loop runs a callback that would send stale setpoints after a stall.
"""

from __future__ import annotations

import os
import selectors
import signal
import time
from collections.abc import Callable
from contextlib import suppress

HEARTBEAT_FD = 3  # the supervisor's pipe, in the agent
SILENCE_S = 1.0  # after a longer gap between steps the agent ends: the autopilot has taken over, or is about to
SILENT_START_S = 300.0  # without a line before the first step the agent hangs; imports take minutes on an emulated computer
HUNG = 70  # exit code (EX_SOFTWARE): the agent hung, stalled or broke
ANEW = 75  # exit code (EX_TEMPFAIL): to be started again, with another mission
RELOADING = "RELOADING=1"  # to the supervisor and the service manager: the agent closes everything, to be started again
_PR_SET_PDEATHSIG = 1


class Heartbeat:
    """Reports to the supervising process (watchdog) that the agent is alive, and passes lines on to the service manager
    (systemd).

    Lines go through a pipe: an empty line is a heartbeat, any other is for the service manager. Without its supervisor the
    process ends, because a hung process would stay.
    """

    def __init__(self, fd: int | None = None, now_s: Callable[[], float] = time.monotonic) -> None:
        """Set up the heartbeat. ``fd``: file descriptor of the pipe; None: not supervised, but still ended after a stall."""
        self._fd = fd
        self._now_s = now_s
        self._last_s: float | None = None
        if fd is not None:
            os.set_blocking(fd, False)
            os.set_inheritable(fd, False)

    def beat(self) -> None:
        """Report one step of the flight loop. The first heartbeat arms both watchdogs, the supervisor's and this
        process's own.
        """
        self.check()
        self._last_s = self._now_s()
        self._write(b"\n")

    def tell(self, line: str) -> None:
        """Send a line to the service manager, such as ``READY=1`` or ``STATUS=...``."""
        self._write(line.replace("\n", " ").encode()[:512] + b"\n")

    def check(self) -> None:
        """End the process at once if the last heartbeat is too long ago.

        After a stop of the process or a blocked loop, results computed before must not be sent: the autopilot is in its failsafe
        by now. Call it before anything is sent.
        """
        if self._last_s is not None and self._now_s() - self._last_s > SILENCE_S:
            os.write(2, b"radron-agent: stalled for more than 1 s; exiting, so that nothing stale is sent\n")
            os._exit(HUNG)

    def rest(self) -> None:
        """Disarm this process's own watchdog, because no more steps follow."""
        self._last_s = None

    def _write(self, line: bytes) -> None:
        if self._fd is None:
            return
        with suppress(BlockingIOError):  # the pipe of a stopped supervisor is full
            try:
                os.write(self._fd, line)
            except BrokenPipeError:
                os._exit(HUNG)


class StallCheckingSelector(selectors.DefaultSelector):
    """The event loop's selector, with a check for a stall at each wake-up, before any callback of the loop runs."""

    def __init__(self, heartbeat: Heartbeat) -> None:
        super().__init__()
        self._heartbeat = heartbeat

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for events as the base class does, and check for a stall."""
        events = super().select(timeout)
        self._heartbeat.check()
        return events


def die_with(parent: int) -> None:
    """Let the kernel kill this process when its parent, which started it, ends for any reason."""
    import ctypes  # noqa: PLC0415  the supervisor has no use for it

    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # the parent ended before the call
        os._exit(HUNG)
