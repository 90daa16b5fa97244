"""The launcher's access to the process with the relays, which impair the links of a live flight."""

from __future__ import annotations

import asyncio
import sys

import msgspec

from radron.sim.live.processes import Child
from radron.sim.live.relays.linkstate import PASSING, LinkState
from radron.sim.live.relays.plan import Impair, RelayPlan
from radron.sim.live.worldprocess import LiveError

RELAYS_START_S = 60.0
RELAYS_STOP_S = 2.0


class RelayProcess:
    """The running process with all relays of a live flight (which impair its links)."""

    def __init__(self, child: Child) -> None:
        """Use :meth:`start` to start the process."""
        self._child = child
        self._states: dict[tuple[str, str], LinkState] = {}

    @classmethod
    async def start(cls, plan: RelayPlan) -> RelayProcess:
        """Start the relays, and wait until they listen.

        Raises:
            LiveError: they do not start.
        """
        child = await Child.start("relays", [sys.executable, "-m", "radron.sim.live.relays.process"], piped=True)
        child.stdin.write(msgspec.json.encode(plan) + b"\n")
        try:
            async with asyncio.timeout(RELAYS_START_S):
                up = await child.stdout.readline()
        except TimeoutError:
            up = b""
        except BaseException:
            await child.stop(RELAYS_STOP_S)
            raise
        if not up:
            await child.stop(RELAYS_STOP_S)
            raise LiveError("the relays between the agents did not start; see the reason above")
        return cls(child)

    def impair(self, sender: str, receiver: str, state: LinkState) -> None:
        """Set the impairment of one direction of a link, given by the names of its ends in the plan."""
        if self._states.get((sender, receiver), PASSING) != state:
            self._states[(sender, receiver)] = state
            self._child.stdin.write(msgspec.json.encode(Impair(sender, receiver, state)) + b"\n")

    async def stop(self) -> None:
        """End the process with the relays."""
        await self._child.stop(RELAYS_STOP_S)
