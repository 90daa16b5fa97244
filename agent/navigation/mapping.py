"""Survey of contaminated ground for a map: lanes over the area, then low lanes over the blocks of highest activity."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Union

import numpy as np
import shapely
from msgspec import Struct
from numpy.typing import NDArray
from shapely import Polygon

from radron.agent.config.mission import MissionConfig
from radron.agent.config.survey import SurveyConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.geometry import Point2
from radron.agent.motion.survey import Area
from radron.agent.navigation.surveying import Search
from radron.protocol.codes import Code
from radron.protocol.contamination import Contamination
from radron.protocol.entries import Coverage
from radron.protocol.texts import CodedText

_HOT_SHARE = 0.5  # share of the highest block's activity above which a block is hot, and gets low lanes


class Block(Struct, frozen=True):
    """Square block of a map of contaminated ground, mission frame.

    corner_m: its south-west corner. median, low, high: activity per area, Bq/m2: median, 5 % and 95 % quantile.
    """

    corner_m: Point2
    side_m: float
    median: float
    low: float
    high: float


Lanes = Union[Search, "MapSurvey"]  # how a survey flies lanes


def blocks_of(found: Contamination) -> list[Block]:
    """Return the blocks of a map of contaminated ground, as published, with their activities in Bq/m2."""
    west, south = found.corner_m
    blocks = []
    for place, block in enumerate(found.blocks):
        up, along = divmod(place, found.across)
        corner_m = (west + along * found.block_m, south + up * found.block_m)
        levels = (found.unit_bqm2 * level for level in (block.median, block.low, block.high))
        blocks.append(Block(corner_m, found.block_m, *levels))
    return blocks


def hot_blocks(blocks: Sequence[Block]) -> list[Block]:
    """Return the blocks with more than half of the highest block's activity, without those that may be clean."""
    highest = max((block.median for block in blocks), default=0.0)
    return [block for block in blocks if block.low > 0.0 and block.median > _HOT_SHARE * highest]


def uncertainty(blocks: Sequence[Block]) -> float | None:
    """Return the median relative uncertainty of the hot blocks: half of the 90 % interval over the median activity. None without
    a hot block.
    """
    hot = [0.5 * (block.high - block.low) / block.median for block in hot_blocks(blocks)]
    return float(np.median(hot)) if hot else None


class MapSurvey:
    """Survey for a map: lanes over the whole area at the height of the survey, then low lanes over the hot blocks.

    Each of the two is a ``Search``, which divides the uncovered area among the drones that take part. Coverage by one does not
    count for the other, because their lanes differ in width. The hot blocks are chosen when the first lanes are complete. Drones
    with the same log choose the same ones; if logs differ, some lanes are flown twice.
    """

    def __init__(self, mission: MissionConfig, drone: str, frames: FrameGraph, blocks: Callable[[], Sequence[Block]]) -> None:
        """``blocks``: returns the blocks of the present map; empty before there is a map."""
        survey = mission.survey
        self._area = Polygon(mission.area.polygon_m)
        self._blocks = blocks
        self._wide = Search(mission, drone, frames)
        self._low: Search | None = None
        if survey.low_height_m is not None:
            spacing_m = survey.lane_spacing_m * survey.low_height_m / survey.height_m
            self._low = Search(mission, drone, frames, spacing_m, survey.low_height_m)
        self._is_low = False

    @property
    def _now(self) -> Search:
        return self._low if self._low is not None and self._is_low else self._wide

    @property
    def is_complete(self) -> bool:
        """Whether all lanes have been flown: also the low ones, if the mission has them, and there are hot blocks."""
        return self._now.is_complete and (self._is_low or self._low is None or not hot_blocks(self._blocks()))

    @property
    def swath_m(self) -> float:
        """Width (m) of the strip that a flight along a present lane covers."""
        return self._now.swath_m

    @property
    def height_m(self) -> float:
        """Height (m) of the present lanes above the ground."""
        return self._now.height_m

    def begin(self, started_ns: int) -> None:
        """Begin a mission at this stamp; only later coverage counts."""
        self._is_low = False
        for search in self._both:
            search.begin(started_ns)

    def take(self, entry: Coverage) -> None:
        """Add a coverage entry of the log; the order of the entries does not matter."""
        for search in self._both:
            search.take(entry)

    def recount(self, drone: str, entries: Iterable[Coverage]) -> None:
        """Replace all coverage of a drone by these entries."""
        counted = list(entries)
        for search in self._both:
            search.recount(drone, counted)

    def divide_anew(self) -> None:
        """Divide the uncovered area anew, as soon as all known coverage is counted."""
        self._now.divide_anew()

    def reference(
        self, active: Sequence[str], position: Point2, steps: int, step_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the positions and velocities, (steps + 1, 2) each, to follow from here; arguments as of ``Search.reference``."""
        if self._low is not None and not self._is_low and self._wide.is_complete:
            self._go_low(self._low)
        return self._now.reference(active, position, steps, step_s)

    def _go_low(self, low: Search) -> None:
        hot = hot_blocks(self._blocks())
        region: Area = shapely.union_all([_square(block) for block in hot]).intersection(self._area)
        if not region.is_empty:
            low.restrict(region)
            self._is_low = True

    @property
    def _both(self) -> tuple[Search, ...]:
        return (self._wide,) if self._low is None else (self._wide, self._low)


def _square(block: Block) -> Polygon:
    (x, y), side = block.corner_m, block.side_m
    return Polygon([(x, y), (x + side, y), (x + side, y + side), (x, y + side)])


def map_conclusion(
    survey: SurveyConfig, searched_s: float, is_complete: bool, blocks: Callable[[], Sequence[Block]]
) -> CodedText | None:
    """Return the result of a survey for a map, as a text for the operator; None while the survey continues.

    The survey ends after its duration (``survey.duration_s``), or once the map is as certain as the mission asks for
    (``survey.block_uncertainty``). If the mission gives neither, it ends when all lanes have been flown.
    """
    wanted, duration_s = survey.block_uncertainty, survey.duration_s
    if wanted is None and duration_s is None:
        return CodedText(Code.MAPPED, f"mapped in {searched_s:.0f} s; all lanes flown") if is_complete else None
    is_over = duration_s is not None and searched_s >= duration_s
    if not is_over and (wanted is None or not is_complete):
        return None
    reached = uncertainty(blocks())
    if is_complete and wanted is not None and reached is not None and reached <= wanted:
        return CodedText(Code.MAPPED, f"mapped in {searched_s:.0f} s; highest blocks known to {100.0 * reached:.0f} %")
    known = "" if reached is None else f"; highest blocks known to {100.0 * reached:.0f} %"
    return CodedText(Code.MAPPED, f"mapped for {searched_s:.0f} s{known}") if is_over else None
