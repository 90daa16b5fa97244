"""What one drone knows of the mission: the log, and what follows from it, all drones' frames and where the source is."""

from __future__ import annotations

from collections.abc import Sequence

from agent.config import MissionConfig
from agent.frames.swarm import SwarmFrames
from agent.fusion.engine import Fusion
from agent.fusion.registry import estimator_named
from protocol.messages import Cone, Entry


class Knowledge:
    """``frames``: of the whole swarm. ``fusion``: the log, and the estimator that is flown by; ``listeners``: others on the same
    log, by name. ``last_cone_ns``: newest cone in the log, of whomever; 0 where there is none.
    """

    def __init__(self, mission: MissionConfig, listeners: Sequence[str]) -> None:
        self.frames = SwarmFrames(mission)
        graph = self.frames.graph
        self.fusion = Fusion(mission, graph)
        self.listeners = {name: Fusion(mission, graph, estimator_named(name, mission)) for name in listeners}
        self.last_cone_ns = 0

    def start(self, started_ns: int) -> None:
        """The mission began with the start command of that stamp."""
        self.frames.start(started_ns)
        for fusion in (self.fusion, *self.listeners.values()):
            fusion.start(started_ns)

    def take(self, entry: Entry, payload: bytes, now_ns: int) -> bool:
        """Take an entry and the bytes that it came in; False where the log has it, or does not want it."""
        if not self.fusion.receive(entry, payload):
            return False
        self.frames.receive(entry)
        for listener in self.listeners.values():
            listener.receive(entry, payload)
        if isinstance(entry, Cone):
            self.last_cone_ns = max(self.last_cone_ns, min(entry.stamp_ns, now_ns))
        return True

    def advance(self, now_ns: int) -> None:
        """Fold what came in. Costs nearly nothing when nothing came in; much at once is folded in slices over several calls."""
        self.frames.advance(now_ns)
        for fusion in (self.fusion, *self.listeners.values()):
            fusion.advance(now_ns)
