"""From the log to the hypothesis: a fixed time grid, checkpoints, and replay in slices when an entry arrives late."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from typing import Any

from agent.config.mission import MissionConfig
from agent.frames.graph import FrameGraph
from agent.frames.swarm import BEFORE_START_NS
from agent.fusion.estimator import Estimator, GridStep, Hypothesis, Outlook
from agent.fusion.log import ObservationLog, Outcome
from agent.fusion.observation import Observation, observe
from agent.fusion.registry import estimator_named
from protocol.entries import AnyEntry, Entry, EntryId

SLICE_UNITS = 400  # work per call of advance, in units of ``Estimator.work``: about 10 ms
_MOST_CHECKPOINTS = 64  # 0.4 MB each while `bayes` searches
_NEVER = -1  # before every step

FrameKey = tuple[str, int]  # drone and epoch


class Fusion:
    """Keeps the log of one agent and the hypothesis that follows from it.

    Step k of the grid is [k g, (k + 1) g) UTC, g the estimator's step width or else the mission's. An observation belongs to the
    step of its stamp. With now the time of the last ``advance`` and h the estimator's ``hold_s``, the due step is
    floor((now - h) / g), and the hypothesis is

        hypothesis = H(E(.. E(E(initial, Z_1), Z_2) .., Z_n), due step)

    where E is the estimator's ``step``, H its ``hypothesis``, and Z_1 .. Z_n are the sets of observations of all steps up to the
    due one that have any. So it is a pure function of the log's content, of the known frames and of the due step; the order of
    arrival, duplicates, delays and the slicing of the work do not matter.

    The estimator's state after every step that has observations is a checkpoint. A new entry discards the checkpoints from its
    step on, and the steps from there on are computed again (replay). That holds for the newest step too, so without a hold a
    cone shows in the hypothesis at the next ``advance``. Only while a replay is unfinished is the hypothesis an older one.

    Entries of a frame that is not known yet are in the log and its digest, and enter the hypothesis once the frame is known.
    Entries measured long before the mission's start are in the log only.
    """

    def __init__(self, mission: MissionConfig, frames: FrameGraph, estimator: Estimator[Any] | None = None) -> None:
        self.log = ObservationLog(mission.mission_id, [drone.id for drone in mission.drones])
        self.hypothesis: Hypothesis | None = None
        self.pending = False  # a replay is under way, the hypothesis is older than the log
        self.estimator = estimator or estimator_named(mission.fusion.estimator, mission)
        self._grid_ns = round((self.estimator.grid_s or mission.fusion.grid_s) * 1e9)
        self._frames = frames
        self._revision = frames.revision
        self._waiting: dict[FrameKey, dict[EntryId, AnyEntry]] = {}  # entries whose frame is unknown
        self._timeline: dict[int, dict[EntryId, Observation]] = {}  # step -> its observations, never empty
        self._steps: list[int] = []  # the timeline's keys, ascending
        self._step_of: dict[EntryId, int] = {}  # where in the timeline an entry's observation is
        self._base: Any = self.estimator.initial(None)  # state before the first step of the timeline
        self._states: dict[int, Any] = {}  # checkpoints after their steps; ascending: the last one is the chain's end
        self._first_step = _NEVER  # once started; earlier observations are ignored
        self._hold_ns = round(self.estimator.hold_s * 1e9)
        self._due_step = _NEVER  # the newest one that is to be computed
        self._stale = True
        self._current: tuple[Any, int] = (None, _NEVER)  # state and due step of the present hypothesis

    @property
    def digest(self) -> str:
        """Digest of the log, 32 hex digits."""
        return self.log.digest

    @property
    def outlook(self) -> Outlook | None:
        """The posterior of a search; None while there is a hypothesis, or if the estimator has no such posterior."""
        if self.hypothesis is not None or self._due_step == _NEVER:
            return None
        return self.estimator.outlook(self.state, self._now_step)

    @property
    def state(self) -> Any:
        """The estimator's newest state."""
        return next(reversed(self._states.values()), self._base)

    def start(self, stamp_ns: int) -> None:
        """Set the mission's start (the origin of a ``given`` schedule). A later start begins anew, an earlier one is ignored."""
        first_step = -(-(stamp_ns - BEFORE_START_NS) // self._grid_ns)
        if first_step > self._first_step:
            self._first_step = first_step
            self._drop_before(self._first_step * self._grid_ns)
            self._base = self.estimator.initial(stamp_ns)
            self._rewind(_NEVER)

    def receive(self, entry: Entry, payload: bytes) -> bool:
        """Take an entry with the bytes that it was decoded from; False if the log does not take it (see ``log.counters``)."""
        outcome = self.log.add(entry, payload)
        if outcome is not Outcome.ADDED and outcome is not Outcome.REPLACED:
            return False
        if outcome is Outcome.REPLACED:
            self._remove(entry.entry_id)
        if isinstance(entry, self.estimator.reads):
            self._insert(entry)
        return True

    def advance(self, now_ns: int, budget: int = SLICE_UNITS) -> None:
        """Bring the hypothesis up to the grid step of ``now_ns``.

        ``budget``: at most so many units of the estimator's work; a step is never split and at least one is computed. ``pending``
        tells whether work is left for the next call. Time does not run back: an earlier now counts as the latest one so far.
        """
        due = (now_ns - self._hold_ns) // self._grid_ns
        if due > self._due_step:
            self._due_step = due
            self._stale = True
        if self._revision != self._frames.revision:
            self._apply_frame_changes()
        if self._stale:
            self._fold(budget)

    def _insert(self, entry: AnyEntry) -> None:
        """Put an entry's observation, if it has one, into the timeline."""
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
        """Take observations before a stamp out of the timeline; the caller discards the states."""
        kept = bisect_left(self._steps, -(-stamp_ns // self._grid_ns))
        for step in self._steps[:kept]:
            for identity in self._timeline.pop(step):
                del self._step_of[identity]
        del self._steps[:kept]

    def _remove(self, identity: EntryId) -> None:
        """Take an entry out of the waiting ones, and its observation, if there is one, out of the timeline."""
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
        """Discard the states from the step on."""
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
        if state is not self._current[0] or self._due_step != self._current[1]:
            self._current = state, self._due_step
            self.hypothesis = self.estimator.hypothesis(state, self._now_step)
        if len(self._states) > _MOST_CHECKPOINTS:
            for index in list(self._states)[1 : _MOST_CHECKPOINTS // 2 : 2]:  # the older, the sparser
                del self._states[index]

    def _apply_frame_changes(self) -> None:
        """Convert the entries again that were measured in frames whose estimate has changed."""
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
            self._remove(entry.entry_id)
            self._insert(entry)

    @property
    def _now_step(self) -> GridStep:
        """The interval of the times now that have the present due step."""
        return self._grid_step(self._due_step, self._hold_ns)

    def _grid_step(self, index: int, later_ns: int = 0) -> GridStep:
        return GridStep(index, index * self._grid_ns + later_ns, (index + 1) * self._grid_ns + later_ns)
