"""Contaminated ground drawn from the seed: patterns, places, activities, and scenarios that are refused."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from shapely import MultiPoint, Polygon

from radron.agent.errors import ConfigError
from radron.sim.scenario import load_scenario, parse_scenario
from radron.sim.world.contamination import Contaminated, contaminated_ground
from radron.sim.world.streams import streams

AREA = Polygon([(0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)])


def ground(seed: int, *parts: dict[str, Any], **changes: Any) -> tuple[Contaminated, ...]:
    document = msgspec.to_builtins(load_scenario("field-nothing")) | changes
    document["contamination"] = [{"level_bqm2": 1e6, **part} for part in parts]
    return contaminated_ground(parse_scenario(document, "here"), streams(seed, 3))


def m2(part: Contaminated) -> float:
    """Area of the part if it had its highest level throughout."""
    return float(part.source.activity_bq.sum()) / 1e6


EXPECTED_M2 = {  # of a size of 24 m
    "patch": 24.0**2,
    "l": (1.0 - 4.0 / 9.0) * 24.0**2,
    "ring": math.pi * (12.0**2 - 6.0**2),
    "gradient": 2.0 * math.pi * 12.0**2,
    "uniform": 100.0**2,
}


@pytest.mark.parametrize("kind", EXPECTED_M2)
def test_activity_of_a_pattern(kind: str) -> None:
    for seed in range(5):
        (part,) = ground(seed, {"patterns": [kind], "size_m": [24.0, 24.0]})
        assert part.kind == kind
        assert m2(part) == pytest.approx(EXPECTED_M2[kind], rel=0.03)  # a Gaussian near the edge of the area is cut 30 m outside


@pytest.mark.parametrize("kind", ["patch", "l", "ring", "spots"])
def test_sharp_patterns_lie_in_the_area(kind: str) -> None:
    places = set()
    for seed in range(10):
        (part,) = ground(seed, {"patterns": [kind], "size_m": [10.0, 20.0]})
        shape = MultiPoint(np.column_stack((part.source.x_m, part.source.y_m)))
        assert AREA.buffer(0.21 * 20.0 + 1.0).contains(shape)  # the corners of a turned square reach beyond a disc of its side
        places.add((round(shape.centroid.x), round(shape.centroid.y)))
    assert len(places) > 5


def test_streets_cross_the_area() -> None:
    (part,) = ground(3, {"patterns": ["streets"], "size_m": [5.0, 5.0]})
    inside = (part.source.x_m > 0.0) & (part.source.x_m < 100.0) & (part.source.y_m > 0.0) & (part.source.y_m < 100.0)
    assert 500.0 < part.source.activity_bq[inside].sum() / 1e6 < 1300.0  # two of 50 to 141 m


def test_plume_falls_downwind_and_blobs_are_two() -> None:
    (plume,) = ground(1, {"patterns": ["plume"], "size_m": [50.0, 50.0]})
    assert 0.02 * 50.0**2 < m2(plume) < 0.2 * 50.0**2
    (blobs,) = ground(1, {"patterns": ["blobs"], "size_m": [10.0, 10.0]})
    (one,) = ground(1, {"patterns": ["gradient"], "size_m": [10.0, 10.0]})
    assert m2(blobs) == pytest.approx(1.6 * m2(one), rel=0.02)


def test_spots_are_told_as_point_sources() -> None:
    counts = set()
    for seed in range(12):
        (part,) = ground(seed, {"patterns": ["spots"], "size_m": [2.0, 2.0], "count": [1, 3]})
        counts.add(len(part.spots))
        assert all(spot.activity_bq == pytest.approx(math.pi * 1e6) for spot in part.spots)
        assert part.source.activity_bq.sum() == pytest.approx(sum(spot.activity_bq for spot in part.spots), rel=0.1)
    assert counts == {1, 2, 3}


def test_the_seed_draws_the_pattern_and_the_parts_do_not_share_it() -> None:
    parts = [{"patterns": ["patch", "l", "ring"]}, {"patterns": ["gradient"], "nuclide": "Co-60"}]
    drawn = [[part.kind for part in ground(seed, *parts)] for seed in range(20)]
    assert {first for first, _ in drawn} == {"patch", "l", "ring"}
    assert drawn == [[part.kind for part in ground(seed, *parts)] for seed in range(20)]
    first, second = ground(1, *parts)
    assert (first.source.nuclide, second.source.nuclide) == ("Cs-137", "Co-60")


@pytest.mark.parametrize(
    ("part", "changes", "says"),
    [
        ({"patterns": ["patch"], "nuclide": "Xx-1"}, {}, r"contamination\[0\].nuclide: unknown nuclide"),
        ({"patterns": ["patch"], "size_m": [5.0, 4.0]}, {}, "size_m: 5 is more than 4"),
        ({"patterns": ["patch"], "size_m": [5.0, 150.0]}, {}, "does not fit into the area"),
        ({"patterns": ["patch"]}, {"ground": None}, r"add \[ground\]"),
        ({"patterns": ["patch"]}, {"walls": [{"from_m": [0.0, 0.0], "to_m": [5.0, 0.0], "height_m": 3.0}]}, "leave out walls"),
        ({"patterns": ["stars"]}, {}, "patterns"),
    ],
)
def test_refused(part: dict[str, Any], changes: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        ground(1, part, **changes)
