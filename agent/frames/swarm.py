"""All frames of a swarm as a pure function of the log: estimated keyframe by keyframe, and recomputed after late entries."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from itertools import chain, zip_longest

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.batches import LATE_NS, Batches
from radron.agent.frames.carried import CarriedFrames
from radron.agent.frames.checkpoint import Checkpoint, beginning
from radron.agent.frames.estimate import Estimate, FrameEstimates
from radron.agent.frames.graph import FrameGraph, Known
from radron.agent.frames.intake import READS, Intake
from radron.agent.frames.placement import Placement
from radron.agent.frames.tracks import ALWAYS, Segment
from radron.agent.frames.transform import Transform
from radron.protocol.entries import Entry, EntryId

BEFORE_START_NS = 60_000_000_000  # earlier measurements are ignored: clocks may be years off
_PORTION = 50  # entries taken back per call of ``advance``: 10 ms
_SLICE = 24  # keyframe updates of one drone per call of ``advance``: about 20 ms
_RECENT = 64  # number of recent checkpoints, all kept; of older ones every 8th
_EVERY = 8

Received = tuple[Entry, bytes]  # and the bytes that it was decoded from


class SwarmFrames:
    """Estimates the local frames of all drones without exact localisation in the mission frame, from the observation log.

    The result, in ``graph``, depends only on the received log entries (in any order) and on the last keyframe (time of an
    estimate, about one a second) that is due. So all drones with equal logs have equal frames.

    Intermediate states (checkpoints) are kept; a late entry rolls the estimate back to the last checkpoint before its time, and
    the keyframes since are computed again. The graph and the suspects keep their values until that is complete, so that no drone
    flies by frames that lack the last minute. Entries received meanwhile are processed afterwards. Entries that are late by more
    than ``LATE_NS`` are taken in ``Batches``, with a pause in between, so that they never keep the graph from the new ones. If
    all drones are exact, nothing is computed. Their frames after a jump are also in the graph, as published (``carried``).
    """

    def __init__(self, mission: MissionConfig, estimates: FrameEstimates = Estimate) -> None:
        """Start with the frames that the mission file gives. ``estimates``: makes the estimator of the frames."""
        self.graph = FrameGraph.from_launch_layout(mission)
        self._carried = CarriedFrames(mission, self.graph)
        self._names = [drone.id for drone in mission.drones]
        self._estimated = [not drone.is_exact for drone in mission.drones]
        self._idle = not any(self._estimated)
        self._slice = max(1, _SLICE // len(mission.drones))
        self._settle_ns = round(mission.frames.settle_s * 1e9)
        self._intake = Intake(mission)
        self._estimate = estimates(mission, self._intake)
        self._beginning = beginning(len(mission.drones))
        self._checkpoints: dict[int, Checkpoint] = {}  # ascending
        self._lines = [_Line() for _ in mission.drones]
        self._epochs: list[set[int]] = [set() for _ in mission.drones]  # epochs in the graph, by drone
        self._newest = self._beginning  # the checkpoint that the graph shows
        self._estimating = False  # keyframes are due that the next call of ``advance`` estimates
        self._waiting: list[Received] = []  # while estimating
        self._late: list[Received] = []
        self._retracted: list[EntryId] = []  # late entries
        self._forgotten: list[EntryId] = []
        self._batches = Batches()
        self._batch_of, self._took = frozenset[str](), 0  # drones with late entries in the current batch, and its calls
        self._put_ns: int | None = None  # last time without entries waiting outside the estimate
        self.complete_ns = 0  # time of an ``advance``: all entries received before are in the graph
        self._started_ns: int | None = None
        self._due = self._wanted = -1  # the newest keyframe that is estimated, and that is due at the newest time

    @property
    def pending(self) -> bool:
        """Whether the graph of frames lacks received entries, or an estimate that is due; further calls of ``advance``
        add them.
        """
        behind = self._estimating or self._due != self._wanted or bool(self._forgotten) or bool(self._retracted)
        return behind or self._intake.dirty is not None or bool(self._waiting) or bool(self._late)

    @property
    def has_batch(self) -> bool:
        """Whether a batch of late entries is being processed, or will be at its next fixed time; then much of the graph may
        change.
        """
        return bool(self._batch_of) or (not self._batches.is_resting and bool(self._admitted))

    @property
    def _admitted(self) -> frozenset[str]:
        """Drones with late entries that wait only for the next batch."""
        return self._batches.admitted(self._late_drones)

    @property
    def _late_drones(self) -> frozenset[str]:
        return frozenset(chain((entry.drone for entry, _ in self._late), (identity.drone for identity in self._retracted)))

    @property
    def put_off(self) -> frozenset[str]:
        """Drones whose late entries wait, because the drones have used up their quota of late entries."""
        return self._late_drones - self._admitted

    def start(self, stamp_ns: int) -> None:
        """Set the start of the mission (UTC, ns): much older measurements are ignored.

        A later start begins again, an earlier one is ignored: an agent from an earlier flight of the mission and a restarted
        agent hold the same entries.
        """
        if self._started_ns is not None and stamp_ns <= self._started_ns:
            return
        self._started_ns = stamp_ns
        self._carried.drop_before(stamp_ns - BEFORE_START_NS)
        if self._idle:
            return
        self._estimating = False
        self._intake.drop_before(stamp_ns - BEFORE_START_NS)

    def receive(self, entry: Entry, payload: bytes) -> None:
        """Add an entry of the log, together with the bytes from which it was decoded; each entry once, in any order."""
        self._carried.receive(entry)
        if self._idle or not isinstance(entry, READS):
            return
        if self._is_late(entry.stamp_ns):
            self._late.append((entry, payload))
        elif self._estimating:
            self._waiting.append((entry, payload))
        else:
            self._intake.receive(entry, payload)

    def forget(self, identities: Sequence[EntryId]) -> None:
        """Remove measurements from the estimate of the frames, after their entries were removed from the log."""
        self._carried.forget(identities)
        if not self._idle:
            self._forgotten += self._taken_in(identities)

    def retract(self, identities: Sequence[EntryId]) -> None:
        """Remove measurements from the estimate of the frames that their drones have retracted; late ones with the next batch."""
        self._carried.forget(identities)
        if not self._idle:
            for identity in self._taken_in(identities):
                (self._retracted if self._is_late(identity.stamp_ns) else self._forgotten).append(identity)

    def receive_again(self, received: Sequence[Received]) -> None:
        """Add measurements to the estimate of the frames that had been removed, and that count again."""
        again, waiting = {entry.entry_id for entry, _ in received}, {*self._retracted, *self._forgotten}
        self._retracted = [identity for identity in self._retracted if identity not in again]
        self._forgotten = [identity for identity in self._forgotten if identity not in again]
        for entry, payload in received:
            if entry.entry_id not in waiting:
                self.receive(entry, payload)
            else:  # only a carried frame has been taken back yet
                self._carried.receive(entry)

    def _taken_in(self, identities: Sequence[EntryId]) -> list[EntryId]:
        """Return the entries that frames depend on; drop entries that only wait to be taken."""
        gone, waiting = set(identities), {one[0].entry_id for one in (*self._late, *self._waiting)}
        self._late = [one for one in self._late if one[0].entry_id not in gone]
        self._waiting = [one for one in self._waiting if one[0].entry_id not in gone]
        return [identity for identity in identities if identity not in waiting and self._intake.holds(identity)]

    def advance(self, now_ns: int, *, takes_late: bool = True) -> None:
        """Compute the estimates of the frames (keyframes) that are due, and those that late entries have changed; a limited
        number per call.

        ``takes_late``: whether a batch of late entries may be taken. A caller that still processes the previous batch would begin
        again with every change far back, and never finish.
        """
        if self._idle:
            self.complete_ns = now_ns
            return
        self._wanted = (now_ns - self._settle_ns) // self._intake.grid_ns
        are_due = self._batches.are_due(now_ns, free=takes_late and not self._estimating and not self._forgotten)
        if not self._estimating:
            if are_due and (admitted := self._admitted):
                self._begin_batch(admitted)
            forgotten, self._forgotten = self._forgotten[:_PORTION], self._forgotten[_PORTION:]
            self._intake.forget(forgotten)
            if self._forgotten:  # the graph keeps its values until all is gone
                self._took += 1
                return
            self._take_waiting()
            if self._put_ns is None and not self._late and not self._retracted:
                self._put_ns = now_ns
            self._due = self._wanted
            self._rewind()
        last = next(reversed(self._checkpoints.values()), self._beginning)
        indices = self._intake.indices
        first, end = bisect_right(indices, last.index), bisect_right(indices, self._due)
        for index in indices[first : min(end, first + self._slice)]:
            last = self._estimate.step(last, index)
            self._checkpoints[index] = last
            for drone, from_ns, placement in last.emissions:
                self._lines[drone].add(index, from_ns, placement)
        self._estimating = end > first + self._slice
        self._took += 1
        self._thin()
        if self._estimating:
            return
        if self._batch_of:
            self._batches.took(self._took)
            self._batch_of = frozenset()
        self._newest = last
        for drone, line in enumerate(self._lines):
            if self._estimated[drone]:
                self._publish(drone, line)
        if self._put_ns is not None:
            self.complete_ns, self._put_ns = self._put_ns, None

    def suspects(self) -> Mapping[str, str]:
        """Return the drones whose frame is not trusted or not known, each with the reason in words."""
        members = zip(self._names, self._estimated, self._newest.members, strict=True)
        unknown = {name: "its frame is not known yet" for name, estimated, one in members if estimated and not one.known}
        return {**unknown, **self.contradicted()}

    def contradicted(self) -> Mapping[str, str]:
        """Return the drones whose frame is not trusted because measurements contradict each other, each with the reason
        in words.
        """
        members = zip(self._names, self._newest.members, strict=True)
        return {name: one.suspicion.reason for name, one in members if one.suspicion is not None}

    def _is_late(self, stamp_ns: int) -> bool:
        """Whether an entry of that stamp changes keyframes that were estimated long ago."""
        last = next(reversed(self._checkpoints), -1)
        return stamp_ns <= min(last, self._due - LATE_NS // self._intake.grid_ns) * self._intake.grid_ns

    def _take_waiting(self) -> None:
        waiting, self._waiting = self._waiting, []
        waiting += [one for one in self._late if one[0].drone in self._batch_of]
        self._late = [one for one in self._late if one[0].drone not in self._batch_of]
        for entry, payload in waiting:
            self._intake.receive(entry, payload)

    def _begin_batch(self, drones: frozenset[str]) -> None:
        """Take the late entries of these drones, and charge their quotas."""
        self._took, self._batch_of = 0, drones
        first_ns: dict[str, int] = {}
        late = ((entry.drone, entry.stamp_ns) for entry, _ in self._late)
        stamps = chain(late, ((one.drone, one.stamp_ns) for one in self._retracted))
        for drone, stamp_ns in stamps:
            first_ns[drone] = min(stamp_ns, first_ns.get(drone, stamp_ns))
        due_ns = self._due * self._intake.grid_ns
        self._batches.charge({drone: 1e-9 * (due_ns - first_ns[drone]) for drone in drones})
        self._forgotten += [identity for identity in self._retracted if identity.drone in drones]
        self._retracted = [identity for identity in self._retracted if identity.drone not in drones]

    def _rewind(self) -> None:
        dirty = self._intake.taken()
        first = self._due + 1 if dirty is None else min(dirty, self._due + 1)
        if next(reversed(self._checkpoints), -1) < first:
            return
        while self._checkpoints and next(reversed(self._checkpoints)) >= first:
            self._checkpoints.popitem()
        last = next(reversed(self._checkpoints), -1)
        for line in self._lines:
            line.undo_after(last)

    def _thin(self) -> None:
        """Drop most of the old checkpoints: a very late entry then costs a few more keyframes."""
        if len(self._checkpoints) % _RECENT == 0:
            for index in list(self._checkpoints)[:-_RECENT]:
                if index % _EVERY:
                    del self._checkpoints[index]

    def _publish(self, drone: int, line: _Line) -> None:
        """Update the graph: placements of the continuous frame become transforms of its segments."""
        track = self._intake.tracks[drone]
        from_ns = min(line.taken_changed_ns(), track.taken_changed_ns())
        if from_ns == ALWAYS:
            return
        if not line.stamps_ns or from_ns <= line.stamps_ns[0]:
            from_ns = 0  # the first known placement also holds before its stamp; without placements none holds
        segments = track.segments
        epochs = self._epochs[drone] = self._epochs[drone] | {segment.epoch for segment in segments}
        known: dict[int, list[Known]] = {epoch: [] for epoch in sorted(epochs)}
        for segment, following in zip_longest(segments, segments[1:]):
            end_ns = ALWAYS if following is None else following.stamp_ns
            if end_ns > from_ns:
                known[segment.epoch] += line.within(from_ns, end_ns, segment)
        for epoch, transforms in known.items():
            self.graph.replace_from(self._names[drone], epoch, from_ns, transforms)


class _Line:
    """Placements of one drone's continuous frame by their first stamps, with an undo history by keyframe."""

    def __init__(self) -> None:
        self.stamps_ns: list[int] = []
        self._placements: list[Placement | None] = []
        self._changed_ns = ALWAYS
        self._undo: list[tuple[int, int, list[int], list[Placement | None]]] = []  # keyframe, length kept, part cut off

    def taken_changed_ns(self) -> int:
        """The earliest stamp changed since the last call (``ALWAYS``: none)."""
        changed, self._changed_ns = self._changed_ns, ALWAYS
        return changed

    def add(self, index: int, from_ns: int, placement: Placement | None) -> None:
        """Add a placement that holds from that stamp on, computed at keyframe ``index``."""
        kept = bisect_left(self.stamps_ns, from_ns)
        self._undo.append((index, kept, self.stamps_ns[kept:], self._placements[kept:]))
        self.stamps_ns[kept:] = [from_ns]
        self._placements[kept:] = [placement]
        self._changed_ns = min(self._changed_ns, from_ns)

    def undo_after(self, index: int) -> None:
        """Undo the placements of later keyframes."""
        while self._undo and self._undo[-1][0] > index:
            _, kept, stamps, placements = self._undo.pop()
            self._changed_ns = min(self._changed_ns, self.stamps_ns[kept])
            self.stamps_ns[kept:] = stamps
            self._placements[kept:] = placements

    def within(self, from_ns: int, end_ns: int, segment: Segment) -> list[Known]:
        """The transforms of a segment's local frame from ``from_ns`` or its beginning on, up to ``end_ns``."""
        if not self._placements:
            return []
        known: list[Known] = []
        first = bisect_left(self.stamps_ns, from_ns)
        if segment.stamp_ns >= from_ns:
            first = bisect_right(self.stamps_ns, segment.stamp_ns)
            known.append((segment.stamp_ns, _transform(self._placements[max(first - 1, 0)], segment)))
        last = bisect_left(self.stamps_ns, end_ns)
        pairs = zip(self.stamps_ns[first:last], self._placements[first:last], strict=True)
        return known + [(stamp_ns, _transform(placement, segment)) for stamp_ns, placement in pairs]


def _transform(placement: Placement | None, segment: Segment) -> Transform | None:
    return None if placement is None else placement.transform(segment.joined)
