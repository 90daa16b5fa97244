"""A station of a large flight: its history from a record, by what ``radron-station open`` runs; then, with endpoints, the live
swarm by what ``radron-station serve`` runs, in the same process.

Prints JSON lines: the page's address; the progress of the record; then, for each line of its input, what it has used so far:
``cpu_s``, of it ``fold_s`` in log, frames and estimator, and ``frames`` shown.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from radron.agent.config.loading import load_mission
from radron.protocol.mesh.session import MeshConfig
from radron.station.hub import Hub
from radron.station.live import follow
from radron.station.picture.picture import Picture
from radron.station.replay import Records, play
from radron.station.web.serving import Place, Serving


class Used:
    """Time used by the fold: the calls into the log that agents make too."""

    def __init__(self, hub: Hub) -> None:
        self.fold_s = 0.0
        self.frames = 0
        log: Any = hub.picture.log
        log.advance = self._timed(log.advance)
        log.posterior = self._timed(log.posterior)
        take = log.take
        log.take = self._timed(lambda *given: list(take(*given)))
        show = hub.show
        shown: Any = hub

        def count(now_ns: int) -> None:
            self.frames += 1
            show(now_ns)

        shown.show = count

    def _timed(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*given: Any) -> Any:
            began_s = time.thread_time()
            try:
                return call(*given)
            finally:
                self.fold_s += time.thread_time() - began_s

        return timed

    def tell(self) -> None:
        """Print it."""
        _say(cpu_s=time.process_time(), fold_s=self.fold_s, frames=self.frames)


def _say(**values: object) -> None:
    print(json.dumps(values), flush=True)


async def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission", type=Path)
    parser.add_argument("--record", type=Path)
    parser.add_argument("--connect")
    arguments = parser.parse_args()
    mission = load_mission(arguments.mission)
    hub = Hub(Picture(mission, None), replay=False, progress=lambda share: _say(read=round(share, 3)))
    used = Used(hub)
    serving = Serving(hub, Place(port=0))
    _say(address=serving.address)
    asyncio.get_running_loop().run_in_executor(None, _answer, used)
    await serving.run(_work(hub, arguments.record, arguments.connect))


async def _work(hub: Hub, record: Path | None, connect: str | None) -> None:
    if record is not None:
        await play(hub, Records([record]))
        hub.progress = None  # from now on it is live
        _say(read=1.0, opened=True)
    if connect is not None:
        await follow(hub, MeshConfig(connect=(connect,)))


def _answer(used: Used) -> None:
    for _ in sys.stdin:
        used.tell()


if __name__ == "__main__":
    asyncio.run(main())
