"""The agents of lockstep as they are scored."""

from __future__ import annotations

from collections.abc import Mapping

from radron.protocol.messages import Stage
from radron.sim.faults.process import Agent as Process
from radron.sim.scoring.believers import Believer, Excluding
from radron.sim.scoring.framescore import Graph
from radron.sim.scoring.score import Belief


class Aboard:
    """An agent with its present pilot; a dead agent has no estimate."""

    def __init__(self, process: Process) -> None:
        self._process = process

    @property
    def alive(self) -> bool:
        """Return whether there is a process."""
        return self._process.alive

    @property
    def stage(self) -> Stage:
        """Return its stage; after its death, its vehicle's."""
        return self._process.stage

    @property
    def hypothesis(self) -> Belief | None:
        """Return its source estimate."""
        return self._process.pilot.hypothesis if self.alive else None

    @property
    def outlook(self) -> Excluding | None:
        """Return its search state without a hypothesis."""
        return self._process.pilot.outlook if self.alive else None

    @property
    def finding(self) -> str:
        """Return the result of a search without a find; else empty."""
        return self._process.pilot.finding if self.alive else ""

    @property
    def graph(self) -> Graph:
        """Return the frames known to it."""
        return self._process.pilot.frames.graph

    def suspects(self) -> Mapping[str, str]:
        """Return the reasons for distrust in a frame, by drone."""
        return self._process.pilot.frames.suspects()

    @property
    def listeners(self) -> dict[str, Believer]:
        """Return the estimators that read its log without influence on the flight."""
        return {name: _Listener(self._process, name) for name in self._process.pilot.listeners}


class _Listener:
    def __init__(self, process: Process, name: str) -> None:
        self._process, self._name = process, name

    @property
    def hypothesis(self) -> Belief | None:
        """Return its source estimate."""
        return self._process.pilot.listeners[self._name].hypothesis if self._process.alive else None

    @property
    def outlook(self) -> Excluding | None:
        """Return its search state without a hypothesis."""
        return self._process.pilot.listeners[self._name].outlook if self._process.alive else None
