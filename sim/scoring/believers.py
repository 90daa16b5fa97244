"""Interfaces of the objects that are scored: agents, and estimators without influence on the flight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radron.protocol.messages import Stage
from radron.protocol.texts import CodedText
from radron.sim.scoring.score import Belief


class ByNuclide(Protocol):
    """Exclusion limits of a search for several sources: where further sources may still be, and how strong they may be."""

    @property
    def left(self) -> NDArray[np.bool_]:
        """(C,) marks the cells of the area where further sources may be."""

    @property
    def glare(self) -> NDArray[np.bool_]:
        """(C,) marks the cells of the area where found sources outshine further sources."""

    @property
    def known_bq(self) -> Mapping[str, float]:
        """By nuclide, the activity (Bq) above which further sources are excluded; nuclides without a limit are left out."""


class Excluding(Protocol):
    """State of a search that has found no source yet, or that continues beside found sources."""

    @property
    def places(self) -> NDArray[np.float64]:
        """(C, 2) centres of the cells of the searched area, metres."""

    @property
    def excluded_bq(self) -> float | None:
        """Exclusion limit: a source of this activity (Bq) would have been found; None: no limit yet."""

    @property
    def exclusion(self) -> ByNuclide | None:
        """Exclusion limits of a search for several sources; None for other searches."""


class Believer(Protocol):
    """An estimator with its present result, as the scores see it."""

    @property
    def hypothesis(self) -> Belief | None:
        """The present source estimate; None without one."""

    @property
    def outlook(self) -> Excluding | None:
        """State of the search while no source is found, or beside an estimate of several sources; None otherwise."""


class Agent(Believer, Protocol):
    """An agent (a drone's onboard software) as the scores see it from outside.

    In a simulation in one process (lockstep) its own state is read, in a live flight its messages.
    """

    @property
    def alive(self) -> bool:
        """Whether the agent runs, as far as is known."""

    @property
    def stage(self) -> Stage:
        """Stage of the agent's mission."""

    @property
    def finding(self) -> CodedText | None:
        """Result of a search that has found nothing; None otherwise."""


def excluded_nuclides_bq(believer: Believer) -> dict[str, float] | None:
    """Return the exclusion limits of a search for several sources, in Bq by nuclide; None for another search."""
    outlook = believer.outlook
    return dict(outlook.exclusion.known_bq) if outlook is not None and outlook.exclusion is not None else None


def open_places(believer: Believer) -> dict[str, NDArray[np.float64]]:
    """Return the places where further sources may be (``left_m``) or are outshone (``glare_m``), as in the trace of a flight."""
    outlook = believer.outlook
    if outlook is None or outlook.exclusion is None:
        return {}
    return {"left_m": outlook.places[outlook.exclusion.left], "glare_m": outlook.places[outlook.exclusion.glare]}
