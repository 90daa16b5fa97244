"""Sightings between drones: directions in the body's axes, ranges, noise, false reports, and limits of visibility."""

import numpy as np
import pytest

from radron.sim.vehicle.multirotor import attitude
from radron.sim.world.sightings import Sightings, SightingTruth
from radron.sim.world.walls import Walls, WallTruth

LEVEL = (1.0, 0.0, 0.0, 0.0)
SURE = {"missed": 0.0, "false_share": 0.0, "visible_s": None, "delay_s": 0.0}
NAMES = ("d1", "d2", "d3")


def seen(places, attitudes=None, walls=None, looks=1, **truth):
    """All that is reported: (observer, SeenDrone)."""
    sensors = Sightings(SightingTruth(**{**SURE, **truth}), NAMES[: len(places)], walls, 0.05, np.random.default_rng(3))
    found = []
    for look in range(looks):
        sensors.look(look, np.array(places), attitudes or [LEVEL] * len(places))
        found += [(observer, one) for observer, group in sensors.take(look) for one in group]
    return found


def test_a_direction_is_in_the_axes_of_a_body_that_turns_and_leans():
    """d1 looks north and leans forward, as it speeds up northwards: d2, straight east and level, is to its right and level."""
    leaning = attitude(np.pi / 2.0, 0.0, 3.0, 0.0)
    exact = {"direction_sigma_deg": 1e-6, "range_sigma_m": 1e-6}
    reports = dict(seen([[0.0, 0.0, 3.0], [10.0, 0.0, 3.0]], [leaning, LEVEL], **exact))
    assert reports[0].target == "d2"
    assert reports[0].direction == pytest.approx((0.0, -1.0, 0.0), abs=1e-6)
    assert reports[0].range_m == pytest.approx(10.0, abs=1e-4)
    assert reports[1].direction == pytest.approx((-1.0, 0.0, 0.0), abs=1e-6)
    ahead = dict(seen([[0.0, 0.0, 3.0], [0.0, 10.0, 3.0]], [leaning, LEVEL], **exact))[0].direction
    lean = np.arctan2(3.0, 9.80665)
    assert ahead == pytest.approx((np.cos(lean), 0.0, np.sin(lean)), abs=1e-6)  # its nose is down: d2 is above the nose


def test_errors_are_as_told():
    reports = [one for who, one in seen([[0.0, 0.0, 3.0], [0.0, 20.0, 5.0]], looks=2000, direction_sigma_deg=2.0) if who == 0]
    way = np.array([0.0, 20.0, 2.0])
    directions, ranges = np.array([one.direction for one in reports]), np.array([one.range_m for one in reports])
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0)
    side = directions @ np.array([1.0, 0.0, 0.0])
    assert side.std() == pytest.approx(np.radians(2.0), rel=0.06)
    assert reports[0].direction_sigma_rad == pytest.approx(np.radians(2.0))
    assert (ranges - np.linalg.norm(way)).std() == pytest.approx(reports[0].range_sigma_m, rel=0.06)
    assert ranges.mean() == pytest.approx(np.linalg.norm(way), abs=0.03)


@pytest.mark.parametrize(("sensor", "has"), [("both", (True, True)), ("direction", (True, False)), ("range", (False, True))])
def test_a_sensor_says_what_its_kind_can(sensor, has):
    for _, one in seen([[0.0, 0.0, 3.0], [10.0, 0.0, 3.0]], sensor=sensor):
        assert ((one.direction is not None), (one.range_m is not None)) == has
        assert ((one.direction_sigma_rad is not None), (one.range_sigma_m is not None)) == has


def test_nobody_sees_too_far_behind_itself_or_through_a_wall():
    places = [[0.0, 0.0, 2.0], [10.0, 0.0, 2.0], [0.0, 50.0, 2.0]]
    assert {(who, one.target) for who, one in seen(places)} == {(0, "d2"), (1, "d1")}
    assert {(who, one.target) for who, one in seen(places, field_of_view_deg=120.0)} == {(0, "d2")}
    wall = Walls([WallTruth(from_m=(5.0, -2.0), to_m=(5.0, 2.0), height_m=3.0)])
    assert seen(places, walls=wall) == []
    assert len(seen(places, walls=wall, range_m=60.0)) == 4  # past the wall's end


def test_a_tenth_of_the_reports_is_false_and_half_of_that_another_drone():
    places = [[0.0, 0.0, 3.0], [10.0, 0.0, 3.0], [0.0, 25.0, 3.0]]
    exact = {"direction_sigma_deg": 1e-3, "range_sigma_m": 1e-3}
    reports = [one for who, one in seen(places, looks=3000, false_share=0.1, **exact) if who == 0 and one.target == "d2"]
    true = [abs(one.range_m - 10.0) < 0.1 and one.direction[0] > 0.999 for one in reports]
    mistaken = [abs(one.range_m - 25.0) < 0.1 and one.direction[1] > 0.999 for one in reports]
    assert np.mean(true) == pytest.approx(0.9, abs=0.017)  # three sigmas
    assert np.mean(mistaken) == pytest.approx(0.05, abs=0.012)


def test_some_are_missed_and_occlusions_last():
    places = [[0.0, 0.0, 3.0], [10.0, 0.0, 3.0]]
    assert len(seen(places, looks=2000, missed=0.2)) / 4000 == pytest.approx(0.8, abs=0.02)
    sensors = Sightings(
        SightingTruth(**{**SURE, "visible_s": 20.0, "occluded_s": 5.0}), NAMES[:2], None, 0.05, np.random.default_rng(1)
    )
    sees = []
    for look in range(20_000):
        sensors.look(look, np.array(places), [LEVEL] * 2)
        sees.append(0 in [observer for observer, _ in sensors.take(look)])
    assert np.mean(sees) == pytest.approx(0.8, abs=0.05)
    blocked = np.flatnonzero(np.diff(np.array(sees, dtype=int)))
    assert np.diff(blocked).mean() * 0.2 == pytest.approx(12.5, rel=0.2)  # mean of 20 s and 5 s


def test_reports_come_late_and_keep_the_stamp_of_what_was_seen():
    sensors = Sightings(
        SightingTruth(**{**SURE, "delay_s": 0.1, "rate_hz": 5.0}), NAMES[:2], None, 0.05, np.random.default_rng(1)
    )
    assert [step for step in range(12) if sensors.due(step)] == [0, 4, 8]
    sensors.look(1_000_000_000, np.array([[0.0, 0.0, 3.0], [9.0, 0.0, 3.0]]), [LEVEL] * 2)
    assert sensors.take(1_050_000_000) == []
    late = sensors.take(1_100_000_000)
    assert [observer for observer, _ in late] == [0, 1]
    assert late[0][1][0].stamp_ns == 1_000_000_000
    assert sensors.take(1_150_000_000) == []
