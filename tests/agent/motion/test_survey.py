"""The survey covers any simple polygon in segments of equal area, the same on every drone."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, MultiPolygon, Polygon
from shapely.ops import substring

from radron.agent.motion.survey import divide, survey_paths, sweep, uncovered

SQUARE = Polygon([(0, 0), (100, 0), (100, 100), (0, 100)])
AREAS = {
    "square": SQUARE,
    "L": Polygon([(0, 0), (100, 0), (100, 30), (40, 30), (40, 100), (0, 100)]),
    "U": Polygon([(0, 0), (100, 0), (100, 100), (70, 100), (70, 25), (30, 25), (30, 100), (0, 100)]),
    "comb": Polygon([(0, 0), (100, 0), (95, 80), (80, 20), (60, 90), (50, 15), (30, 85), (20, 20), (5, 80)]),
    "spiral": Polygon(
        np.array(
            [
                (0, 0),
                (9, 0),
                (9, 9),
                (1, 9),
                (1, 3),
                (6, 3),
                (6, 6),
                (4, 6),
                (4, 5),
                (5, 5),
                (5, 4),
                (2, 4),
                (2, 8),
                (8, 8),
                (8, 1),
                (0, 1),
            ]
        )
        * 10.0
    ),
    "sliver": Polygon([(0, 0), (100, 1), (100, 2), (50, 1.2)]),
}


@st.composite
def polygons(draw: st.DrawFn) -> Polygon:
    """Simple polygons, most of them not convex: corners at any distance around a middle, turned and shifted."""
    count = draw(st.integers(3, 12))
    radii = draw(st.lists(st.floats(8.0, 80.0), min_size=count, max_size=count))
    gaps = draw(st.lists(st.floats(0.2, 1.0), min_size=count, max_size=count))
    angles = draw(st.floats(0.0, 6.0)) + 2.0 * math.pi * np.cumsum(gaps) / sum(gaps)
    corners = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1) + draw(st.integers(-500, 500))
    polygon = Polygon(corners)
    return polygon if polygon.is_valid else polygon.convex_hull


@st.composite
def points_in(draw: st.DrawFn, area: Polygon) -> tuple[float, float]:
    left, bottom, right, top = area.bounds
    return draw(st.floats(left, right)), draw(st.floats(bottom, top))


def drones(count: int) -> list[str]:
    return [f"d{number}" for number in range(count)]


def assert_covered(segment: Polygon | MultiPolygon, path: np.ndarray, spacing_m: float) -> None:
    reach = LineString(path) if len(path) > 1 else shapely.Point(path[0])
    missed = segment.difference(reach.buffer(spacing_m / 2.0 * 1.0005 + 1e-3, quad_segs=64))
    assert missed.area < 1e-6 * segment.area + 1e-6


def assert_inside(area: Polygon, path: np.ndarray) -> None:
    tolerant = area.buffer(1e-3, join_style="mitre")
    assert shapely.covers(tolerant, LineString(path) if len(path) > 1 else shapely.Point(path[0]))


def assert_fair(area: Polygon | MultiPolygon, segments: dict[str, Polygon | MultiPolygon]) -> None:
    parts = list(segments.values())
    assert sum(part.area for part in parts) == pytest.approx(area.area, rel=1e-6)
    assert shapely.union_all(parts).symmetric_difference(area).area < 1e-6 * area.area
    for part in parts:
        assert part.area == pytest.approx(area.area / len(parts), rel=1e-4)


@settings(max_examples=60)
@given(st.data(), polygons(), st.integers(1, 7), st.floats(6.0, 25.0))
def test_any_polygon_is_shared_fairly_and_covered(data: st.DataObject, area: Polygon, count: int, spacing_m: float) -> None:
    starts = {drone: data.draw(points_in(area)) for drone in drones(count)}
    segments = divide(area, drones(count), starts)
    paths = survey_paths(area, drones(count), [], spacing_m, starts)
    assert list(segments) == list(paths) == drones(count)
    assert_fair(area, segments)
    for drone, path in paths.items():
        assert_inside(area, path)
        assert_covered(segments[drone], path, spacing_m)


@pytest.mark.parametrize("name", AREAS)
@pytest.mark.parametrize("count", [1, 3, 4])
def test_awkward_areas(name: str, count: int) -> None:
    area = AREAS[name]
    segments = divide(area, drones(count))
    assert_fair(area, segments)
    for drone, path in survey_paths(area, drones(count), [], 10.0).items():
        assert_inside(area, path)
        assert_covered(segments[drone], path, 10.0)


@settings(max_examples=30)
@given(st.data(), polygons(), st.integers(2, 5), st.floats(0.0, 1.0))
def test_survivors_cover_what_a_lost_drone_left(data: st.DataObject, area: Polygon, count: int, progress: float) -> None:
    spacing_m = 10.0
    first = survey_paths(area, drones(count), [], spacing_m)
    lost = data.draw(st.sampled_from(drones(count)))
    flown = {drone: along(path, progress) for drone, path in first.items()}
    coverage = [(path, spacing_m) for path in flown.values()]
    rest = uncovered(area, coverage)
    alive = [drone for drone in drones(count) if drone != lost]
    starts = {drone: tuple(flown[drone][-1]) for drone in alive}
    second = survey_paths(area, alive, coverage, spacing_m, starts)
    assert sorted(second) == alive
    swept = [LineString(path).buffer(spacing_m / 2.0 * 1.0005 + 1e-3, quad_segs=64) for path in second.values() if len(path) > 1]
    assert rest.difference(shapely.union_all(swept)).area < 1e-6 * area.area
    for path in second.values():
        if len(path):
            assert_inside(area, path)


def along(path: np.ndarray, progress: float) -> np.ndarray:
    line = LineString(path) if len(path) > 1 else LineString([path[0], path[0]])
    part = substring(line, 0.0, progress, normalized=True)
    return shapely.get_coordinates(part)


def test_order_and_doubles_in_the_list_of_drones_do_not_matter() -> None:
    coverage = [(np.array([(5.0, 0.0), (5.0, 100.0)]), 10.0), (np.array([(60.0, 20.0), (70.0, 90.0)]), 12.0)]
    one = survey_paths(AREAS["U"], ["a", "b", "c"], coverage, 10.0, {"a": (0.0, 0.0), "b": (50.0, 5.0), "c": (90.0, 90.0)})
    two = survey_paths(AREAS["U"], ["c", "a", "b", "a"], coverage, 10.0, {"c": (90.0, 90.0), "b": (50.0, 5.0), "a": (0.0, 0.0)})
    assert list(one) == list(two)
    assert all(np.array_equal(one[drone], two[drone]) for drone in one)


def test_rounding_in_the_area_does_not_turn_the_cut() -> None:
    tilted = shapely.transform(SQUARE, lambda points: points + 1e-9 * np.array([[0, 1], [1, 0], [0, 0], [1, 1], [0, 1]]))
    here, there = divide(SQUARE, ["a", "b"]), divide(tilted, ["a", "b"])
    assert here["a"].symmetric_difference(there["a"]).area < 1e-3


def test_each_drone_gets_the_side_on_which_it_is() -> None:
    starts = {"a": (95.0, 50.0), "b": (50.0, 50.0), "c": (5.0, 50.0)}
    paths = survey_paths(Polygon([(0, 0), (150, 0), (150, 60), (0, 60)]), ["a", "b", "c"], [], 10.0, starts)
    middles = {drone: path[:, 0].mean() for drone, path in paths.items()}
    assert middles["c"] < middles["b"] < middles["a"]


def test_only_the_uncovered_part_is_flown_again() -> None:
    first = survey_paths(SQUARE, ["a", "b", "c"], [], 10.0)
    coverage = [(first["a"], 10.0), (first["c"], 10.0)]
    again = survey_paths(SQUARE, ["a", "c"], coverage, 10.0)
    lengths = [float(np.hypot(*np.diff(path, axis=0).T).sum()) for path in again.values()]
    missing = divide(SQUARE, ["a", "b", "c"])["b"]  # 66.7 m x 50 m
    assert lengths == pytest.approx([4 * 50.0 + 25.0] * 2, rel=0.01)  # four lanes in each half, and from lane to lane
    for path in again.values():
        assert_inside(missing.buffer(1.0), path)


def test_coverage_counts_half_the_swath_and_slivers_are_left_out() -> None:
    left = np.array([(20.0, -10.0), (20.0, 110.0)])
    assert uncovered(SQUARE, [(left, 40.0)]).area == pytest.approx(6000.0)
    nearly = [(np.array([(x, -10.0), (x, 110.0)]), 9.5) for x in np.arange(5.0, 100.0, 10.0)]
    assert uncovered(SQUARE, nearly).is_empty
    assert uncovered(SQUARE, nearly[:5] + nearly[6:]).area == pytest.approx(10.5 * 100.0)


def test_nothing_left_gives_empty_paths() -> None:
    everything = [(np.array([(50.0, 50.0)]), 400.0)]
    paths = survey_paths(SQUARE, ["a", "b"], everything, 10.0, {"a": (0.0, 0.0)})
    assert {drone: path.shape for drone, path in paths.items()} == {"a": (0, 2), "b": (0, 2)}


def test_a_sweep_begins_near_its_drone_and_runs_along_the_longer_side() -> None:
    path = sweep(Polygon([(0, 0), (100, 0), (100, 30), (0, 30)]), 10.0, start=(98.0, 1.0))
    assert path.tolist() == [[100, 5], [0, 5], [0, 15], [100, 15], [100, 25], [0, 25]]


@pytest.mark.parametrize(
    ("name", "count", "length_m"), [("square", 1, 1090.0), ("square", 2, 1080.0), ("L", 1, 670.0), ("U", 1, 900.0)]
)
def test_lanes_are_flown_in_turn_without_detours(name: str, count: int, length_m: float) -> None:
    """Lanes and links, counted by hand; the U: foot 300 m, arms 420 m, from lane to lane 150 m, over to the other arm 30 m."""
    paths = survey_paths(AREAS[name], drones(count), [], 10.0)
    assert sum(float(np.hypot(*np.diff(path, axis=0).T).sum()) for path in paths.values()) == pytest.approx(length_m, rel=0.01)


def test_a_hovering_drone_covers_a_disc() -> None:
    hover = np.array([(50.0, 50.0), (50.0, 50.0)])
    assert uncovered(SQUARE, [(hover, 20.0)]).area == pytest.approx(10_000.0 - 100.0 * math.pi, abs=10.0)


def test_a_cut_that_begins_on_a_side_of_the_area() -> None:
    """All corners but one on one line, as numbers go: the intersection with the half-plane to that line is empty."""
    corners = [
        (44.92825291975078, -19.00497830801329),
        (-23.708364550007467, 4.919341740045567),
        (-12.083463293746114, -11.195331977231454),
    ]
    assert_fair(Polygon(corners), divide(Polygon(corners), drones(2)))
