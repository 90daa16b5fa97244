import msgspec
import numpy as np
import pytest
from shapely import Point, Polygon

from radron.agent.errors import ConfigError
from radron.sim.world.source import source_path
from radron.sim.world.sourcetruth import SourceTruth

AREA = Polygon([(0, 0), (100, 0), (100, 100), (0, 100)])


def path(seed=1, duration_s=300.0, **values):
    return source_path(SourceTruth(activity_bq=1e9, **values), AREA, duration_s, np.random.default_rng(seed))


def test_static_source_is_drawn_from_the_whole_area():
    places = np.array([path(seed)(0.0) for seed in range(300)])
    assert places.min() >= 0.0
    assert places.max() <= 100.0
    np.testing.assert_allclose(places.mean(axis=0), 50.0, atol=6.0)
    assert path(5)(0.0) == path(5)(200.0)


def test_given_start():
    assert path(start_m=(3.0, 4.0))(10.0) == (3.0, 4.0)


def test_circle_has_radius_and_speed():
    place = path(motion="circle", circle_radius_m=40.0, speed_mps=1.0)
    track = np.array([place(t) for t in np.arange(0, 250, 1.0)])
    np.testing.assert_allclose(np.hypot(*(track - 50.0).T), 40.0)
    np.testing.assert_allclose(np.hypot(*np.diff(track, axis=0).T), 1.0, rtol=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_wandering_source_stays_inside_and_below_its_speed(seed):
    place = path(seed, motion="wander", speed_mps=3.0)
    track = np.array([place(t) for t in np.arange(0, 299, 0.5)])
    speed = np.hypot(*np.diff(track, axis=0).T) / 0.5
    assert speed.max() <= 3.0 + 1e-6
    assert speed.mean() > 1.2
    assert all(AREA.buffer(0.1).contains(Point(xy)) for xy in track)


def test_legs_turn_stop_and_end_at_rest():
    legs = (
        {"for_s": 10.0},
        {"for_s": 20.0, "speed_mps": 1.5},
        {"for_s": 5.0},
        {"for_s": 10.0, "speed_mps": 2.0, "turn_deg": 90.0},
    )
    place = source_path(
        msgspec.convert({"activity_bq": 1e9, "motion": "legs", "start_m": (50.0, 50.0), "legs": legs}, SourceTruth),
        AREA,
        300.0,
        np.random.default_rng(1),
    )
    start, walked, carried = (np.array(place(time_s)) for time_s in (0.0, 30.0, 45.0))
    assert place(9.9) == (50.0, 50.0)
    assert np.hypot(*(walked - start)) == pytest.approx(30.0)
    np.testing.assert_allclose(place(34.9), walked)
    first, second = (walked - start) / 30.0, (carried - walked) / 20.0
    np.testing.assert_allclose(second, (-first[1], first[0]), atol=1e-9)  # to the left, at 2 m/s
    assert place(299.0) == place(45.0)


@pytest.mark.parametrize("motion", [{"motion": "legs"}, {"motion": "static", "legs": [{"for_s": 1.0}]}])
def test_legs_and_the_motion_need_each_other(motion):
    with pytest.raises(ConfigError, match=r"source\.legs and source\.motion = 'legs' need each other"):
        msgspec.convert({"activity_bq": 1e9, **motion}, SourceTruth).check(AREA, "file")


def test_a_source_outside_is_drawn_around_the_area():
    source = SourceTruth(activity_bq=1e10, outside_m=(40.0, 90.0))
    places = [source_path(source, AREA, 1.0, np.random.default_rng(seed))(0.0) for seed in range(200)]
    away = [AREA.distance(Point(*place)) for place in places]
    assert 40.0 <= min(away) < 45.0
    assert 85.0 < max(away) <= 90.0
    east = sum(x > AREA.centroid.x for x, _ in places)
    assert 60 < east < 140


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"outside_m": (90.0, 40.0)}, r"source.outside_m: 90 is not below 40"),
        ({"outside_m": (40.0, 90.0), "start_m": (1.0, 1.0)}, r"source.outside_m draws the start"),
        ({"outside_m": (40.0, 90.0), "motion": "wander"}, r"source.outside_m draws the start"),
    ],
)
def test_a_place_outside_is_drawn_where_that_makes_sense(values, complaint):
    with pytest.raises(ConfigError, match=complaint):
        SourceTruth(activity_bq=1e10, **values).check(AREA, "x.toml")
