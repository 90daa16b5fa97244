"""The observations of the log's entries in the mission frame: the newest are held, older ones are rebuilt from their bytes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import cast

from radron.agent.frames.graph import FrameGraph
from radron.agent.fusion.log import ObservationLog
from radron.agent.fusion.observation import Observation, observe
from radron.protocol.entries import AnyEntry, EntryId

MAX_HELD_OBSERVATIONS = 512  # half a minute of three drones: the usual reach of replays; a kilobyte each


class Observations:
    """A cache of observations (log entries in the mission frame) by the identities of their entries.

    All of them would take as much memory as the log itself; one takes 25 microseconds to make. A rebuilt observation has the same
    bits: the owner puts an entry again whenever its frame has changed.
    """

    def __init__(self, log: ObservationLog, frames: FrameGraph) -> None:
        self._log, self._frames = log, frames
        self._held: dict[EntryId, Observation] = {}  # the last put observations

    def put(self, identity: EntryId, observation: Observation) -> None:
        """Store the observation of a log entry; when the cache is full, the oldest one is dropped."""
        self._held[identity] = observation
        if len(self._held) > MAX_HELD_OBSERVATIONS:
            del self._held[next(iter(self._held))]

    def discard(self, identity: EntryId) -> None:
        """Drop the observation of a log entry, if it is in the cache."""
        self._held.pop(identity, None)

    def missing(self, identities: Iterable[EntryId]) -> int:
        """Return how many observations of these log entries are not in the cache; rebuilding one takes a unit of
        ``Estimator.work``.
        """
        return sum(identity not in self._held for identity in identities)

    def of(self, identity: EntryId) -> Observation | None:
        """Return the observation of an entry in the log; None if the entry yields none, or its frame is not known any more.

        In the latter case its steps are recomputed later.
        """
        held = self._held.get(identity)
        if held is not None:
            return held
        entry = cast(AnyEntry, self._log.entry(identity))
        transform = self._frames.mission_from_local(entry.drone, entry.epoch, entry.stamp_ns)
        return observe(entry, transform, identity) if transform is not None else None
