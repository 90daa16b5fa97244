"""All true sources of a simulated flight: the configured sources on their paths, and sources drawn from the seed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from msgspec import Struct
from shapely import Polygon

from radron.sim.geometry import Vector3
from radron.sim.scenario import Scenario
from radron.sim.world.source import Path, Place, anywhere, source_path
from radron.sim.world.sourcetruth import RandomSourcesTruth
from radron.sim.world.streams import Streams
from radron.sim.world.terrain import Terrain

_TRIES = 1000  # for a place beside the others, before all are drawn anew


class Source(Struct, frozen=True):
    """A true source at one time. place_m: position in the mission frame (x, y, z)."""

    nuclide: str
    activity_bq: float
    place_m: Vector3


def place_of(sources: Sequence[Source]) -> Place | None:
    """Return the horizontal position of the first of these sources; None without sources."""
    return sources[0].place_m[:2] if sources else None


@dataclass(frozen=True, slots=True)
class _Moving:
    nuclide: str
    activity_bq: float
    height_m: float
    path: Path


class Sources:
    """All true sources of a scenario with their motion; ``scenario.source`` is the first. Empty without sources."""

    def __init__(self, scenario: Scenario, duration_s: float, random: Streams) -> None:
        """``duration_s``: longest duration of the sources' motion."""
        area = Polygon(scenario.mission.area.polygon_m)
        configured = [] if scenario.source is None else [(scenario.source, random.source)]
        configured += [(source, random.sources) for source in scenario.sources]
        self._terrain = Terrain(scenario.terrain)
        self._sources = [
            _Moving(truth.nuclide, truth.activity_bq, truth.height_m, source_path(truth, area, duration_s, rng))
            for truth, rng in configured
        ]
        if scenario.random_sources is not None:
            self._sources += _drawn(scenario.random_sources, area, random.sources)

    @property
    def nuclides(self) -> tuple[str, ...]:
        """The nuclides of all sources, each once."""
        return tuple(dict.fromkeys(source.nuclide for source in self._sources))

    def at(self, time_s: float) -> tuple[Source, ...]:
        """Return all sources at a time, in seconds since the beginning."""
        return tuple(self._at(source, time_s) for source in self._sources)

    def _at(self, source: _Moving, time_s: float) -> Source:
        x, y = source.path(time_s)
        return Source(source.nuclide, source.activity_bq, (x, y, self._terrain.height_m(x, y) + source.height_m))


def _drawn(truth: RandomSourcesTruth, area: Polygon, rng: np.random.Generator) -> list[_Moving]:
    """Draw sources at rest: their number once, the sources until each has found a place beside the previous ones."""
    count = int(rng.integers(truth.least, truth.most + 1))
    while True:
        sources: list[tuple[_Moving, Place]] = []
        for _ in range(_TRIES * count):
            if len(sources) == count:
                break
            one = _one(truth, area, rng)
            if all(_may_be_beside(one, other, truth) for other in sources):
                sources.append(one)
        if len(sources) == count:
            return [source for source, _ in sources]


def _one(truth: RandomSourcesTruth, area: Polygon, rng: np.random.Generator) -> tuple[_Moving, Place]:
    nuclide = truth.nuclides[int(rng.integers(len(truth.nuclides)))]
    least, most = truth.activity_bq
    activity_bq = math.exp(rng.uniform(math.log(least), math.log(most)))
    height_m = float(rng.uniform(*truth.height_m))
    place = anywhere(area, rng)
    return _Moving(nuclide, activity_bq, height_m, lambda _: place), place


def _may_be_beside(one: tuple[_Moving, Place], other: tuple[_Moving, Place], truth: RandomSourcesTruth) -> bool:
    (first, here), (second, there) = one, other
    apart_m = math.dist(here, there)
    contrast = max(first.activity_bq, second.activity_bq) / min(first.activity_bq, second.activity_bq)
    alike_apart = first.nuclide != second.nuclide or apart_m >= truth.apart_m
    return alike_apart and (contrast <= truth.contrast or apart_m >= truth.contrast_apart_m)
