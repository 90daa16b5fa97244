"""The observations of the log's entries in the mission frame: the newest are held, older ones are made again from their bytes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import cast

from agent.frames.graph import FrameGraph
from agent.fusion.log import ObservationLog
from agent.fusion.observation import Observation, observe
from protocol.entries import AnyEntry, EntryId

MOST_HELD = 512  # half a minute of three drones: what replays mostly go back to; a kilobyte each


class Observations:
    """Observations by the identities of their entries.

    To hold all of them would take as much memory as the log itself; to make one takes 25 microseconds. One that is made again
    has the same bits: whoever owns this puts an entry again whenever its frame has changed.
    """

    def __init__(self, log: ObservationLog, frames: FrameGraph) -> None:
        self._log, self._frames = log, frames
        self._held: dict[EntryId, Observation] = {}  # those put last

    def put(self, identity: EntryId, observation: Observation) -> None:
        """Hold an observation, in the place of the oldest one."""
        self._held[identity] = observation
        if len(self._held) > MOST_HELD:
            del self._held[next(iter(self._held))]

    def discard(self, identity: EntryId) -> None:
        """Hold this one no longer."""
        self._held.pop(identity, None)

    def missing(self, identities: Iterable[EntryId]) -> int:
        """How many of these have to be made again; to make one takes a unit of ``Estimator.work``."""
        return sum(identity not in self._held for identity in identities)

    def of(self, identity: EntryId) -> Observation | None:
        """The observation of an entry in the log; None where it has none, or its frame is not known any more: then the steps that
        it was in are computed again later.
        """
        held = self._held.get(identity)
        if held is not None:
            return held
        entry = cast(AnyEntry, self._log.entry(identity))
        transform = self._frames.mission_from_local(entry.drone, entry.epoch, entry.stamp_ns)
        return observe(entry, transform, identity) if transform is not None else None
