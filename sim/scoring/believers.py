"""Interfaces of the scored objects: agents, and estimators that only listen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from protocol.messages import Stage
from sim.scoring.score import Belief


class ByNuclide(Protocol):
    """What a search for several sources has excluded."""

    @property
    def known_bq(self) -> Mapping[str, float]:
        """By nuclide, the activity from which on further sources are excluded; without nuclides of which none is."""


class Excluding(Protocol):
    """Search result without a hypothesis, or beside one of several sources."""

    @property
    def excluded_bq(self) -> float | None:
        """Activity from which on a source would have been found; None: nothing is excluded yet."""

    @property
    def exclusion(self) -> ByNuclide | None:
        """Of a search for several sources; else None."""


class Believer(Protocol):
    """An estimator's belief at this moment."""

    @property
    def hypothesis(self) -> Belief | None:
        """Its source estimate; None while it has none."""

    @property
    def outlook(self) -> Excluding | None:
        """Its search state without a hypothesis, or beside one of several sources; None else, or where that is unknown."""


class Agent(Believer, Protocol):
    """An agent as seen from outside: its pilot in lockstep, its messages in a live flight."""

    @property
    def alive(self) -> bool:
        """Whether it runs, as far as is known."""

    @property
    def stage(self) -> Stage:
        """Its stage."""

    @property
    def finding(self) -> str:
        """The result of a search that found nothing; else empty."""
