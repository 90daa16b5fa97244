"""The world model of one drone: the log, and what follows from it: all drones' frames and the source estimate."""

from __future__ import annotations

from collections.abc import Sequence

from agent.config.mission import MissionConfig
from agent.frames.swarm import SwarmFrames
from agent.fusion.engine import Fusion
from agent.fusion.registry import Estimators
from protocol.entries import Cone, Entry


class WorldModel:
    """Everything that follows from the log.

    ``frames``: of the whole swarm. ``fusion``: the log, and the estimator that the drone flies by; ``listeners``: others on the
    same log, by name. ``last_cone_ns``: stamp of the newest cone in the log, of any drone; 0 where there is none.
    """

    def __init__(self, mission: MissionConfig, listeners: Sequence[str], estimators: Estimators) -> None:
        self.frames = SwarmFrames(mission)
        graph = self.frames.graph
        self.fusion = Fusion(mission, graph, estimators(mission.fusion.estimator, mission))
        self.listeners = {name: Fusion(mission, graph, estimators(name, mission)) for name in listeners}
        self.last_cone_ns = 0

    def start(self, started_ns: int) -> None:
        """Begin a mission with the start command of that stamp: earlier measurements do not count."""
        self.last_cone_ns = 0
        self.frames.start(started_ns)
        for fusion in (self.fusion, *self.listeners.values()):
            fusion.start(started_ns)

    def take(self, entry: Entry, payload: bytes, now_ns: int) -> bool:
        """Take an entry and its encoded bytes; False where it is a duplicate or not accepted."""
        if not self.fusion.receive(entry, payload):
            return False
        self.frames.receive(entry, payload)
        for listener in self.listeners.values():
            listener.receive(entry, payload)
        if isinstance(entry, Cone):
            self.last_cone_ns = max(self.last_cone_ns, min(entry.stamp_ns, now_ns))
        return True

    def advance(self, now_ns: int) -> None:
        """Process new entries: almost free without any; a large backlog takes several calls."""
        self.frames.advance(now_ns)
        for fusion in (self.fusion, *self.listeners.values()):
            fusion.advance(now_ns)
