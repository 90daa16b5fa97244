"""What is computed once for all agents of a flight: the folds of equal logs, and the messages that several receive.

What one has computed from a state and observations, the others need not again.

An estimator's step is a pure function of a state that never changes and of observations (``agent.fusion.estimator``), and all
agents of a flight begin with the same state. So a state is known by its lineage: all steps that led to it, and what was observed
in each. Agents with equal logs walk along one lineage. Where their logs differ they part; once the logs are equal again, they
replay from where they parted, and are on one lineage again, even if the states of it had been forgotten and each has its own.
So it is with the frames (``sharedframes``). Nothing else is shared: every agent has its own log, observations and replays, and
whatever goes wrong there parts it from the others. In every tenth mission of a campaign one drone is recorded, and replayed
(``sim.campaign.faults.recording``): the replay computes on its own, as a check on the flight.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, Generic, NamedTuple, TypeVar, cast

from agent.config.mission import MissionConfig
from agent.fusion.estimator import Estimator, GridStep, Hypothesis, Outlook
from agent.fusion.observation import ConeObservation, Observation
from agent.fusion.registry import estimator_named
from protocol.codec import decode_from
from protocol.entries import Entry
from protocol.messages import AnyMessage
from protocol.signing import Signed, signed_root
from sim.scoring.moment import Shared

MOST_STEPS = 256  # that are remembered: 25 s of a track, which agents replay side by side after a partition; up to 100 MB
MOST_LINEAGES = 4096  # without their states, for those that replay more than that
MOST_HYPOTHESES = 16  # all ask for the same ones at the same time
MOST_READ = 512  # messages: those of a second and more of six drones, which they get within the delay of the radio
_UNKNOWN = object()

S = TypeVar("S")
R = TypeVar("R")


class Folds:
    """Where the agents of one flight get their estimators from."""

    def __init__(self) -> None:
        self._shared: dict[str, SharedFold[Any]] = {}

    def __call__(self, name: str, mission: MissionConfig) -> Estimator[Any]:
        """As ``estimator_named``: one for all agents."""
        if name not in self._shared:
            self._shared[name] = SharedFold(estimator_named(name, mission))
        return self._shared[name]


class Descended(NamedTuple, Generic[S]):
    """An estimator's state, and its lineage: the same object for all states that the same observations led to."""

    state: S
    lineage: object


class SharedFold(Generic[S]):
    """An estimator for several agents, which computes nothing twice while it remembers. Errors as in the estimator itself."""

    def __init__(self, estimator: Estimator[S]) -> None:
        self._estimator = estimator
        self.name, self.reads = estimator.name, estimator.reads
        self.grid_s, self.hold_s = estimator.grid_s, estimator.hold_s
        self._lineages, self._steps, self._hypotheses = Results(MOST_LINEAGES), Results(MOST_STEPS), Results(MOST_HYPOTHESES)
        self._initial: dict[int | None, Descended[S]] = {}  # there is one for each start command

    def initial(self, start_ns: int | None) -> Descended[S]:
        """As ``Estimator``; the same object for all agents."""
        if start_ns not in self._initial:
            self._initial[start_ns] = Descended(self._estimator.initial(start_ns), object())
        return self._initial[start_ns]

    def step(self, state: Descended[S], step: GridStep, observations: Sequence[Observation]) -> Descended[S]:
        """As ``Estimator``."""
        lineage = self._lineages.get((state.lineage, step.index, tuple(map(_content, observations))), object)
        after = self._steps.get(lineage, lambda: self._estimator.step(state.state, step, observations))
        return Descended(after, lineage)

    def work(self, state: Descended[S], observations: int) -> int:
        """As ``Estimator``: as if nobody had computed the step yet, so that an agent's slices are those that it has alone."""
        return self._estimator.work(state.state, observations)

    def hypothesis(self, state: Descended[S], step: GridStep) -> Hypothesis | None:
        """As ``Estimator``."""
        return self._hypotheses.get((state.lineage, step), lambda: self._estimator.hypothesis(state.state, step))

    def outlook(self, state: Descended[S], step: GridStep) -> Outlook | None:
        """As ``Estimator``."""
        return self._estimator.outlook(state.state, step)

    def mixture(self, state: Descended[S], stamp_ns: int) -> Any:
        """As ``BayesEstimator``; None of another estimator."""
        mixture = getattr(self._estimator, "mixture", None)
        return None if mixture is None else mixture(state.state, stamp_ns)


class Readings(Shared):
    """Decodes messages, each once for all who receive the same bytes under the same key: no message ever changes."""

    def __init__(self) -> None:
        self._read = lru_cache(MOST_READ)(decode_from)

    def __call__(self, key: str, payload: bytes) -> AnyMessage:
        """As ``decode_from``; raises as it does, each time."""
        return self._read(key, payload)


class SignedRoots:
    """What the proofs of log entries are signatures of, each worked out once for all who receive the same bytes."""

    def __init__(self) -> None:
        self._known = Results(MOST_READ)

    def __call__(self, entry: Entry, payload: bytes) -> Signed | None:
        """As ``signed_root``."""
        return self._known.get(payload, partial(signed_root, entry, payload))


class Results(Shared):
    """The newest results, by what they follow from."""

    def __init__(self, most: int) -> None:
        """``most``: so many are kept."""
        self._most = most
        self._known: dict[object, object] = {}  # the one asked for last at the end

    def get(self, key: object, compute: Callable[[], R]) -> R:
        """A result, from memory or else computed."""
        result = self._known.pop(key, _UNKNOWN)  # keys hold all that was observed in a step: each look at one costs
        if result is _UNKNOWN:
            result = compute()
        self._known[key] = result
        if len(self._known) > self._most:
            del self._known[next(iter(self._known))]
        return cast(R, result)


def _content(observation: Observation) -> tuple[object, ...]:
    """All that an observation says, by value."""
    transform = observation.mission_from_local
    covariance = None if transform.covariance is None else transform.covariance.tobytes()
    frame = transform.yaw_rad, transform.translation, covariance
    common = observation.stamp_ns, observation.position_sigma_m, observation.yaw_sigma_rad, frame
    entry = observation.identity, observation.epoch
    if isinstance(observation, ConeObservation):
        return *entry, *common, observation.readings, observation.energy_kev
    counted = observation.live_time_s, observation.counts.tobytes(), observation.spectrum
    return *entry, *common, observation.middle_ns, observation.position, observation.facing, observation.way_m, *counted
