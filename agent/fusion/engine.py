"""From the log to the hypothesis: a fixed time grid, checkpoints, and replay in slices when an entry arrives late."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import Any, cast

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.batches import LATE_NS, Batches
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.swarm import BEFORE_START_NS
from radron.agent.fusion.chains import NEVER, Chains
from radron.agent.fusion.deferred import Deferred, Told
from radron.agent.fusion.estimator import Estimator, GridStep, Hypothesis, Outlook, contamination_of
from radron.agent.fusion.lateness import Late, Latecomers
from radron.agent.fusion.log import ObservationLog, Outcome
from radron.agent.fusion.observation import CountObservation, known_ns, observe
from radron.agent.fusion.observations import Observations
from radron.agent.fusion.registry import estimator_named
from radron.agent.fusion.timeline import Timeline
from radron.agent.geometry import Vector3
from radron.protocol.contamination import Contamination
from radron.protocol.entries import AnyEntry, Entry, EntryId

RECOUNTED = 250  # entries that begin or cease to count in a call of ``advance``: some milliseconds
SLICE_UNITS = 400  # work per call of advance, in units of ``Estimator.work``: about 10 ms
UNTOLD_NS = 500_000_000  # delay after which a hypothesis of the steps computed so far is published
_AFTER = 2**63  # after every step

FrameKey = tuple[str, int]  # drone and epoch


class Fusion:
    """Keeps the observation log of one agent, and computes the source estimate (hypothesis) that follows from it.

    Step k of the grid is [k g, (k + 1) g) UTC, g the estimator's step width or else the mission's. An observation belongs to the
    step of its stamp. With now the time of the last ``advance`` and h the estimator's ``hold_s``, the due step is floor((now - h)
    / g), and the hypothesis is

        hypothesis = H(E(.. E(E(initial, Z_1), Z_2) .., Z_n), due step)

    where E is the estimator's ``step``, H its ``hypothesis``, and Z_1 .. Z_n are the non-empty sets of observations of all steps
    up to the due step. The hypothesis is a pure function of the log's content, the known frames and the due step. The order of
    arrival, duplicates, delays and the slicing of the work do not matter.

    The estimator's state after every step with observations is a checkpoint. A new entry discards the checkpoints from its step
    on, and the later steps are recomputed (replay). This includes the newest step; without a hold a cone shows in the hypothesis
    at the next ``advance``. The hypothesis is an older one only while steps remain to be computed. After ``UNTOLD_NS`` the
    hypothesis of the newest state so far replaces it, if this state is later and not older than ``LATE_NS``. So even a slow
    computer that never catches up publishes new hypotheses.

    Entries that arrive after their step has been computed are folded in batches (``lateness``). An entry late by a second is in
    the hypothesis a second later at most. Entries late by more than ``LATE_NS`` cause a replay in parallel to the present chain
    of states. This continues without them until the replay is complete. The next replay takes all late entries received meanwhile
    (``Batches``). So repeated old entries of a drone delay nothing, and each is in the hypothesis some seconds later (``pending``
    and ``complete_ns``).

    Entries of an unknown frame are in the log and its digest, and enter the hypothesis once the frame is known. Entries measured
    long before the mission's start are in the log only.
    """

    def __init__(
        self,
        mission: MissionConfig,
        frames: FrameGraph,
        estimator: Estimator[Any] | None = None,
        *,
        judges_exposures: bool = True,
    ) -> None:
        """Start with an empty log. ``judges_exposures``: see ``ObservationLog``."""
        drones = [drone.id for drone in mission.drones]
        self.log = ObservationLog(mission.mission_id, drones, judges_exposures=judges_exposures)
        self.hypothesis: Hypothesis | None = None
        self.estimator = estimator or estimator_named(mission.fusion.estimator, mission)
        self._grid_ns = round((self.estimator.grid_s or mission.fusion.grid_s) * 1e9)
        self._frames = frames
        self._revision = frames.revision
        self._waiting: dict[FrameKey, dict[EntryId, None]] = {}  # entries whose frame is unknown
        self._waits_in: dict[EntryId, FrameKey] = {}
        self._latecomers = Latecomers()
        self._recounted = 0  # processed entries of ``log.recounted``
        self._batches = Batches()
        self.late = Late(self._batches)
        self._timeline = Timeline(1e-9 * self._grid_ns)
        self._observations = Observations(self.log, frames)
        self._chains = Chains(self._timeline, self._step, self._batches)
        self._chains.begin(self.estimator.initial(None))
        self._first_step = NEVER  # once started; earlier observations are ignored
        self._hold_ns = round(self.estimator.hold_s * 1e9)
        self._due_step = NEVER  # the newest step to be computed
        self._stale, self._ended = True, False
        self._told: tuple[int, Any, int] = (NEVER, None, NEVER)  # of the present hypothesis: newest step, its state, due step
        self._put_at: tuple[int, int] | None = None  # time and due step of the last call with only steps to compute
        self.complete_ns = 0  # time of an ``advance``: all entries received before it are in the hypothesis

    @property
    def digest(self) -> str:
        """Hash over the content of the log, 32 hex digits."""
        return self.log.digest

    @property
    def hypothesis_digest(self) -> str:
        """Hash over the log from which the source estimate follows: an earlier log than now if another process computes it."""
        return self.estimator.answered_digest if isinstance(self.estimator, Deferred) else self.digest

    @property
    def pending(self) -> bool:
        """Whether the source estimate lacks part of the log, or of the known frames; further calls of ``advance`` add it."""
        return self.is_behind or (not self._ended and isinstance(self.estimator, Deferred) and self.estimator.waits)

    @property
    def is_behind(self) -> bool:
        """Whether computations of this process are missing in the source estimate; those of another process do not count."""
        return not self._ended and (self._stale or self._waits or self._revision != self._frames.revision)

    @property
    def _waits(self) -> bool:
        """Whether late entries wait, or entries that have begun or ceased to count."""
        return bool(self._latecomers or self.late) or self._recounted < len(self.log.recounted)

    @property
    def is_busy(self) -> bool:
        """Whether a large recomputation is running, or was a moment ago, so that a further one has to wait."""
        return not self._ended and (self._chains.is_replaying or self._batches.is_resting)

    def begin_ns(self, now_ns: int) -> int:
        """Return the first time (UTC, ns) from which the source estimate is the one of ``now_ns``: the estimate changes with the
        time grid.
        """
        return (now_ns - self._hold_ns) // self._grid_ns * self._grid_ns + self._hold_ns

    @property
    def outlook(self) -> Outlook | None:
        """The posterior of a search; None while there is an estimate of one source, or if the estimator does not search."""
        found = self.hypothesis is not None and self.hypothesis.watched_s is None
        if found or self._due_step == NEVER:
            return None
        return self.estimator.outlook(self.state, self._now_step)

    @property
    def contamination(self) -> Contamination | None:
        """The map of contaminated ground; None if there is none yet, or the estimator makes none."""
        return None if self._due_step == NEVER else contamination_of(self.estimator, self.state, self._now_step)

    def place(self, identity: EntryId) -> tuple[Vector3, float] | None:
        """Return the camera's position (mission frame, m) for a log entry (signed measurement), and 1 sigma of the horizontal
        distance; None if it is not used.
        """
        found = None
        with suppress(KeyError):  # it is not in the log
            found = self._observations.of(identity) if self.log.counts(identity) else None
        if found is None:
            return None
        return found.position if isinstance(found, CountObservation) else found.apex, found.position_sigma_m

    @property
    def state(self) -> Any:
        """The estimator's newest state, from which the source estimate follows."""
        return self._chains.newest[1]

    def start(self, stamp_ns: int) -> None:
        """Set the mission's start (UTC, ns), which is the origin of a ``given`` schedule. Measurements from long before are
        ignored.

        A later start begins again, an earlier one is ignored.
        """
        first_step = -(-(stamp_ns - BEFORE_START_NS) // self._grid_ns)
        if first_step > self._first_step:
            self._first_step = first_step
            self._timeline.drop_before(self._first_step)
            self._chains.begin(self.estimator.initial(stamp_ns))
            self._told, self._stale = (NEVER, None, NEVER), True

    def end(self) -> None:
        """Stop estimating the source for good: from now on only the log is kept."""
        self._ended, self.hypothesis, self._due_step = True, None, NEVER

    def receive(self, entry: Entry, payload: bytes) -> bool:
        """Add an entry to the log, with its received bytes; return False if the log does not accept it (see ``log.counters``)."""
        if self.log.add(entry, payload) is not Outcome.ADDED:
            return False
        if not self._ended and isinstance(entry, self.estimator.reads) and not self.log.leaves_out(entry):
            self._take(self.log.identity_of(entry), entry, known_ns(entry) // self._grid_ns)
        return True

    def _take(self, identity: EntryId, read: AnyEntry | None, step: int) -> None:
        """Replace the entry held of an identity by another, or by nothing; now, or with a batch if it is late."""
        if not self._first_step <= step <= self._chains.newest[0]:  # no computed step changes
            self._rewind(self._put(identity, read))
        elif step < self._oldest_step:
            self.late.add(identity, read)
        elif step < self._due_step:
            self._latecomers.add(identity, read, self._due_step - step)
        else:
            self._rewind(self._put(identity, read))

    def _recount(self) -> None:
        """Process entries that have begun or ceased to count: as late as a new entry, which delays nothing."""
        portion = self.log.recounted[self._recounted : self._recounted + RECOUNTED]
        self._recounted += len(portion)
        for identity, _ in portion:
            self.late.discard(identity)
            self._latecomers.discard(identity)
            entry = self.log.entry(identity) if self.log.counts(identity) else None
            if isinstance(entry, self.estimator.reads):
                self._take(identity, entry, known_ns(entry) // self._grid_ns)
            else:  # without a step it waits for its frame, or holds no observation
                step = self._timeline.step_of(identity)
                self._take(identity, None, _AFTER if step is None else step)

    def forget(self, identities: Iterable[EntryId]) -> list[EntryId]:
        """Remove entries that do not count any more, and return those that were held.

        The estimator's states since then are computed again; if there are many, in parallel to the present ones.
        """
        gone = [identity for identity in identities if self.log.forget(identity)]
        for identity in gone:
            self.late.discard(identity)
            self._latecomers.discard(identity)
        self._change_from(min((self._put(identity, None) for identity in gone), default=_AFTER))
        return gone

    @property
    def _oldest_step(self) -> int:
        """Changes of earlier steps are late."""
        return self._due_step - LATE_NS // self._grid_ns

    def answered(self, question: int, told: Told) -> None:
        """Accept an answer of the process that computes the estimator; the next ``advance`` publishes it. question: number of the
        question.
        """
        if isinstance(self.estimator, Deferred):
            self.estimator.take(question, told)
            self._told, self._stale = (NEVER, None, NEVER), True

    def advance(self, now_ns: int, budget: int = SLICE_UNITS, *, takes_late: bool = True) -> None:
        """Bring the source estimate forward to the time ``now_ns``, or back to it after a step of the clock; a limited amount of
        work per call.

        ``budget``: limit in units of the estimator's work; a step is never split and at least one is computed. ``pending`` is
        True while work is left for the next call. ``takes_late``: whether a large recomputation may begin.
        """
        if self._ended:
            self.complete_ns = now_ns
            return
        before, self._due_step = self._due_step, (now_ns - self._hold_ns) // self._grid_ns
        if self._due_step < before:
            self._rewind(self._due_step + 1)
            self._told = min(self._told[0], self._due_step), None, self._due_step  # the published one was of the future
        self._stale = self._stale or self._due_step != before
        self._recount()
        was_replaying = self._chains.is_replaying
        are_due = self._batches.are_due(self._due_step * self._grid_ns + self._hold_ns, free=takes_late and not was_replaying)
        if self._revision != self._frames.revision:
            self._apply_frame_changes(begins=takes_late or was_replaying)
        begins = (self._chains.is_replaying and not was_replaying) or self._chains.goes_back
        self._take_waiting(before, are_due or begins)
        if self._put_at is None and not self._waits and self._revision == self._frames.revision:
            self._put_at = now_ns, self._due_step
        if self._stale:
            self._fold(budget)
        if self._put_at is not None and self._holds(self._put_at[1]):
            self.complete_ns, self._put_at = self._put_at[0], None

    def _take_waiting(self, before: int, takes_late: bool) -> None:
        """Add the entries whose batch is due, at a call that has advanced the due step from ``before``."""
        late = self.late.taken() if takes_late else {}
        if self._latecomers:
            latecomers = self._latecomers.all_taken() if late else self._latecomers.taken(before, self._due_step)
            for identity, entry in latecomers.items():
                self._rewind(self._put(identity, entry))
        first: dict[str, int] = {}
        for identity, entry in late.items():
            first[identity.drone] = min(self._put(identity, entry), first.get(identity.drone, _AFTER))
        self._batches.charge({drone: 1e-9 * self._grid_ns * (self._due_step - step) for drone, step in first.items()})
        self._begin_replay(min(first.values(), default=_AFTER))

    def _begin_replay(self, step: int) -> None:
        """Recompute the states from the step on, in parallel to the present ones."""
        if step <= self._due_step:
            self._stale = True
            self._chains.replay(step)

    def _put(self, identity: EntryId, entry: AnyEntry | None) -> int:
        """Replace the observation of an identity in the timeline by that of an entry, if it has any.

        Returns the first step that changes by it, or else ``_AFTER``.
        """
        key = self._waits_in.pop(identity, None)
        if key is not None:
            held = self._waiting[key]
            del held[identity]
            if not held:
                del self._waiting[key]
        self._observations.discard(identity)
        changed = self._timeline.remove(identity)
        first = _AFTER if changed is None else changed
        if entry is None:
            return first
        transform = self._frames.mission_from_local(entry.drone, entry.epoch, entry.stamp_ns)
        if transform is None:
            key = self._waits_in[identity] = entry.drone, entry.epoch
            self._waiting.setdefault(key, {})[identity] = None
            return first
        if (observation := observe(entry, transform, identity)) is None:
            return first
        if (step := observation.stamp_ns // self._grid_ns) < self._first_step:
            return first
        self._observations.put(identity, observation)
        changes = self._timeline.add(step, identity, entry.epoch, is_exposure=isinstance(observation, CountObservation))
        return min(first, step) if changes else first

    def _rewind(self, step: int) -> None:
        """Discard the states from the step on."""
        self._chains.rewind(step)
        if step <= self._due_step:
            self._stale = True

    def _fold(self, budget: int) -> None:
        """Compute the missing states, and publish the hypothesis of the newest state."""
        complete = self._chains.extend(self._due_step, self._oldest_step, budget)
        self._stale = not complete or self._chains.is_replaying
        (newest, state), (told, told_state, told_at) = self._chains.newest, self._told
        if not complete and newest <= told:
            newest, state = told, told_state  # the newest published state; from now on it is an older one
        waited = (self._due_step - told_at) * self._grid_ns > UNTOLD_NS and state is not None
        tells = complete or (waited and not (self._chains.lags and told == NEVER))
        if tells and (state is not told_state or self._due_step != told_at):
            self._told = newest, state, self._due_step
            if isinstance(self.estimator, Deferred):
                self.estimator.digest = self.digest
            self.hypothesis = self.estimator.hypothesis(state, self._now_step)

    def _holds(self, step: int) -> bool:
        """Return whether the hypothesis follows from all steps up to this one, except for waiting entries."""
        newest, state = self._chains.newest
        missing = self._timeline.between(newest, min(step, self._due_step))
        return not missing and not self._chains.is_replaying and state is self._told[1]

    def _step(self, state: Any, index: int) -> tuple[Any, int]:
        """Return the state after a step, and its work."""
        identities = self._timeline.of(index)
        work = self._observations.missing(identities)
        observations = [found for identity in identities if (found := self._observations.of(identity)) is not None]
        work += self.estimator.work(state, len(observations))
        return self.estimator.step(state, self._grid_step(index), observations), work

    def _apply_frame_changes(self, *, begins: bool) -> None:
        """Convert the entries of changed frames again. ``begins``: even if this causes a large replay."""
        changes = self._frames.changes(self._revision)
        first = min(changes.values(), default=0) // self._grid_ns
        if not begins and self._chains.newest[0] != NEVER and first < self._oldest_step:
            return
        self._revision = self._frames.revision
        again = [identity for key in changes for identity in self._waiting.get(key, ())]
        for seen in self._timeline.since(first):
            changed_ns = changes.get((seen.identity.drone, seen.epoch))
            if changed_ns is not None and seen.identity.stamp_ns >= changed_ns:
                again.append(seen.identity)
        steps = [self._put(identity, cast(AnyEntry, self.log.entry(identity))) for identity in again]
        self._change_from(min(steps, default=_AFTER))

    def _change_from(self, step: int) -> None:
        """Recompute the states from the step on."""
        if step < self._oldest_step and self._chains.newest[0] != NEVER:
            self._begin_replay(step)
        else:
            self._rewind(step)

    @property
    def _now_step(self) -> GridStep:
        """The interval of the times now with the present due step."""
        return self._grid_step(self._due_step, self._hold_ns)

    def _grid_step(self, index: int, later_ns: int = 0) -> GridStep:
        return GridStep(index, index * self._grid_ns + later_ns, (index + 1) * self._grid_ns + later_ns)
