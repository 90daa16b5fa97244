"""Selection of events by gamma line: the windows around the lines of the nuclides searched for.

The total energy of a coincidence decides the line of its cone. For a named nuclide the window is the mission's (the paper's 20
%). For an unknown nuclide the lines of all candidates are searched for, and such windows would overlap and take in the whole
spectrum. Each window then reaches as far as the resolution puts a line's events, and the nearest line counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from radron.agent.config.mission import AUTO, DetectionConfig
from radron.agent.detector.cones import Line
from radron.agent.detector.lines import CANDIDATES, lines_of
from radron.agent.detector.sensor import energy_variance

_REACH = 3.0  # sigmas of the resolution
_SAME_LINE = 0.03  # relative distance within which a line of another nuclide makes cones of the same energy


def candidates_of(nuclide: str | tuple[str, ...]) -> tuple[str, ...]:
    """Return the nuclides that a mission's ``nuclide`` names; for ``auto`` all known ones. Raises ConfigError for an unknown
    name.
    """
    if nuclide == AUTO:
        return CANDIDATES
    named = nuclide if isinstance(nuclide, tuple) else (nuclide,)
    for name in named:
        lines_of(name)
    return named


@dataclass(frozen=True, slots=True)
class Window:
    """The range of event energies that belongs to one gamma line.

    half_kev: an event belongs to the line if its energy is within this distance of it. unsure_kev: the source of a cone has a
    line within this distance of the energy.
    """

    line: Line
    half_kev: float
    unsure_kev: float

    @property
    def energy_kev(self) -> float:
        """Energy of the gamma line (keV)."""
        return self.line.energy_kev


class Windows:
    """The energy ranges around all gamma lines of the nuclides searched for, in ascending order."""

    def __init__(self, nuclides: Iterable[str], config: DetectionConfig) -> None:
        """Set up the ranges of these nuclides. Raises ConfigError for an unknown nuclide."""
        names = tuple(dict.fromkeys(nuclides))
        lines = sorted({energy for name in names for energy in lines_of(name)})
        self.each = tuple((_named if len(names) == 1 else _one_of_many)(energy, config) for energy in lines)

    def line_of(self, energy_kev: float) -> Line | None:
        """Return the nearest gamma line whose range contains this event energy; None if there is none."""
        best = None
        least = math.inf
        for window in self.each:
            difference = abs(energy_kev - window.line.energy_kev)
            if difference <= window.half_kev and difference < least:
                best, least = window.line, difference
        return best

    def reach_kev(self, place: int) -> tuple[float, float]:
        """Return least and greatest energy (keV) of the events that count for one line; overlapping ranges are divided between
        their lines.

        place: index of the line in ``each``.
        """
        own = self.each[place]
        low, high = own.energy_kev - own.half_kev, own.energy_kev + own.half_kev
        if place > 0:
            below = self.each[place - 1]
            low = max(low, min((below.energy_kev + own.energy_kev) / 2.0, below.energy_kev + below.half_kev))
        if place + 1 < len(self.each):
            above = self.each[place + 1]
            high = min(high, max((own.energy_kev + above.energy_kev) / 2.0, above.energy_kev - above.half_kev))
        return low, high


def _named(energy_kev: float, config: DetectionConfig) -> Window:
    line = Line.of(energy_kev, config.maximum_electron_kev, config.minimum_photon_kev)
    return Window(line, config.energy_window * energy_kev, _SAME_LINE * energy_kev)


def _one_of_many(energy_kev: float, config: DetectionConfig) -> Window:
    """The mission's limits of electron and photon belong to one line, so here each line has the kinematic limits."""
    half_kev = min(_REACH * math.sqrt(energy_variance(energy_kev)), config.energy_window * energy_kev)
    return Window(Line.of(energy_kev), half_kev, half_kev)
