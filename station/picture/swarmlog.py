"""The swarm's log at a station, with the local frames and the source estimate that the drones' own code computes from it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.transform import Transform
from radron.agent.fusion.engine import Fusion
from radron.agent.fusion.exchange import LogExchange
from radron.agent.fusion.posterior import Posterior, posterior_of
from radron.agent.fusion.proofs import Proofs
from radron.agent.fusion.registry import Estimators, estimator_named
from radron.agent.fusion.revocations import Revocations
from radron.agent.mission.worldmodel import WorldModel
from radron.protocol.entries import Entry
from radron.protocol.messages import Status
from radron.protocol.revocations import Revocation
from radron.protocol.signing import Verifier
from radron.protocol.texts import CodedText


class SwarmLog:
    """The station's copy of the swarm's log, with the drones' local frames and the source estimate that follow from it.

    ``counters``: numbers of unanswerable log queries and refused revocations.
    """

    def __init__(
        self,
        mission: MissionConfig,
        verifier: Verifier | None,
        estimators: Estimators = estimator_named,
        *,
        judges_exposures: bool = True,
    ) -> None:
        """``verifier``: checks the entries' signatures; None: in a swarm without certificates. ``estimators``: makes the
        estimators by name. ``judges_exposures``: whether overlapping exposures are ignored (see ``ObservationLog``).
        """
        self.counters: Counter[str] = Counter()
        self._world = WorldModel(mission, (), estimators, judges_exposures=judges_exposures)
        drones = [drone.id for drone in mission.drones]
        self._revocations = Revocations(verifier, self.counters)
        self._proofs = Proofs(drones, ("", mission.mission_id, ""), None, verifier, self._revocations.leaves_out)
        self._exchange = LogExchange(mission.swarm, None, self.fusion.log, self.counters)
        self._started_ns = 0

    @property
    def fusion(self) -> Fusion:
        """The log together with the source estimate computed from it."""
        return self._world.fusion

    def start(self, started_ns: int) -> None:
        """Begin a mission whose start command has this time stamp (ns).

        A stamp not later than the known start changes nothing.
        """
        if started_ns > self._started_ns:
            self._started_ns = started_ns
            self._world.start(started_ns)

    def take(self, entry: Entry, payload: bytes, now_ns: int) -> Iterator[Entry]:
        """Add a received entry to the log, and yield the entries that are new in the log by this.

        An entry waits until the certificate of its drone is known. ``payload``: the entry's bytes as received.
        """
        for proven, content in self._proofs.proven(entry, payload, now_ns):
            if self._world.take(proven, content, now_ns):
                yield proven

    def is_signed(self, status: Status, now_ns: int) -> bool:
        """Return whether a status is signed by the drone that it names; always true in a swarm without certificates."""
        return self._proofs.is_signed(status, now_ns)

    def revoke(self, revocation: Revocation, now_ns: int, passed_on_by: str | None) -> None:
        """Obey a revocation (withdrawal of a member's rights): remove the member's later log entries, as the drones do.

        ``passed_on_by``: the drone that has relayed the revocation; None: not known.
        """
        if self._revocations.take(revocation, now_ns, passed_on_by) is None:
            self._world.forget(self.fusion.log.beyond(revocation.member, revocation.counts))

    @property
    def revoked(self) -> frozenset[str]:
        """Names of members whose rights have been withdrawn; their messages are ignored."""
        return self._revocations.names

    def advance(self, now_ns: int) -> None:
        """Update local frames and source estimate with the new log entries.

        The call does about 10 ms of work at most; the rest is left for the next calls.
        """
        self._world.advance(now_ns)

    @property
    def pending(self) -> bool:
        """Whether :meth:`advance` has work left."""
        return self._world.is_behind

    def mission_from_local(self, drone: str, epoch: int, at_ns: int | None = None) -> Transform | None:
        """Return the transform from a drone's local frame to the mission frame, as estimated from the log; None if unknown.

        ``at_ns``: time for which the transform holds, nanoseconds UTC.
        """
        return self._world.frames.graph.mission_from_local(drone, epoch, at_ns)

    def posterior(self, now_ns: int) -> Posterior | None:
        """Return the estimator's posterior distribution of the source's position; None if it has none."""
        return posterior_of(self.fusion, now_ns)

    def problems(self, now_ns: int) -> tuple[CodedText, ...]:
        """Return problems of the log, one line each.

        Reported are messages without a valid signature, and drones whose entries are postponed.
        """
        return *self._proofs.problems(now_ns), *self._world.problems(now_ns)

    def summary(self) -> bytes:
        """Return a summary of the log, with which the drones find the entries that are missing here."""
        return self._exchange.summary()
