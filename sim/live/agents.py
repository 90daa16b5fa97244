"""The agents' processes of a live swarm on this machine: started, affected by faults, restarted, and ended."""

from __future__ import annotations

import asyncio
import os
import sysconfig
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from radron.sim.live.processes import Child
from radron.sim.live.runfolder import RunFolder

AGENT_STOP_S = 3.0  # an agent takes 2 s to end
GONE_S = 5.0  # after a kill; else it is stuck in the kernel


class Agents:
    """Starts, signals and ends the agents' processes of a live swarm on this machine.

    ``running``: the agents whose end has not been reported yet, in the order of their starts.
    """

    def __init__(self, files: RunFolder, drones: Sequence[str]) -> None:
        """``files``: folder of the flight. ``drones``: ids in the mission's order; empty without agents on this machine. The
        files of an agent must be written before its start.
        """
        self.drones = tuple(drones)
        self.running: list[Child] = []
        self._files = files
        self._children: dict[str, Child] = {}

    async def start(self, drone: str) -> None:
        """Start the agent of a drone.

        After a kill, the end of its earlier process is awaited first, and its log is continued.
        """
        if (before := self._children.get(drone)) is not None:
            with suppress(TimeoutError):
                await asyncio.wait_for(before.ended(), GONE_S)
        program = Path(sysconfig.get_path("scripts")) / "radron-agent"
        command = [str(program), "run", "--verbose", "--config", str(self._files.drone_file(drone))]
        child = await Child.start(drone, command, log=self._files.log_file(drone), append=before is not None)
        self._children[drone] = child
        self.running.append(child)

    def signal(self, drone: str, number: int) -> None:
        """Send a signal to an agent and its watchdog; no effect on an agent that has ended."""
        child = self._children.get(drone)
        if child is not None and child.exit_code is None:
            with suppress(ProcessLookupError):
                os.killpg(child.pid, number)

    def signal_agent(self, drone: str, number: int) -> None:
        """Send a signal to the agent alone, not to its watchdog."""
        child = self._children.get(drone)
        if child is not None and child.exit_code is None:
            with suppress(OSError, ValueError):
                os.kill(int(Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split()[0]), number)

    def exit_code(self, drone: str) -> int | None:
        """Return the exit code of a drone's last agent process; None while it runs."""
        return self._children[drone].exit_code

    async def has_ended(self, drone: str) -> bool:
        """Return whether a drone's last agent process has started and ended; a killed agent gets a moment to end."""
        child = self._children.get(drone)
        if child is None:
            return False
        with suppress(TimeoutError):
            await asyncio.wait_for(child.ended(), GONE_S)
        return child.exit_code is not None

    def folder(self, drone: str) -> Path:
        """Return the folder of a drone's agent, with ``state/`` and ``flight/``."""
        return self._files.agent(drone)

    async def stop(self) -> None:
        """End all agents."""
        await asyncio.gather(*(child.stop(AGENT_STOP_S) for child in self._children.values()))
