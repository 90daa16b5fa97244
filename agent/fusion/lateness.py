"""Late entries: folded together, so that the recomputed steps stay in proportion to the new entries."""

from __future__ import annotations

from radron.agent.frames.batches import Batches
from radron.protocol.entries import AnyEntry, EntryId

_MAX_STRIDE = 16  # steps
_CALLS_A_STEP = 4  # without new due steps, as after the flight: calls that a batch waits for each of its steps


class Latecomers:
    """Log entries that arrived after their time step was computed; they wait, so that several are processed in one recomputation.

    An entry late by n steps has n steps recomputed. Of such entries at most one batch is folded in every m steps. m is the
    largest power of two up to n of the latest entry. So in total at most about three times as many steps are computed as there
    are. Batches are folded at the multiples of m: at the same due steps by all agents, whose estimates stay comparable meanwhile.
    """

    def __init__(self) -> None:
        self._entries: dict[EntryId, AnyEntry | None] = {}
        self._stride = 1
        self._calls = 0  # since the first entry of the batch came

    def __bool__(self) -> bool:
        """Return whether any entries wait here."""
        return bool(self._entries)

    def add(self, identity: EntryId, entry: AnyEntry | None, steps: int) -> None:
        """Add an entry that is late by ``steps`` time steps; None in place of the entry: the entry of that identity is
        removed.
        """
        self._entries[identity] = entry
        self._stride = max(self._stride, min(1 << max(steps.bit_length() - 1, 0), _MAX_STRIDE))

    def discard(self, identity: EntryId) -> None:
        """Remove a late log entry (signed measurement), if it waits here."""
        self._entries.pop(identity, None)

    def taken(self, before: int, due: int) -> dict[EntryId, AnyEntry | None]:
        """Return the late log entries that wait here if they are due, and forget them; else nothing.

        before, due: newest step of the time grid before this call, and now.
        """
        self._calls += 1
        if before // self._stride == due // self._stride and self._calls <= _CALLS_A_STEP * self._stride:
            return {}
        return self.all_taken()

    def all_taken(self) -> dict[EntryId, AnyEntry | None]:
        """Return all late log entries that wait here, and forget them, when their steps are recomputed anyway."""
        entries, self._entries = self._entries, {}
        self._stride, self._calls = 1, 0
        return entries


class Late:
    """Log entries that arrived so late that they wait for a large recomputation of their own, and for the quota of their drone.

    None in the place of an entry: the entry of that identity is removed.
    """

    def __init__(self, batches: Batches) -> None:
        self._batches = batches
        self._entries: dict[EntryId, AnyEntry | None] = {}

    def __bool__(self) -> bool:
        """Return whether any entries wait here."""
        return bool(self._entries)

    def add(self, identity: EntryId, entry: AnyEntry | None) -> None:
        """Add a very late log entry, or the removal of one (None)."""
        self._entries[identity] = entry

    def discard(self, identity: EntryId) -> None:
        """Remove a very late log entry, if it waits here."""
        self._entries.pop(identity, None)

    @property
    def put_off(self) -> frozenset[str]:
        """The drones that have used up their quotas of late entries, and whose entries wait for that reason."""
        drones = {identity.drone for identity in self._entries}
        return frozenset(drones - self._batches.admitted(drones))

    def taken(self) -> dict[EntryId, AnyEntry | None]:
        """Return the waiting log entries of the drones with quota left, and forget them here."""
        admitted = self._batches.admitted({identity.drone for identity in self._entries})
        taken = {identity: entry for identity, entry in self._entries.items() if identity.drone in admitted}
        self._entries = {identity: entry for identity, entry in self._entries.items() if identity.drone not in admitted}
        return taken
