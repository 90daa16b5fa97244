"""Interfaces of the scored objects: agents, and estimators that only listen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from protocol.messages import Stage
from sim.scoring.score import Belief


class ByNuclide(Protocol):
    """What a search for several sources has excluded."""

    @property
    def left(self) -> NDArray[np.bool_]:
        """(C,) cells where more may hide."""

    @property
    def glare(self) -> NDArray[np.bool_]:
        """(C,) cells where the found ones outshine it."""

    @property
    def known_bq(self) -> Mapping[str, float]:
        """By nuclide, the activity from which on further sources are excluded; without nuclides of which none is."""


class Excluding(Protocol):
    """Search result without a hypothesis, or beside one of several sources."""

    @property
    def places(self) -> NDArray[np.float64]:
        """(C, 2) centres of its cells, metres."""

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


def excluded_nuclides_bq(believer: Believer) -> dict[str, float] | None:
    """What a search for several sources excludes, by nuclide; None of another one."""
    outlook = believer.outlook
    return dict(outlook.exclusion.known_bq) if outlook is not None and outlook.exclusion is not None else None


def open_places(believer: Believer) -> dict[str, NDArray[np.float64]]:
    """``left_m`` and ``glare_m`` of the trace."""
    outlook = believer.outlook
    if outlook is None or outlook.exclusion is None:
        return {}
    return {"left_m": outlook.places[outlook.exclusion.left], "glare_m": outlook.places[outlook.exclusion.glare]}
