"""The watchdog: a small process that starts the agent, and ends it when it hangs, so that the autopilot's failsafe takes over.

It is a process of its own because a thread stops with the interpreter's lock. It imports nothing that is not needed for this.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress

from agent.beat import BEAT_FD, HUNG, SILENCE_S
from agent.systemd import VARIABLES, Notifier

STOP_S = 1.5  # a stopping agent gets so long to close everything
_STOPS = (signal.SIGTERM, signal.SIGINT)
_NUMERICS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # unless set: a flight is one thread, and small matrices


class Supervisor:
    """Runs one agent to its end. Single-threaded: all it waits for is in one poll."""

    def __init__(self, command: Sequence[str]) -> None:
        """``command``: the agent's; it gets the supervisor's process id as a last argument, and the pipe as file 3."""
        self._command = [*command, str(os.getpid())]
        self._notifier = Notifier()
        self._scratch = os.path.join(os.environ.get("TMPDIR", "/tmp"), f"radron-agent-{os.getpid()}")
        self._stopping = False
        self._deadline_s: float | None = None  # when the agent is killed unless it is heard of
        self._verdict: str | None = None  # why it was killed

    def run(self) -> int:
        """Start the agent and watch it. Returns its exit code: 0 where it was stopped by a signal, 70 where it hung.

        What the agent's libraries leave in the folder of temporary files goes with it, also when it was killed: MAVSDK makes a
        folder there at each start and removes none.
        """
        with suppress(OSError):
            os.mkdir(self._scratch, 0o700)
        try:
            return self._watch()
        finally:
            import shutil  # noqa: PLC0415  not held in memory during the flight

            shutil.rmtree(self._scratch, ignore_errors=True)

    def _watch(self) -> int:
        wakes, wake = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        for number in (*_STOPS, signal.SIGCHLD):
            signal.signal(number, lambda *_: None)  # the wake-up pipe tells which
        beats, child = self._start()
        poll = select.poll()
        poll.register(wakes, select.POLLIN)
        poll.register(beats, select.POLLIN)
        while True:
            poll.poll(self._patience_ms())
            self._hear(beats, poll)
            self._obey(_read(wakes), child)
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                self._notifier.tell("STOPPING=1")
                return self._exit_code(status)
            self._judge(child)

    def _start(self) -> tuple[int, int]:
        """The reading end of the beats' pipe, and the agent's process id."""
        beats, beat = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        environment = {key: value for key, value in (_NUMERICS | os.environ).items() if key not in VARIABLES}
        if os.path.isdir(self._scratch):
            environment["TMPDIR"] = self._scratch
        child = os.posix_spawn(
            self._command[0],
            self._command,
            environment,
            file_actions=[(os.POSIX_SPAWN_DUP2, beat, BEAT_FD)],
            setsigdef=[*_STOPS, signal.SIGCHLD],
        )
        os.close(beat)
        return beats, child

    def _patience_ms(self) -> int | None:
        return None if self._deadline_s is None else max(0, int(1000 * (self._deadline_s - time.monotonic())) + 1)

    def _hear(self, beats: int, poll: select.poll) -> None:
        """Take the agent's lines: beats, and what is meant for the service manager."""
        data = _read(beats)
        if data is None:  # the agent has closed the pipe: it is ending
            with suppress(KeyError):
                poll.unregister(beats)
            return
        lines = [line.decode(errors="replace") for line in data.split(b"\n")[:-1]]
        if "" in lines and not self._stopping:
            self._deadline_s = time.monotonic() + SILENCE_S
            self._notifier.alive()
        told = [line for line in lines if line]
        if told:
            self._notifier.tell(*told)

    def _obey(self, numbers: bytes | None, child: int) -> None:
        """Pass a request to stop on to the agent, once."""
        if self._stopping or not numbers or not any(number in numbers for number in _STOPS):
            return
        self._stopping = True
        self._deadline_s = time.monotonic() + STOP_S
        self._notifier.tell("STOPPING=1")
        os.kill(child, signal.SIGTERM)

    def _judge(self, child: int) -> None:
        """Kill the agent where its time is up."""
        if self._deadline_s is None or time.monotonic() < self._deadline_s:
            return
        what = f"did not end within {STOP_S:g} s" if self._stopping else f"no sign of life for {SILENCE_S:g} s"
        self._verdict = f"{what}: killed"
        self._deadline_s = None
        os.kill(child, signal.SIGKILL)  # works on a stopped process too

    def _exit_code(self, status: int) -> int:
        if self._verdict is not None:
            print(f"radron-agent: {self._verdict}", file=sys.stderr)
            return HUNG
        if os.WIFEXITED(status):
            return os.WEXITSTATUS(status)
        number = os.WTERMSIG(status)
        if self._stopping and number in _STOPS:  # it was not yet up
            return 0
        print(f"radron-agent: ended by {signal.Signals(number).name}", file=sys.stderr)
        return 128 + number


def _read(fd: int) -> bytes | None:
    """What waits in a pipe; None at its end."""
    try:
        return os.read(fd, 65536) or None
    except BlockingIOError:
        return b""


def main() -> None:
    """``python -m agent.supervisor COMMAND...``"""
    sys.exit(Supervisor(sys.argv[1:]).run())


if __name__ == "__main__":
    main()
