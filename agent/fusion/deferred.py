"""An estimator computed elsewhere: its states are links of a chain, and its hypotheses arrive once they have been computed.

An estimator's step is a pure function, so place and time of its computation do not matter. For the engine ``Deferred`` is an
ordinary estimator whose steps cost nothing. A state only refers to its predecessor and the observations since. The hypothesis of
a state is a question. Its process requests the next task, has a ``Folder`` compute it, and returns the answer; until then the
previous answer serves. The time of each answer is an input from outside; its content is not.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import count
from typing import Any, Generic, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.fusion.checkpoints import thin, undo
from radron.agent.fusion.estimator import Estimator, GridStep, Hypothesis, Outlook, contamination_of
from radron.agent.fusion.observation import Observation
from radron.protocol.contamination import Contamination

MAX_TASK_OBSERVATIONS = 100  # in a task: its transfer takes a few milliseconds
_WORK = 2  # of a step here, in units of ``Estimator.work``

S = TypeVar("S")


class Link(Struct, frozen=True, eq=False):
    """A state of an estimator that is computed in another process: it only refers to the state before and the observations since.

    number: unique. origin: number of the first state of its chain, which begins at ``start_ns``. before: the state that precedes
    it, by the observations of ``step``; None for the first state.
    """

    number: int
    origin: int
    start_ns: int | None
    before: Link | None = None
    step: GridStep | None = None
    observations: tuple[Observation, ...] = ()


class Task(Struct, frozen=True, eq=False):
    """A piece of computation for the other process, on the way to an answer (source estimate for one question).

    question: number of the question. start_ns: the mission's start. after: number of the starting state, held by the other
    process; None: the initial state. links: number, step and observations of each state to be computed. at: the interval for
    which the source estimate of the last state is requested; None: another task continues the way.
    """

    question: int
    start_ns: int | None
    after: int | None
    links: tuple[tuple[int, GridStep, tuple[Observation, ...]], ...]
    at: GridStep | None


class Told(Struct, frozen=True, eq=False):
    """The answer of the other process: the source estimate, the posterior of the search, and the map of contaminated ground."""

    hypothesis: Hypothesis | None = None
    outlook: Outlook | None = None
    contamination: Contamination | None = None


class Deferred:
    """Stands in for a slow estimator that is computed in another process, so that the flight loop never waits for it."""

    def __init__(self, estimator: Estimator[Any]) -> None:
        self.estimator = estimator
        self.name, self.reads = estimator.name, estimator.reads
        self.grid_s, self.hold_s = estimator.grid_s, estimator.hold_s
        self._link_numbers, self._question_numbers = count(1), count(1)
        self.digest = ""  # of the log, at the next question
        self.answered_digest = ""  # of the log of the newest answer
        self._questions: dict[int, tuple[Link, GridStep]] = {}  # without an answer, ascending
        self._digests: dict[int, str] = {}  # of the log, by question
        self._asked: tuple[Link, GridStep] | None = None  # the newest question, answered or not
        self._told, self._told_of = Told(), 0  # the newest answer, and the origin of its chain

    def initial(self, start_ns: int | None) -> Link:
        """Return a reference to the estimator's state before the first observation, without computing anything."""
        number = next(self._link_numbers)
        return Link(number, number, start_ns)

    def step(self, state: Link, step: GridStep, observations: Sequence[Observation]) -> Link:
        """Return a reference to the estimator's state after a time step, as ``Estimator.step`` does, without computing anything
        yet.
        """
        return Link(next(self._link_numbers), state.origin, state.start_ns, state, step, tuple(observations))

    def work(self, state: Link, observations: int) -> int:
        """Return the cost of a step, as ``Estimator.work`` does: small, since the work is done elsewhere."""
        return _WORK

    def hypothesis(self, state: Link, step: GridStep) -> Hypothesis | None:
        """Ask for the source estimate of a state, and return the newest known one of its chain.

        Until the question is answered, that is the estimate of an earlier state.
        """
        if (state, step) != self._asked:
            self._asked = state, step
            number = next(self._question_numbers)
            self._questions[number], self._digests[number] = self._asked, self.digest
        return self._newest(state).hypothesis

    def outlook(self, state: Link, step: GridStep) -> Outlook | None:
        """Return the newest known posterior of the search, as far as the other process has answered."""
        return self._newest(state).outlook

    def contamination(self, state: Link, step: GridStep) -> Contamination | None:
        """Return the newest known map of contaminated ground, as far as the other process has answered."""
        return self._newest(state).contamination

    @property
    def waits(self) -> bool:
        """Whether the other process still has to answer a question (request for a source estimate)."""
        return bool(self._questions)

    def task(self, held: Collection[int], question: int | None = None) -> Task | None:
        """Return the next piece of computation for an unanswered question (request for a source estimate); None without a
        question.

        held: numbers of the states that the other process holds. question: None: the newest question. The call changes nothing.
        """
        number = next(reversed(self._questions), None) if question is None else question
        if number is None or number not in self._questions:
            return None
        link, at = self._questions[number]
        missing: list[Link] = []
        while link.before is not None and link.number not in held:
            missing.append(link)
            link = link.before
        links, size = [], 0
        while missing and size < MAX_TASK_OBSERVATIONS:
            next_one = missing.pop()
            assert next_one.step is not None  # as it has one before it
            links.append((next_one.number, next_one.step, next_one.observations))
            size += 1 + len(next_one.observations)
        after = None if link.before is None else link.number
        return Task(number, link.start_ns, after, tuple(links), None if missing else at)

    def next_task(self, held: Collection[int], begun: int | None) -> Task | None:
        """Return the next piece of computation for the other process, which computes one after the other; None if there is none.

        begun: question (request for a source estimate) of the last task, if its answer takes further tasks. It is finished first;
        otherwise a stream of late entries could hold back all answers.
        """
        return (None if begun is None else self.task(held, begun)) or self.task(held)

    def take(self, question: int, told: Told) -> None:
        """Accept the other process's answer to a question; ignore it if the question, or a newer one, has an answer already."""
        if question in self._questions:
            self._told, self._told_of = told, self._questions[question][0].origin
            self.answered_digest = self._digests[question]
            self._questions = {number: asked for number, asked in self._questions.items() if number > question}
            self._digests = {number: self._digests[number] for number in self._questions}

    def _newest(self, state: Link) -> Told:
        return self._told if self._told_of == state.origin else Told()


class Folder(Generic[S]):
    """Computes the estimator's states in the other process, and keeps some of them for later tasks."""

    def __init__(self, estimator: Estimator[S]) -> None:
        self._estimator = estimator
        self._states: dict[int, tuple[int, S]] = {}  # by step, ascending: number and state

    @property
    def held(self) -> frozenset[int]:
        """Numbers of the estimator's states that are kept for later tasks."""
        return frozenset(number for number, _ in self._states.values())

    def fold(self, task: Task) -> Told | None:
        """Compute one task of the estimator; return the answer to its question, or None if another task must follow.

        Raises:
            KeyError: the starting state is not held.
        """
        state = self._back_to(task)
        for number, step, observations in task.links:
            state = self._estimator.step(state, step, observations)
            self._states[step.index] = number, state
            thin(self._states)
        if task.at is None:
            return None
        hypothesis = self._estimator.hypothesis(state, task.at)
        outlook = self._estimator.outlook(state, task.at)
        contamination = contamination_of(self._estimator, state, task.at)
        return Told(None if hypothesis is None else _plain(hypothesis), outlook, contamination)

    def answer(self, deferred: Deferred, question: int) -> Told:
        """Compute all that a question (request for a source estimate) needs, and return the answer.

        Raises:
            ValueError: there is no such question without an answer.
        """
        while True:
            task = deferred.task(self.held, question)
            if task is None:
                raise ValueError(f"the estimator has not asked question {question}")
            told = self.fold(task)
            if told is not None:
                return told

    def _back_to(self, task: Task) -> S:
        """Return the starting state; discard the states after it."""
        if task.after is None:
            self._states.clear()
            return self._estimator.initial(task.start_ns)
        for step, (number, state) in self._states.items():
            if number == task.after:
                undo(self._states, step + 1)
                return state
        raise KeyError(task.after)


def _plain(hypothesis: Hypothesis) -> Hypothesis:
    """Return the hypothesis with computed sights, so that it can be transferred without their inputs."""
    others = tuple(_plain(other) for other in hypothesis.others)
    return replace(hypothesis, sights=dict(hypothesis.sights), others=others)
