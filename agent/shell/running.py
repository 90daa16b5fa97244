"""One run of the agent in this process: from the drone file to an exit code."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from radron.agent.clock.seeking import seek_time
from radron.agent.config.drone import DroneConfig
from radron.agent.detector.drivers import open_detector
from radron.agent.errors import RadronError
from radron.agent.shell.heartbeat import ANEW, HUNG, Heartbeat, StallCheckingSelector
from radron.agent.shell.identity import DeadClockError, check_clock
from radron.agent.shell.logs import Logger, set_up_logs
from radron.agent.shell.overrides import load_drone
from radron.agent.shell.patience import Patience
from radron.agent.shell.selfreport import runtime_folder
from radron.agent.update.records import own_release
from radron.protocol.errors import ProtocolError

if TYPE_CHECKING:
    from radron.agent.shell.node import DetectorOf, Node

USER_ERROR = 2


def run_agent(
    path: str, verbose: bool, heartbeat: Heartbeat, detector_of: DetectorOf = open_detector, patience: Patience | None = None
) -> int:
    """Run the agent until SIGTERM, and return the exit code of the process.

    0: stopped on request; 2 after one line about an error that the user can fix; 70 after the pilot program failed; 75 to be
    started again. ``path``: of the drone file. ``patience``: if it ``waits``, an error of the user is reported as an obstacle and
    the start is tried again.
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
        _await_clock(drone)
    from radron.agent.shell.missionstore import mission_in_force  # noqa: PLC0415  with the next takes a second: what is wrong
    from radron.agent.shell.node import Node  # noqa: PLC0415  with the files is said before

    log = set_up_logs(drone.id, verbose)
    node = Node(drone, filed, mission_in_force(drone, filed), heartbeat, log, detector_of, patience)
    with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(StallCheckingSelector(heartbeat))) as runner:
        return runner.run(_until_stopped(node, log))


def _await_clock(drone: DroneConfig) -> None:
    """Raise a dead clock as an obstacle, with the result of seeking the time from the autopilot where the computer takes it.

    Raises:
        DeadClockError, IdentityError, VehicleError: the obstacle.
    """
    try:
        check_clock(drone, time.time_ns(), own_release().made_ns)
    except DeadClockError as dead:
        folder = runtime_folder()
        if folder is None:
            raise
        raise DeadClockError(f"{dead}; {seek_time(drone.vehicle, dead.valid, folder)}", dead.valid) from None


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
