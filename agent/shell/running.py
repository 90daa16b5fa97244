"""One run of the agent in this process: from the drone file to an exit code."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from agent.detector.drivers import open_detector
from agent.errors import RadronError
from agent.shell.heartbeat import ANEW, HUNG, Heartbeat, StallCheckingSelector
from agent.shell.identity import check_clock
from agent.shell.logs import Logger, set_up_logs
from agent.shell.overrides import load_drone
from agent.shell.patience import Patience
from protocol.errors import ProtocolError

if TYPE_CHECKING:
    from agent.shell.node import DetectorOf, Node

USER_ERROR = 2


def run_agent(
    path: str, verbose: bool, heartbeat: Heartbeat, detector_of: DetectorOf = open_detector, patience: Patience | None = None
) -> int:
    """Run until SIGTERM. Returns 0; 2 after one line about an error of the user; 70 where the pilot failed; 75 to begin anew.

    ``patience``: one that waits does not end with the user's errors, but says what it waits for, and tries again.
    """
    patience = patience or Patience(heartbeat)
    while True:
        try:
            return _run_once(path, verbose, heartbeat, detector_of, patience)
        except (RadronError, ProtocolError) as error:
            if not patience.waits:
                print(f"radron-agent: {error}", file=sys.stderr)
                return USER_ERROR
            patience.tell(error)
            time.sleep(patience.retry_s)


def _run_once(path: str, verbose: bool, heartbeat: Heartbeat, detector_of: DetectorOf, patience: Patience) -> int:
    drone, filed = load_drone(Path(path), os.environ)
    if patience.waits:
        check_clock(drone, time.time_ns())
    from agent.shell.missionstore import mission_in_force  # noqa: PLC0415  with the next takes a second: what is wrong
    from agent.shell.node import Node  # noqa: PLC0415  with the files is said before

    log = set_up_logs(drone.id, verbose)
    node = Node(drone, filed, mission_in_force(drone, filed), heartbeat, log, detector_of, patience)
    with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(StallCheckingSelector(heartbeat))) as runner:
        return runner.run(_until_stopped(node, log))


async def _until_stopped(node: Node, log: Logger) -> int:
    flying = asyncio.ensure_future(node.run())
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, lambda: flying.cancelling() or flying.cancel())
    try:
        await flying
    except asyncio.CancelledError:
        log.info("stopped on request")
        return 0
    except (RadronError, ProtocolError):
        raise
    except Exception:
        log.exception("the pilot failed; exiting, so that the autopilot's failsafe takes over")
        return HUNG
    return ANEW
