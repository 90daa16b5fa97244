"""The world model of one drone: the log, and what follows from it: all drones' frames and the source estimate."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.estimate import Estimate, FrameEstimates
from radron.agent.frames.swarm import SwarmFrames
from radron.agent.fusion.admission import Admission
from radron.agent.fusion.engine import RECOUNTED, Fusion
from radron.agent.fusion.posterior import Posterior, posterior_of
from radron.agent.fusion.registry import Estimators
from radron.agent.owntime import Utc
from radron.protocol.codes import Code
from radron.protocol.entries import Cone, Entry, EntryId
from radron.protocol.texts import CodedText

PUT_OFF = "it publishes more log entries than three cameras measure; the rest is put off. If it goes on, revoke it"
LATE_PUT_OFF = (
    "its log entries come late again and again, so they are put off. Check its link and its clock; if it goes on, revoke it"
)
FORGOTTEN = 250  # entries in a call of ``advance``: some milliseconds


class WorldModel:
    """The log and all that follows from it.

    ``frames``: of the whole swarm. ``fusion``: the log, and the estimator that the drone flies by; ``listeners``: others on the
    same log, by name. ``admission``: how many entries of each drone are taken. ``last_cone_ns``: own time of the newest cone in
    the log, of any drone; 0 where there is none. ``backlog_s``: for how long a received entry has been missing in the frames, or
    in the hypothesis by these frames, s; some seconds, and ``pending`` all the time, while late entries keep coming.
    """

    def __init__(
        self,
        mission: MissionConfig,
        listeners: Sequence[str],
        estimators: Estimators,
        frame_estimates: FrameEstimates = Estimate,
        *,
        judges_exposures: bool = True,
        utc: Utc | None = None,
    ) -> None:
        """``judges_exposures``: see ``ObservationLog``; ``utc``: of the drone; None: all times are UTC."""
        self._utc = utc or Utc()
        judged = {"judges_exposures": judges_exposures}
        self.frames = SwarmFrames(mission, frame_estimates)
        graph = self.frames.graph
        self.fusion = Fusion(mission, graph, estimators(mission.fusion.estimator, mission), **judged)
        self.listeners = {name: Fusion(mission, graph, estimators(name, mission), **judged) for name in listeners}
        self.admission = Admission(len(mission.drones))
        self.last_cone_ns, self.backlog_s = 0, 0.0
        self._started_ns = 0
        self._forgotten: list[EntryId] = []
        self._recounted = 0  # how many of the log's ``recounted`` the frames have seen to

    @property
    def pending(self) -> bool:
        """Whether frames or hypothesis lack entries of the log. Once complete, they are a function of the log and of the
        hypothesis's stamp.
        """
        return self.is_behind or self.fusion.pending

    @property
    def is_behind(self) -> bool:
        """As ``pending``, but for what another process has to compute first."""
        recounted = self._recounted == len(self.fusion.log.recounted)
        return bool(self._forgotten) or not recounted or self.frames.pending or self.fusion.is_behind

    def posteriors(self, now_ns: int) -> dict[str, Posterior]:
        """Return the posterior of each estimator by name, if it has one yet."""
        named = {self.fusion.estimator.name: self.fusion, **self.listeners}
        found = {name: posterior_of(fusion, now_ns) for name, fusion in named.items()}
        return {name: posterior for name, posterior in found.items() if posterior is not None}

    def start(self, started_ns: int) -> None:
        """Begin a mission with the start command of that stamp: earlier measurements do not count."""
        self.last_cone_ns, self._started_ns = 0, started_ns
        self.frames.start(started_ns)
        for fusion in (self.fusion, *self.listeners.values()):
            fusion.start(started_ns)

    def end_estimates(self) -> None:
        """Have no hypothesis from now on. Log and frames continue: the way home needs them."""
        for fusion in (self.fusion, *self.listeners.values()):
            fusion.end()

    def take(self, entry: Entry, payload: bytes, now_ns: int) -> bool:
        """Take an entry and its encoded bytes; False for a duplicate, or if not accepted."""
        log, publisher = self.fusion.log, (entry.drone, entry.boot)
        last = log.last_counted(*publisher)
        if not self.fusion.receive(entry, payload):
            if log.last_counted(*publisher) < last:
                self.forget(log.beyond(entry.drone, partial(log.last_counted, entry.drone), entry.boot))
            return False
        self.admission.charge(entry, now_ns)
        for listener in self.listeners.values():
            listener.receive(entry, payload)
        if log.leaves_out(entry):
            return True
        self.frames.receive(entry, payload)
        if isinstance(entry, Cone):
            self.last_cone_ns = max(self.last_cone_ns, min(self._utc.own_ns(entry.stamp_ns), now_ns))
        return True

    def problems(self, now_ns: int) -> tuple[CodedText, ...]:
        """Return one line for each drone with entries put off."""
        late = self.frames.put_off.union(*(fusion.late.put_off for fusion in (self.fusion, *self.listeners.values())))
        told = {name: (Code.ENTRIES_LATE, LATE_PUT_OFF) for name in late}
        told |= {name: (Code.ENTRIES_TOO_MANY, PUT_OFF) for name in self.admission.put_off(now_ns)}
        return tuple(CodedText(code, f"{name}: {text}", name) for name, (code, text) in sorted(told.items()))

    def forget(self, identities: Sequence[EntryId]) -> None:
        """Take entries back that do not count any more, a bounded number in each call of ``advance``."""
        self._forgotten = list(dict.fromkeys((*self._forgotten, *identities)))

    def _forget(self, now_ns: int) -> None:
        portion, self._forgotten = self._forgotten[:FORGOTTEN], self._forgotten[FORGOTTEN:]
        self.frames.forget(self.fusion.forget(portion))
        for listener in self.listeners.values():
            listener.forget(portion)
        if not self._forgotten:
            self._look_for_cones(now_ns)

    def _recount(self, now_ns: int) -> None:
        """Have the frames see to a bounded number of the entries that have ceased to count, or begun again."""
        log = self.fusion.log
        changed: dict[EntryId, bool] = {}
        for identity, counts in log.recounted[self._recounted : self._recounted + RECOUNTED]:
            self._recounted += 1
            if changed.pop(identity, None) is None:  # else it is as it was
                changed[identity] = counts
        self.frames.retract([identity for identity, counts in changed.items() if not counts])
        again = [log.record(identity) for identity, counts in changed.items() if counts and log.counts(identity)]
        self.frames.receive_again([(record.entry, record.payload) for record in again])
        if self._recounted == len(log.recounted):
            self._look_for_cones(now_ns)

    def _look_for_cones(self, now_ns: int) -> None:
        newest_ns = self.fusion.log.newest_ns(Cone)
        self.last_cone_ns = min(self._utc.own_ns(newest_ns), now_ns) if newest_ns >= self._started_ns else 0

    def advance(self, now_ns: int, common_ns: int | None = None) -> None:
        """Process new entries up to the common time of the swarm (UTC; None: now): almost free without any; a large backlog
        takes several calls.
        """
        until_ns = now_ns if common_ns is None else common_ns
        if self._forgotten:
            self._forget(now_ns)
        if self._recounted < len(self.fusion.log.recounted):
            self._recount(now_ns)
        self.frames.advance(self.fusion.begin_ns(until_ns), takes_late=not self.fusion.is_busy)
        takes_late = not self.frames.has_batch  # otherwise computed twice, and the frames would wait
        for fusion in (self.fusion, *self.listeners.values()):
            fusion.advance(until_ns, takes_late=takes_late)
        self.backlog_s = 1e-9 * max(0, until_ns - min(self.frames.complete_ns, self.fusion.complete_ns))
