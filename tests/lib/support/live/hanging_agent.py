"""The agent with a camera driver that ruins it on a signal: SIGUSR1 blocks the event loop, SIGUSR2 native code that keeps the
interpreter's lock, SIGHUP has the pilot's next step fail. Otherwise as ``agent/__main__.py``.
"""

import asyncio
import ctypes
import os
import signal
import sys
import time
from collections.abc import AsyncIterator

from radron.agent.detector.readout import Readout
from radron.agent.pilot import Pilot
from radron.agent.shell.heartbeat import HEARTBEAT_FD, Heartbeat, die_with

HANG_S = 60


def fail(pilot: Pilot, now_ns: int) -> None:
    raise ArithmeticError("told to")


class HangingCamera:
    """Sees nothing, and hangs on a signal."""

    problems: tuple[str, ...] = ()

    async def readouts(self) -> AsyncIterator[Readout]:
        loop = asyncio.get_running_loop()
        loop.add_signal_handler(signal.SIGUSR1, time.sleep, HANG_S)
        loop.add_signal_handler(signal.SIGUSR2, ctypes.PyDLL(None).sleep, HANG_S)  # a PyDLL keeps the lock during its calls
        loop.add_signal_handler(signal.SIGHUP, setattr, Pilot, "step", fail)
        await asyncio.Event().wait()
        for readout in ():
            yield readout

    async def close(self) -> None:
        pass


if __name__ == "__main__":
    die_with(int(sys.argv[-1]))
    from radron.agent.shell.running import run_agent

    os._exit(run_agent(sys.argv[1], False, Heartbeat(HEARTBEAT_FD), lambda *_: HangingCamera()))
