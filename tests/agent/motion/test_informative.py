"""Waypoints of largest information gain, shared between the drones."""

from __future__ import annotations

import numpy as np
from shapely import Point, Polygon

from radron.agent.motion.informative import Belief, Waypoints

SQUARE = Polygon([(0, 0), (100, 0), (100, 100), (0, 100)])
X, Y = np.meshgrid(np.arange(1.25, 100.0, 2.5), np.arange(1.25, 100.0, 2.5))
PLACES = np.column_stack((X.ravel(), Y.ravel()))
AT_REST = (0.0, 0.0)


def belief(weight: np.ndarray, none: float = 0.2, activity_bq: float = 1e9) -> Belief:
    return Belief(PLACES, (1.0 - none) * weight / weight.sum(), np.full(len(PLACES), activity_bq), none)


def around(x: float, y: float, sigma_m: float = 5.0) -> np.ndarray:
    return np.exp(-((PLACES[:, 0] - x) ** 2 + (PLACES[:, 1] - y) ** 2) / (2.0 * sigma_m**2))


def waypoints(area: Polygon = SQUARE) -> Waypoints:
    return Waypoints(area, height_m=3.0, speed_mps=5.0, acceleration_mps2=3.0)


def away(waypoint: tuple[float, float], x: float, y: float) -> float:
    return float(np.hypot(waypoint[0] - x, waypoint[1] - y))


def test_it_goes_to_where_the_source_probably_is() -> None:
    assert away(waypoints().choose(belief(around(70.0, 60.0)), (50.0, 30.0), AT_REST), 70.0, 60.0) < 10.0


def test_it_leaves_what_is_excluded() -> None:
    east = (PLACES[:, 0] > 60.0).astype(float)
    x, _ = waypoints().choose(belief(east), (40.0, 50.0), AT_REST)
    assert x > 55.0


def test_of_two_equal_places_the_nearer_one_comes_first_and_momentum_counts() -> None:
    both = around(20.0, 50.0) + around(80.0, 50.0)
    assert waypoints().choose(belief(both), (40.0, 50.0), AT_REST)[0] < 40.0
    assert waypoints().choose(belief(both), (50.0, 50.0), (-5.0, 0.0))[0] < 50.0
    assert waypoints().choose(belief(both), (50.0, 50.0), (5.0, 0.0))[0] > 50.0


def test_drones_share_the_places_out() -> None:
    both = belief(around(20.0, 50.0) + around(80.0, 50.0))
    west, east = (48.0, 50.0), (52.0, 50.0)
    assert waypoints().choose(both, west, AT_REST, [east])[0] < 40.0
    assert waypoints().choose(both, east, AT_REST, [west])[0] > 60.0


def test_waypoints_lie_in_the_area_although_a_source_outside_would_teach_more() -> None:
    corner = Polygon([(0, 0), (100, 0), (100, 40), (40, 40), (40, 100), (0, 100)])
    for x, y in ((90.0, 90.0), (60.0, 60.0), (70.0, 20.0)):
        assert corner.contains(Point(waypoints(corner).choose(belief(around(x, y)), (10.0, 10.0), AT_REST)))


def test_a_sliver_of_an_area_has_a_waypoint() -> None:
    sliver = Polygon([(0, 0), (100, 100), (100, 100.1)])
    assert sliver.distance(Point(waypoints(sliver).choose(belief(around(50.0, 50.0)), (0.0, 0.0), AT_REST))) < 0.1


def searched(activity_bq: float, seconds: int) -> list[tuple[float, float]]:
    """The way of a drone that is told of nothing: what counts as a source would have shown is excluded as it goes."""
    planner, log_odds, position, way = waypoints(), np.zeros(len(PLACES)), np.array([50.0, 2.0]), []
    for _ in range(seconds):
        chosen = np.array(planner.choose(belief(np.exp(log_odds), 0.2, activity_bq), tuple(position), AT_REST))
        step = chosen - position
        position = position + step * min(1.0, 5.0 / max(float(np.hypot(*step)), 1e-9))
        signal = 1.07e-6 * activity_bq / (((PLACES - position) ** 2).sum(axis=1) + 9.0)
        log_odds += 1.5 * np.log1p(signal / 1.5) - signal  # a second of background and no more
        way.append((float(position[0]), float(position[1])))
    return way


def test_for_a_weak_source_it_passes_all_of_the_area_near_enough() -> None:
    """179 MBq, 8 hits per second at 5 m: nothing is left further away than 15 m, where it would count half the background."""
    way = np.array(searched(1.79e8, 240))
    gaps = np.hypot(PLACES[:, None, 0] - way[:, 0], PLACES[:, None, 1] - way[:, 1]).min(axis=1)
    assert gaps.max() < 15.0


def test_the_same_is_chosen_again() -> None:
    known = belief(around(30.0, 80.0, 20.0))
    first, second = waypoints(), waypoints()
    second.choose(belief(around(1.0, 1.0)), (3.0, 3.0), AT_REST)  # earlier calls leave no trace
    assert first.choose(known, (10.0, 20.0), (1.0, 2.0), [(50.0, 50.0)]) == second.choose(
        known, (10.0, 20.0), (1.0, 2.0), [(50.0, 50.0)]
    )
