"""What is computed once for all agents of a flight: the folds of equal logs, the messages that several receive, their signatures.

What one has computed from a state and observations, the others need not again.

An estimator's step is a pure function of a state that never changes and of observations (``agent.fusion.estimator``), and all
agents of a flight begin with the same state. So agents with equal logs walk along one chain of states. Where their logs differ
they part; once the logs are equal again, they replay from where they parted, and one chain remains. Nothing else is shared: every
agent has its own log, frames, observations and replays, and whatever goes wrong there parts it from the others.

In a flight that somebody watches, one drone, by the seed, folds on its own, so that its hypothesis is a check on those of the
others.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Generic, TypeVar, cast

from agent.config.mission import MissionConfig
from agent.fusion.estimator import Estimator, GridStep, Hypothesis, Outlook
from agent.fusion.observation import ConeObservation, Observation
from agent.fusion.registry import Estimators, estimator_named
from protocol.codec import decode_from
from protocol.messages import AnyMessage
from sim.scoring.moment import Shared

MOST_STEPS = 256  # that are remembered: 25 s of a track, which agents replay side by side after a partition; up to 100 MB
MOST_HYPOTHESES = 16  # all ask for the same ones at the same time
MOST_READ = 512  # messages: those of a second and more of six drones, which they get within the delay of the radio

S = TypeVar("S")
R = TypeVar("R")


class Folds:
    """Where the agents of one flight get their estimators from."""

    def __init__(self, drones: int, seed: int, *, checked: bool) -> None:
        """``checked``: one drone folds on its own."""
        self._alone = seed % drones if checked else None
        self._shared: dict[str, SharedFold[Any]] = {}

    def of(self, drone: int) -> Estimators:
        """What makes the estimators of a drone's agent, in the place of ``estimator_named``."""
        return estimator_named if drone == self._alone else self._named

    def _named(self, name: str, mission: MissionConfig) -> Estimator[Any]:
        if name not in self._shared:
            self._shared[name] = SharedFold(estimator_named(name, mission))
        return self._shared[name]


class SharedFold(Generic[S]):
    """An estimator for several agents, which computes nothing twice while it remembers. Errors as in the estimator itself."""

    def __init__(self, estimator: Estimator[S]) -> None:
        self._estimator = estimator
        self.name, self.reads = estimator.name, estimator.reads
        self.grid_s, self.hold_s = estimator.grid_s, estimator.hold_s
        self._steps, self._hypotheses = Results(MOST_STEPS), Results(MOST_HYPOTHESES)
        self._initial: dict[int | None, S] = {}  # there is one for each start command

    def __getattr__(self, name: str) -> Any:
        """Whatever else the estimator offers."""
        return getattr(self._estimator, name)

    def initial(self, start_ns: int | None) -> S:
        """As ``Estimator``; the same object for all agents."""
        if start_ns not in self._initial:
            self._initial[start_ns] = self._estimator.initial(start_ns)
        return self._initial[start_ns]

    def step(self, state: S, step: GridStep, observations: Sequence[Observation]) -> S:
        """As ``Estimator``."""
        key = step.index, tuple(map(_content, observations))
        return self._steps.get(state, key, lambda: self._estimator.step(state, step, observations))

    def work(self, state: S, observations: int) -> int:
        """As ``Estimator``: as if nobody had computed the step yet, so that an agent's slices are those that it has alone."""
        return self._estimator.work(state, observations)

    def hypothesis(self, state: S, step: GridStep) -> Hypothesis | None:
        """As ``Estimator``."""
        return self._hypotheses.get(state, step, lambda: self._estimator.hypothesis(state, step))

    def outlook(self, state: S, step: GridStep) -> Outlook | None:
        """As ``Estimator``."""
        return self._estimator.outlook(state, step)


class Readings:
    """Decodes messages, each once for all who receive the same bytes under the same key: no message ever changes."""

    def __init__(self) -> None:
        self._read = Results(MOST_READ)

    def __call__(self, key: str, payload: bytes) -> AnyMessage:
        """As ``decode_from``; raises as it does, each time."""
        return self._read.get(None, (key, payload), partial(decode_from, key, payload))


class Results(Shared):
    """The newest results, by the state that they were computed from (the object itself) and what went into them."""

    def __init__(self, most: int) -> None:
        """``most``: so many are kept."""
        self._most = most
        self._known: OrderedDict[tuple[int, object], tuple[object, object]] = OrderedDict()

    def get(self, state: object, key: object, compute: Callable[[], R]) -> R:
        """The result for a state, from memory or else computed. A state that is remembered lives, so no other has its ``id``."""
        place = id(state), key
        known = self._known.get(place)
        if known is None:
            known = self._known[place] = state, compute()
            if len(self._known) > self._most:
                self._known.popitem(last=False)
        else:
            self._known.move_to_end(place)
        return cast(R, known[1])


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
