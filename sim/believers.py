"""What is to be seen of those that believe something: of agents, and of estimators that only listen."""

from __future__ import annotations

from typing import Protocol

from protocol.messages import Stage
from sim.score import Belief


class Excluding(Protocol):
    """What is known without a hypothesis."""

    @property
    def excluded_bq(self) -> float | None:
        """A source of this activity or more would have been found; None: nothing is excluded yet."""


class Believer(Protocol):
    """An estimator's belief at this moment."""

    @property
    def hypothesis(self) -> Belief | None:
        """Where it believes the source to be; None while it has no idea."""

    @property
    def outlook(self) -> Excluding | None:
        """What is known while there is no hypothesis; None where there is one, or nothing is known of that."""


class Agent(Believer, Protocol):
    """What is to be seen of an agent: its pilot in lockstep, what it publishes in a live flight."""

    @property
    def stage(self) -> Stage:
        """What it is doing."""

    @property
    def finding(self) -> str:
        """What its search has ended with, where it has found nothing; else empty."""
