"""Access to the agents of a simulated flight in lockstep (one process, one time step for all), for the scores."""

from __future__ import annotations

from collections.abc import Mapping

from radron.protocol.messages import Stage
from radron.protocol.texts import CodedText
from radron.sim.faults.process import Agent as Process
from radron.sim.scoring.believers import Believer, Excluding
from radron.sim.scoring.framescore import Graph
from radron.sim.scoring.score import Belief


class Aboard:
    """A simulated agent as the scores see it. Its process may have died; a dead agent has no estimate."""

    def __init__(self, process: Process) -> None:
        self._process = process

    @property
    def alive(self) -> bool:
        """Whether the agent's process runs."""
        return self._process.alive

    @property
    def stage(self) -> Stage:
        """Stage of the agent's mission; after its death, what its vehicle does."""
        return self._process.stage

    @property
    def hypothesis(self) -> Belief | None:
        """The agent's source estimate; None without one."""
        return self._process.pilot.hypothesis if self.alive else None

    @property
    def outlook(self) -> Excluding | None:
        """State of the agent's search while it has found no source; None otherwise."""
        return self._process.pilot.outlook if self.alive else None

    @property
    def finding(self) -> CodedText | None:
        """Result of a search that has found nothing; None otherwise."""
        return self._process.pilot.finding if self.alive else None

    @property
    def graph(self) -> Graph:
        """Transforms between the local frames that the agent knows."""
        return self._process.pilot.frames.graph

    def suspects(self) -> Mapping[str, str]:
        """Drones whose localisation the agent distrusts, with the reasons."""
        return self._process.pilot.frames.suspects()

    @property
    def listeners(self) -> dict[str, Believer]:
        """Estimators that read the agent's log without influence on the flight, by name."""
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
