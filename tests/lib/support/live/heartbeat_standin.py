"""A stand-in for the agent under its supervisor: beats each 50 ms, says so on its output, and behaves as its argument says."""

import os
import signal
import sys
import tempfile
import time
from pathlib import Path

from radron.agent.shell.heartbeat import ANEW, HEARTBEAT_FD, RELOADING, Heartbeat, die_with

PARENT = int(sys.argv[-1])
HOW = sys.argv[1]


def say(what: str) -> None:
    print(what, os.getpid(), time.monotonic(), flush=True)


def begin_anew_once(beat: Heartbeat) -> None:
    """Ask to be started again, after more time than the watchdog allows between two beats."""
    mark = Path(os.environ["MARK"])
    if mark.exists():
        return
    mark.touch()
    say("first")
    beat.beat()
    beat.tell(RELOADING)
    beat.rest()
    time.sleep(1.2)
    sys.exit(ANEW)


def main() -> None:
    if HOW.isdigit():
        sys.exit(int(HOW))
    die_with(PARENT)
    Path(tempfile.gettempdir(), "left").touch()
    beat = Heartbeat(HEARTBEAT_FD)
    if HOW == "slow start":
        time.sleep(1.5)
        sys.exit(0)
    if HOW == "stubborn":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if HOW == "tidy":
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    if HOW == "tells":
        beat.tell("READY=1")
        beat.tell("STATUS=survey")
    if HOW == "waits, then hangs":
        for _ in range(4):
            say("waits")
            beat.tell("STATUS=waiting: no autopilot")
            time.sleep(1.0)
        time.sleep(100.0)
    if HOW == "anew":
        begin_anew_once(beat)
    for step in range(10_000):
        beat.check()
        say("step")
        beat.beat()
        if HOW == "hangs" and step == 3:
            time.sleep(100.0)
        time.sleep(0.05)


if __name__ == "__main__":
    main()
