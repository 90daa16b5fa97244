"""Numbers of the estimated sources, used in their names: a source keeps its number at any position in the estimate's list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import dist

from msgspec.structs import replace

from radron.station.picture.frame import SourceFrame

KNOWN_MS = 15_000  # a freed number is not reused for this time: receivers still show its last source
SAME_SOURCE_M, SAME_SOURCE_SIGMAS = 5.0, 3.0  # of the same source in two estimates, at most: the greater of both counts


@dataclass(frozen=True, slots=True)
class _Known:
    at_ms: int
    source: SourceFrame


def numbered(source: SourceFrame, between: str = " ") -> str:
    """Return the number of a source as a suffix for its name, such as " 2"; empty for the first source."""
    return f"{between}{source.number}" if source.number > 1 else ""


class Numbering:
    """Gives each estimated source a number that stays constant while estimates move it or change the order of the list.

    Numbers begin at 1. A single source keeps its number at any distance.
    """

    def __init__(self) -> None:
        self._known: dict[int, _Known] = {}

    def numbered(self, sources: Sequence[SourceFrame], at_ms: int) -> tuple[SourceFrame, ...]:
        """Return the sources of an estimate with their numbers, in unchanged order. ``at_ms``: time of the estimate."""
        self._known = {number: one for number, one in self._known.items() if 0 <= at_ms - one.at_ms < KNOWN_MS}
        numbers = dict(self._recognised(sources))
        for place in range(len(sources)):
            numbers.setdefault(place, next(n for n in range(1, 1000) if n not in self._known and n not in numbers.values()))
        found = tuple(replace(source, number=numbers[place]) for place, source in enumerate(sources))
        self._known |= {source.number: _Known(at_ms, source) for source in found}
        return found

    def _recognised(self, sources: Sequence[SourceFrame]) -> list[tuple[int, int]]:
        """Return indices of recognised sources with their former numbers: same nuclide first, then the nearest first."""
        if len(sources) == len(self._known) == 1:
            return [(0, number) for number in self._known]
        pairs = sorted(
            (one.source.nuclide != source.nuclide, dist(one.source.place, source.place), place, number)
            for place, source in enumerate(sources)
            for number, one in self._known.items()
            if dist(one.source.place, source.place) <= max(SAME_SOURCE_M, SAME_SOURCE_SIGMAS * (one.source.rms_m + source.rms_m))
        )
        places: dict[int, int] = {}
        for _, _, place, number in pairs:
            if place not in places and number not in places.values():
                places[place] = number
        return list(places.items())
