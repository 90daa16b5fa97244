"""The swarm's log at a station, with the frames and the source estimate from it, by the code that flies on board."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from agent.config.mission import MissionConfig
from agent.frames.transform import Transform
from agent.fusion.engine import Fusion
from agent.fusion.exchange import LogExchange
from agent.fusion.posterior import Posterior, posterior_of
from agent.fusion.proofs import Proofs
from agent.fusion.registry import Estimators, estimator_named
from agent.fusion.revocations import Revocations
from agent.mission.worldmodel import WorldModel
from protocol.entries import Entry
from protocol.messages import Status
from protocol.revocations import Revocation
from protocol.signing import Verifier


class SwarmLog:
    """The log, its frames and its estimate. ``counters``: of unanswerable log queries and refused revocations."""

    def __init__(
        self,
        mission: MissionConfig,
        verifier: Verifier | None,
        estimators: Estimators = estimator_named,
        *,
        judges_exposures: bool = True,
    ) -> None:
        """``verifier``: of the entries' signatures; None: in a swarm without certificates. ``estimators``: makes the estimators.
        ``judges_exposures``: see ``ObservationLog``.
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
        """The fusion: log, hypothesis and outlook."""
        return self._world.fusion

    def start(self, started_ns: int) -> None:
        """Begin a mission with the start command of that stamp; a stamp not later than the known start changes nothing."""
        if started_ns > self._started_ns:
            self._started_ns = started_ns
            self._world.start(started_ns)

    def take(self, entry: Entry, payload: bytes, now_ns: int) -> Iterator[Entry]:
        """Take an entry and yield the entries new in the log with it; without its drone's certificate an entry waits."""
        for proven, content in self._proofs.proven(entry, payload, now_ns):
            if self._world.take(proven, content, now_ns):
                yield proven

    def is_signed(self, status: Status, now_ns: int) -> bool:
        """Return whether a status is signed by its drone; in a swarm without certificates every status counts."""
        return self._proofs.is_signed(status, now_ns)

    def revoke(self, revocation: Revocation, now_ns: int, passed_on_by: str | None) -> None:
        """Take a revocation and drop the member's revoked entries, like the drones do; ``passed_on_by``: a drone, if known."""
        if self._revocations.take(revocation, now_ns, passed_on_by) is None:
            self._world.forget(self.fusion.log.beyond(revocation.member, revocation.counts))

    @property
    def revoked(self) -> frozenset[str]:
        """Names of the revoked members: their messages do not count any more."""
        return self._revocations.names

    def advance(self, now_ns: int) -> None:
        """Bring frames and hypothesis up to now: about 10 ms of work at most, the rest is left for the next calls."""
        self._world.advance(now_ns)

    @property
    def pending(self) -> bool:
        """Whether work is left for ``advance``."""
        return self._world.is_behind

    def mission_from_local(self, drone: str, epoch: int, at_ns: int | None = None) -> Transform | None:
        """Return a drone's local frame in the mission frame, as estimated from the log; None if unknown."""
        return self._world.frames.graph.mission_from_local(drone, epoch, at_ns)

    def posterior(self, now_ns: int) -> Posterior | None:
        """Return the estimator's posterior."""
        return posterior_of(self.fusion, now_ns)

    def problems(self, now_ns: int) -> tuple[str, ...]:
        """Return the log's problems: dropped messages without a valid signature, and drones with entries put off."""
        return *self._proofs.problems(now_ns), *self._world.problems(now_ns)

    def summary(self) -> bytes:
        """Return a request for the entries missing here."""
        return self._exchange.summary()
