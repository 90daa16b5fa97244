"""Interfaces of the scored objects: agents, and listening estimators."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radron.protocol.messages import Stage
from radron.sim.scoring.score import Belief


class ByNuclide(Protocol):
    """Exclusion limits of a search for several sources."""

    @property
    def left(self) -> NDArray[np.bool_]:
        """(C,) cells where more sources may be."""

    @property
    def glare(self) -> NDArray[np.bool_]:
        """(C,) cells where found sources outshine others."""

    @property
    def known_bq(self) -> Mapping[str, float]:
        """By nuclide, the activity above which further sources are excluded; without nuclides that have no limit."""


class Excluding(Protocol):
    """Search result without a hypothesis, or beside an estimate of several sources."""

    @property
    def places(self) -> NDArray[np.float64]:
        """(C, 2) centres of its cells, metres."""

    @property
    def excluded_bq(self) -> float | None:
        """Exclusion limit: a source of this activity would have been found; None: no limit yet."""

    @property
    def exclusion(self) -> ByNuclide | None:
        """Exclusion of a search for several sources; else None."""


class Believer(Protocol):
    """An estimator's belief at this moment."""

    @property
    def hypothesis(self) -> Belief | None:
        """Its source estimate; None without one."""

    @property
    def outlook(self) -> Excluding | None:
        """Its search state without a hypothesis, or beside an estimate of several sources; None else, or if unknown."""


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
        """The result of a search without a find; else empty."""


def excluded_nuclides_bq(believer: Believer) -> dict[str, float] | None:
    """Return the exclusion limits of a search for several sources, Bq by nuclide; None of another search."""
    outlook = believer.outlook
    return dict(outlook.exclusion.known_bq) if outlook is not None and outlook.exclusion is not None else None


def open_places(believer: Believer) -> dict[str, NDArray[np.float64]]:
    """Return ``left_m`` and ``glare_m`` of the trace."""
    outlook = believer.outlook
    if outlook is None or outlook.exclusion is None:
        return {}
    return {"left_m": outlook.places[outlook.exclusion.left], "glare_m": outlook.places[outlook.exclusion.glare]}
