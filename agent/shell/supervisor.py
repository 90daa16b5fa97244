"""The watchdog: a small process that starts the agent and kills it when it hangs, so that the autopilot's failsafe takes over.

A separate process, because a thread would stop with the interpreter's lock; imports are kept to the minimum.
Written by hand: a service manager's watchdog reacts after seconds, or is missing; this watchdog reacts within 1 s everywhere.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress

from radron.agent.shell.heartbeat import ANEW, HEARTBEAT_FD, HUNG, RELOADING, SILENCE_S, SILENT_START_S
from radron.agent.shell.systemd import VARIABLES, Notifier

STOP_S = 1.5  # a stopping agent has this long to close everything
_STOPS = (signal.SIGTERM, signal.SIGINT)
NUMERICS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # unless set: a flight is one thread with small matrices


class Supervisor:
    """The watchdog process: it starts the agent, and kills it when it hangs, so that the autopilot's failsafe takes over.

    It is single-threaded, with one poll for everything.
    """

    def __init__(self, command: Sequence[str]) -> None:
        """Prepare the start of the agent.

        ``command``: of the agent; as last argument the supervisor's process id is added, and the agent's file descriptor 3 is the
        pipe.
        """
        self._command = [*command, str(os.getpid())]
        self._notifier = Notifier()
        self._scratch = os.path.join(os.environ.get("TMPDIR", "/tmp"), f"radron-agent-{os.getpid()}")
        self._stopping = False
        self._silence_s = SILENT_START_S  # longest allowed silence
        self._deadline_s: float | None = None  # when the agent is killed unless it sends something
        self._verdict: str | None = None  # why the agent was killed

    def run(self) -> int:
        """Start the agent and watch it; start it again when it asks for that, as with a new mission.

        Return the agent's exit code: 0 after a stop signal, 70 after a hang.

        The agent gets its own folder for temporary files, removed afterwards, also after a kill: MAVSDK makes a folder there at
        each start and removes none.
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
            signal.signal(number, lambda *_: None)  # the wake-up pipe names the signal
        code = ANEW
        while code == ANEW and not self._stopping:
            code = self._watched(wakes)
            self._notifier.alive()
        self._notifier.tell("STOPPING=1")
        return 0 if code == ANEW else code

    def _watched(self, wakes: int) -> int:
        """Watch one run of the agent to its end and return its exit code."""
        heartbeats, child = self._start()
        self._allow(SILENT_START_S)
        poll = select.poll()
        poll.register(wakes, select.POLLIN)
        poll.register(heartbeats, select.POLLIN)
        while True:
            poll.poll(self._patience_ms())
            self._hear(heartbeats, poll)
            self._obey(_read(wakes), child)
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                os.close(heartbeats)
                self._deadline_s = None
                return self._exit_code(status)
            self._judge(child)

    def _start(self) -> tuple[int, int]:
        """Start the agent; return the reading end of the heartbeat pipe and the agent's process id."""
        reading, writing = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        environment = {key: value for key, value in (NUMERICS | os.environ).items() if key not in VARIABLES}
        if os.path.isdir(self._scratch):
            environment["TMPDIR"] = self._scratch
        child = os.posix_spawn(
            self._command[0],
            self._command,
            environment,
            file_actions=[(os.POSIX_SPAWN_DUP2, writing, HEARTBEAT_FD)],
            setsigdef=[*_STOPS, signal.SIGCHLD],
        )
        os.close(writing)
        return reading, child

    def _patience_ms(self) -> int | None:
        return None if self._deadline_s is None else max(0, int(1000 * (self._deadline_s - time.monotonic())) + 1)

    def _hear(self, heartbeats: int, poll: select.poll) -> None:
        """Take the agent's lines: heartbeats, and lines for the service manager."""
        data = _read(heartbeats)
        if data is None:  # pipe closed: the agent is exiting
            with suppress(KeyError):
                poll.unregister(heartbeats)
            return
        lines = [line.decode(errors="replace") for line in data.split(b"\n")[:-1]]
        told = [line for line in lines if line]
        if "" in lines and not self._stopping:
            self._allow(SILENCE_S)
            self._notifier.alive()
        elif told and not self._stopping:  # any line before the agent's first step is a sign of life, too
            self._allow(self._silence_s)
        if RELOADING in told:  # no heartbeats any more until the agent has been started again
            self._deadline_s = time.monotonic() + STOP_S
        if told:
            self._notifier.tell(*told)

    def _allow(self, silence_s: float) -> None:
        self._silence_s = silence_s
        self._deadline_s = time.monotonic() + silence_s

    def _obey(self, numbers: bytes | None, child: int) -> None:
        """Pass a stop signal on to the agent, once."""
        if self._stopping or not numbers or not any(number in numbers for number in _STOPS):
            return
        self._stopping = True
        self._deadline_s = time.monotonic() + STOP_S
        self._notifier.tell("STOPPING=1")
        os.kill(child, signal.SIGTERM)

    def _judge(self, child: int) -> None:
        """Kill the agent when its time is up."""
        if self._deadline_s is None or time.monotonic() < self._deadline_s:
            return
        what = f"did not stop within {STOP_S:g} s" if self._stopping else f"no heartbeat for {self._silence_s:g} s"
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
        if self._stopping and number in _STOPS:  # the agent had not started yet
            return 0
        print(f"radron-agent: ended by {signal.Signals(number).name}", file=sys.stderr)
        return 128 + number


def _read(fd: int) -> bytes | None:
    """Return the bytes waiting in a pipe; None at its end."""
    try:
        return os.read(fd, 65536) or None
    except BlockingIOError:
        return b""


def main() -> None:
    """Run the watchdog of an agent: ``python -m radron.agent.shell.supervisor COMMAND...``"""
    sys.exit(Supervisor(sys.argv[1:]).run())


if __name__ == "__main__":
    main()
