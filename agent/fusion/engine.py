"""From the log to the hypothesis: a fixed time grid, checkpoints, and replay in slices when an entry comes late."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable
from typing import Any

from agent.config import MissionConfig
from agent.frames.graph import FrameGraph
from agent.frames.swarm import BEFORE_START_NS
from agent.fusion.estimator import Estimator, GridStep, Hypothesis, Outlook
from agent.fusion.log import ObservationLog, Outcome, Summary
from agent.fusion.observation import Observation, observe
from agent.fusion.registry import estimator_named
from protocol.messages import AnyEntry, Entry, EntryId

SLICE_UNITS = 400  # work per call of advance, in the estimators' units: about 10 ms
_MOST_CHECKPOINTS = 64  # 0.4 MB each while `bayes` searches
_NEVER = -1  # before every step

FrameKey = tuple[str, int]  # drone and epoch


class Fusion:
    """Keeps the log of one agent and the hypothesis that follows from it.

    Step k of the grid is [k g, (k+1) g) UTC, g the estimator's width or else the mission's. An observation belongs to the step of
    its stamp. The hypothesis is a pure function of the log's content, of the frames known, and of the grid step in which the time
    the estimator's ``hold_s`` ago lies: entries up to the end of that step are in it; later ones wait. The way there
    (order of arrival, duplicates, delay, how the work was sliced) leaves no trace.

    The estimator's state after every step that has observations is a checkpoint. An entry takes the chain of states back to the
    last one before its step; the steps from there on are folded again. That holds for the newest step too, so without a hold a
    cone shows in the hypothesis at the next ``advance``. Only while a replay is not finished the hypothesis is an older one.

    Entries of a frame that is not known are in the log and its digest, and join the hypothesis once the frame is known. Those
    measured long before the mission's start are in the log only.
    """

    def __init__(self, mission: MissionConfig, frames: FrameGraph, estimator: Estimator[Any] | None = None) -> None:
        self.log = ObservationLog(mission.mission_id, [drone.id for drone in mission.drones])
        self.hypothesis: Hypothesis | None = None
        self.pending = False  # a replay is under way, the hypothesis is older than the log
        self.estimator = estimator or estimator_named(mission.fusion.estimator, mission)
        self._grid_ns = round((self.estimator.grid_s or mission.fusion.grid_s) * 1e9)
        self._keep_ns = round(mission.fusion.horizon_s * 1e9)
        self._frames = frames
        self._revision = frames.revision
        self._waiting: dict[FrameKey, dict[EntryId, AnyEntry]] = {}  # entries whose frame is not known
        self._timeline: dict[int, dict[EntryId, Observation]] = {}  # step -> its observations, never empty
        self._steps: list[int] = []  # the timeline's keys, ascending
        self._step_of: dict[EntryId, int] = {}  # where in the timeline an entry's observation is
        self._base: Any = self.estimator.initial(None)  # state before the first step of the timeline
        self._states: dict[int, Any] = {}  # checkpoints after their steps; ascending: the last one is the chain's end
        self._first_step = _NEVER  # once started: what was measured before it says nothing
        self._hold_ns = round(self.estimator.hold_s * 1e9)
        self._due_step = _NEVER  # the newest one that is to be folded
        self._stale = True
        self._told: tuple[Any, int] = (None, _NEVER)  # state and due step that the hypothesis is of

    @property
    def digest(self) -> str:
        """Digest of the log, 32 hex digits."""
        return self.log.digest

    @property
    def outlook(self) -> Outlook | None:
        """What is known while there is no hypothesis; None where there is one, or the estimator knows of no such thing."""
        if self.hypothesis is not None or self._due_step == _NEVER:
            return None
        state = next(reversed(self._states.values()), self._base)
        return self.estimator.outlook(state, self._now_step)

    def start(self, stamp_ns: int) -> None:
        """The mission began: the origin of a ``given`` schedule. Only the first call counts."""
        if self._first_step == _NEVER and not self.log.horizon_ns:
            self._first_step = -(-(stamp_ns - BEFORE_START_NS) // self._grid_ns)
            self._drop_before(self._first_step * self._grid_ns)
            self._base = self.estimator.initial(stamp_ns)
            self._rewind(_NEVER)

    def receive(self, entry: Entry, payload: bytes) -> bool:
        """Take an entry with the bytes that it was decoded from; False if the log has no use for it (``log.counters``)."""
        outcome = self.log.add(entry, payload)
        if outcome is not Outcome.ADDED and outcome is not Outcome.REPLACED:
            return False
        if outcome is Outcome.REPLACED:
            self._displace(entry.entry_id)
        if isinstance(entry, self.estimator.reads):
            self._place(entry)
        return True

    def advance(self, now_ns: int, budget: int = SLICE_UNITS) -> None:
        """Fold what is in the log up to the grid step of ``now_ns``.

        ``budget``: at most so many units of the estimator's work; a step is never split and at least one is folded. ``pending``
        tells whether anything is left for the next call. Time never runs back: an earlier now is taken as the latest one.
        """
        due = (now_ns - self._hold_ns) // self._grid_ns
        if due > self._due_step:
            self._due_step = due
            self._stale = True
        if self._revision != self._frames.revision:
            self._take_new_frames()
        if self._stale:
            self._fold(budget)

    def compact(self, now_ns: int, peers: Iterable[Summary]) -> None:
        """Drop entries that are older than the configured horizon and that no peer lacks (by their logs' summaries).

        Neither digest nor hypothesis changes. Entries that wait for their frame stay, and so does everything after them.
        ``peers`` must be those of all other drones of the mission: what a silent one lacks is not known. No agent calls this: one
        that is restarted in flight lacks everything, and gets it back only from whole logs.
        """
        before_ns = min(self.log.agreed_until_ns(peers), now_ns - self._keep_ns)
        before_ns = min((before_ns, *(entry.stamp_ns for waiting in self._waiting.values() for entry in waiting.values())))
        behind = [step for step in self._states if (step + 1) * self._grid_ns <= before_ns]
        if not behind:
            return
        last = behind[-1]  # its state stands for everything up to the end of the step
        self._base = self._states[last]
        for step in behind:
            del self._states[step]
        self._drop_before((last + 1) * self._grid_ns)
        self.log.compact((last + 1) * self._grid_ns)

    def _place(self, entry: AnyEntry) -> None:
        """Put an entry's observation, if it is one, into the timeline."""
        transform = self._frames.mission_from_local(entry.drone, entry.epoch, entry.stamp_ns)
        if transform is None:
            self._waiting.setdefault((entry.drone, entry.epoch), {})[entry.entry_id] = entry
            return
        observation = observe(entry, transform)
        if observation is None:
            return
        step = observation.stamp_ns // self._grid_ns
        if step < self._first_step:
            return
        self._step_of[entry.entry_id] = step
        if step not in self._timeline:
            self._timeline[step] = {}
            insort(self._steps, step)
        self._timeline[step][entry.entry_id] = observation
        self._rewind(step)

    def _drop_before(self, stamp_ns: int) -> None:
        """Take out of the timeline what was measured so early; the caller rewinds."""
        kept = bisect_left(self._steps, -(-stamp_ns // self._grid_ns))
        for step in self._steps[:kept]:
            for identity in self._timeline.pop(step):
                del self._step_of[identity]
        del self._steps[:kept]

    def _displace(self, identity: EntryId) -> None:
        """Take an entry out of those that wait, and its observation, if there is one, out of the timeline."""
        for waiting in self._waiting.values():
            waiting.pop(identity, None)
        step = self._step_of.pop(identity, None)
        if step is None:
            return
        slot = self._timeline[step]
        del slot[identity]
        if not slot:
            del self._timeline[step]
            del self._steps[bisect_left(self._steps, step)]
        self._rewind(step)

    def _rewind(self, step: int) -> None:
        """Drop every state that knows of the step or a later one."""
        while self._states and next(reversed(self._states)) >= step:
            self._states.popitem()
        if step <= self._due_step:
            self._stale = True

    def _fold(self, budget: int) -> None:
        end, state = next(reversed(self._states.items()), (_NEVER, self._base))
        for index in self._steps[bisect_right(self._steps, end) : bisect_right(self._steps, self._due_step)]:
            if budget <= 0:
                self.pending = True
                return
            slot = self._timeline[index]
            budget -= self.estimator.work(state, len(slot))
            state = self.estimator.step(state, self._grid_step(index), [slot[identity] for identity in sorted(slot)])
            self._states[index] = state
        self.pending = self._stale = False
        if state is not self._told[0] or self._due_step != self._told[1]:
            self._told = state, self._due_step
            self.hypothesis = self.estimator.hypothesis(state, self._now_step)
        if len(self._states) > _MOST_CHECKPOINTS:
            for index in list(self._states)[1 : _MOST_CHECKPOINTS // 2 : 2]:  # so the older they are the fewer they get
                del self._states[index]

    def _take_new_frames(self) -> None:
        """Observe again what was measured in frames that have changed since."""
        changes = self._frames.changes(self._revision)
        self._revision = self._frames.revision
        again: list[AnyEntry] = [entry for key in changes for entry in self._waiting.pop(key, {}).values()]
        first = bisect_left(self._steps, min(changes.values(), default=0) // self._grid_ns)
        for step in self._steps[first:]:
            for observation in self._timeline[step].values():
                measured = observation.entry
                changed_ns = changes.get((measured.drone, measured.epoch))
                if changed_ns is not None and measured.stamp_ns >= changed_ns:
                    again.append(measured)
        for entry in again:
            self._displace(entry.entry_id)
            self._place(entry)

    @property
    def _now_step(self) -> GridStep:
        """All times that are now while the due step is what it is."""
        return self._grid_step(self._due_step, self._hold_ns)

    def _grid_step(self, index: int, later_ns: int = 0) -> GridStep:
        return GridStep(index, index * self._grid_ns + later_ns, (index + 1) * self._grid_ns + later_ns)
