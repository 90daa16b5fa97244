"""One run of the agent in this process: from the drone file to an exit code."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from agent.detector.drivers import open_detector
from agent.errors import RadronError
from agent.shell.heartbeat import HUNG, Heartbeat, StallCheckingSelector
from agent.shell.logs import Logger, set_up_logs
from agent.shell.overrides import load_drone
from protocol.errors import ProtocolError

if TYPE_CHECKING:
    from agent.shell.node import DetectorOf, Node

USER_ERROR = 2


def run_agent(path: str, verbose: bool, heartbeat: Heartbeat, detector_of: DetectorOf = open_detector) -> int:
    """Run until SIGTERM. Returns 0, or 2 after one line about an error of the user, or 70 where the pilot failed."""
    try:
        drone, mission = load_drone(Path(path), os.environ)
        from agent.shell.node import Node  # noqa: PLC0415  takes a second: what is wrong with the files is said before

        log = set_up_logs(drone.id, verbose)
        node = Node(drone, mission, heartbeat, log, detector_of)
        with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(StallCheckingSelector(heartbeat))) as runner:
            return runner.run(_until_stopped(node, log))
    except (RadronError, ProtocolError) as error:
        print(f"radron-agent: {error}", file=sys.stderr)
        return USER_ERROR


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
    return 0
