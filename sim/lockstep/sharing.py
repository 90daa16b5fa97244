"""Computations shared by all agents of a simulated flight, to save time: source estimates of equal logs, and decoded messages.

A result computed by one agent from a state and observations is reused by the other agents.

An estimator's step is a pure function of an immutable state and of observations (``radron.agent.fusion.estimator``), and all
agents of a flight begin with one state. A state is therefore identified by its lineage: all steps before it, and the observations
of each. Agents with equal logs follow one lineage. Different logs split it; once the logs are equal again, the agents replay from
the split and return to one lineage, even if its states have been forgotten and each agent has its own. The frames are shared in
the same way (``sharedframes``). Nothing else is shared: every agent has its own log, observations and replays, and an error there
separates it from the others. In every tenth mission of a campaign one drone is recorded and replayed
(``radron.sim.campaign.faults.recording``): the replay computes on its own, as a check on the flight.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, Generic, NamedTuple, TypeVar, cast

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.estimator import Estimator, GridStep, Hypothesis, Outlook, contamination_of
from radron.agent.fusion.observation import ConeObservation, Observation
from radron.agent.fusion.registry import estimator_named
from radron.protocol.codec import decode_from
from radron.protocol.contamination import Contamination
from radron.protocol.entries import Entry
from radron.protocol.messages import AnyMessage
from radron.protocol.signing import Signed, signed_root
from radron.sim.scoring.moment import Shared

MAX_SHARED_STEPS = 256  # remembered: 25 s of a track, replayed side by side after a partition; up to 100 MB
MAX_LINEAGES = 4096  # without their states, for longer replays
MAX_SHARED_HYPOTHESES = 16  # all agents ask for the same ones at the same time
MAX_READ_MESSAGES = 512  # messages of more than a second of six drones, received within the delay of the radio
_UNKNOWN = object()

S = TypeVar("S")
R = TypeVar("R")


class Folds:
    """Gives the agents of one flight their estimators, and shares the computations between agents with equal logs."""

    def __init__(self) -> None:
        self._shared: dict[str, SharedFold[Any]] = {}

    def __call__(self, name: str, mission: MissionConfig) -> Estimator[Any]:
        """Return the estimator of that name, as ``estimator_named``: one for all agents."""
        if name not in self._shared:
            self._shared[name] = SharedFold(estimator_named(name, mission))
        return self._shared[name]


class Descended(NamedTuple, Generic[S]):
    """An estimator's state with its lineage: all observations from which it was computed.

    Agents with equal observations have one lineage object, by which results are shared.
    """

    state: S
    lineage: object


class SharedFold(Generic[S]):
    """An estimator for several agents, which computes each result only once.

    Errors are those of the estimator itself.
    """

    def __init__(self, estimator: Estimator[S]) -> None:
        self._estimator = estimator
        self.name, self.reads = estimator.name, estimator.reads
        self.grid_s, self.hold_s = estimator.grid_s, estimator.hold_s
        self._lineages, self._steps, self._hypotheses = (
            Results(MAX_LINEAGES),
            Results(MAX_SHARED_STEPS),
            Results(MAX_SHARED_HYPOTHESES),
        )
        self._initial: dict[int | None, Descended[S]] = {}  # one for each start command

    def initial(self, start_ns: int | None) -> Descended[S]:
        """Return the estimator's initial state, one object for all agents. ``start_ns``: stamp of the start command."""
        if start_ns not in self._initial:
            self._initial[start_ns] = Descended(self._estimator.initial(start_ns), object())
        return self._initial[start_ns]

    def step(self, state: Descended[S], step: GridStep, observations: Sequence[Observation]) -> Descended[S]:
        """Return the state after a step with these observations, as the estimator computes it."""
        lineage = self._lineages.get((state.lineage, step.index, tuple(map(_content, observations))), object)
        after = self._steps.get(lineage, lambda: self._estimator.step(state.state, step, observations))
        return Descended(after, lineage)

    def work(self, state: Descended[S], observations: int) -> int:
        """Return the work of a step as if it had not been computed yet.

        An agent's division of work therefore does not depend on other agents.
        """
        return self._estimator.work(state.state, observations)

    def hypothesis(self, state: Descended[S], step: GridStep) -> Hypothesis | None:
        """Return the source estimate of a state, as the estimator computes it; None without one."""
        return self._hypotheses.get((state.lineage, step), lambda: self._estimator.hypothesis(state.state, step))

    def outlook(self, state: Descended[S], step: GridStep) -> Outlook | None:
        """Return the state of the search, as the estimator computes it; None without one."""
        return self._estimator.outlook(state.state, step)

    def contamination(self, state: Descended[S], step: GridStep) -> Contamination | None:
        """Return the map of contaminated ground of a state, as the estimator makes it; None for another estimator."""
        return contamination_of(self._estimator, state.state, step)

    def mixture(self, state: Descended[S], stamp_ns: int) -> Any:
        """Return the Gaussian mixture of the posterior, as ``BayesEstimator`` computes it; None for another estimator."""
        mixture = getattr(self._estimator, "mixture", None)
        return None if mixture is None else mixture(state.state, stamp_ns)


class Readings(Shared):
    """Decodes messages, each only once for all agents of a flight, as decoded messages are immutable."""

    def __init__(self) -> None:
        self._read = lru_cache(MAX_READ_MESSAGES)(decode_from)

    def __call__(self, key: str, payload: bytes) -> AnyMessage:
        """Decode as ``decode_from``; raises the same errors, each time."""
        return self._read(key, payload)


class SignedRoots:
    """Computes the signed bytes (root of the hash tree) of each log entry only once for all agents of a flight."""

    def __init__(self) -> None:
        self._known = Results(MAX_READ_MESSAGES)

    def __call__(self, entry: Entry, payload: bytes) -> Signed | None:
        """Return the signed root, as ``signed_root`` does."""
        return self._known.get(payload, partial(signed_root, entry, payload))


class Results(Shared):
    """Memory of the newest results, by the data from which they were computed."""

    def __init__(self, most: int) -> None:
        """``most``: number of results that are kept."""
        self._most = most
        self._known: dict[object, object] = {}  # the last used at the end

    def get(self, key: object, compute: Callable[[], R]) -> R:
        """Return the result for a key, from memory or computed now."""
        result = self._known.pop(key, _UNKNOWN)  # keys hold all observations of a step: each lookup costs
        if result is _UNKNOWN:
            result = compute()
        self._known[key] = result
        if len(self._known) > self._most:
            del self._known[next(iter(self._known))]
        return cast(R, result)


def _content(observation: Observation) -> tuple[object, ...]:
    """Return the content of an observation, by value."""
    transform = observation.mission_from_local
    covariance = None if transform.covariance is None else transform.covariance.tobytes()
    frame = transform.yaw_rad, transform.translation, covariance
    common = observation.stamp_ns, observation.position_sigma_m, observation.yaw_sigma_rad, frame
    entry = observation.identity, observation.epoch
    if isinstance(observation, ConeObservation):
        return *entry, *common, observation.readings, observation.energy_kev
    counted = observation.live_time_s, observation.counts.tobytes(), observation.spectrum
    return *entry, *common, observation.middle_ns, observation.position, observation.facing, observation.way_m, *counted
