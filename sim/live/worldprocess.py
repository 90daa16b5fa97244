"""The launcher's access to the world process of a live flight."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec

from radron.agent.errors import RadronError
from radron.sim.live.processes import Child
from radron.sim.live.worldlink import Order, Ready, Truth, WorldConfig, order_line, read
from radron.sim.runfile import write_text
from radron.sim.vehicle.px4.faults import VehicleFault

WORLD_START_S = 300.0  # the first start computes the camera's response, with a progress bar
WORLD_SILENT_S = 10.0  # a world without output for so long hangs
WORLD_STOP_S = 2.0


class LiveError(RadronError):
    """A live flight cannot begin, or has failed."""


class WorldProcess:
    """A running world process. ``ready``: its ports; ``truth``: the latest true state of the world."""

    def __init__(self, child: Child, ready: Ready, truth: Truth) -> None:
        """Use :meth:`start` to start the process."""
        self._child = child
        self.ready = ready
        self.truth = truth

    @classmethod
    async def start(cls, config: WorldConfig, file: Path) -> WorldProcess:
        """Start a world process and wait until it is ready.

        Raises:
            LiveError: it does not start.
        """
        write_text(file, msgspec.json.encode(config).decode())
        child = await Child.start("world", [sys.executable, "-m", "radron.sim.live.world", str(file)], piped=True)
        try:
            async with asyncio.timeout(WORLD_START_S):
                ready, truth = await read(child.stdout), await read(child.stdout)
            if not isinstance(ready, Ready) or not isinstance(truth, Truth):
                raise LiveError("the world ended before it was up; see the reason above")
        except TimeoutError:
            await child.stop(WORLD_STOP_S)
            raise LiveError(f"the world is not up within {WORLD_START_S:g} s") from None
        except BaseException:
            await child.stop(WORLD_STOP_S)
            raise
        return cls(child, ready, truth)

    async def watch(self, see: Callable[[Truth], None]) -> None:
        """Call ``see`` with each true state of the world, forever.

        Raises:
            LiveError: the world has ended or is silent.
        """
        while True:
            try:
                async with asyncio.timeout(WORLD_SILENT_S):
                    truth = await read(self._child.stdout)
            except TimeoutError:
                raise LiveError(f"the world has said nothing for {WORLD_SILENT_S:g} s") from None
            if not isinstance(truth, Truth):
                raise LiveError("the world has ended in the middle of the flight")
            self.truth = truth
            see(truth)

    def order(self, order: Order, drone: int | None = None, fault: VehicleFault | None = None) -> None:
        """Send an order to the world process. ``drone``: index of the drone concerned."""
        self._child.stdin.write(order_line(order, drone, fault))

    @property
    def exit_code(self) -> int | None:
        """Exit code of the world process; None while it runs."""
        return self._child.exit_code

    async def stop(self) -> None:
        """End the world process."""
        await self._child.stop(WORLD_STOP_S)
