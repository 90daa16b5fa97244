import numpy as np
import pytest
from shapely import Point, Polygon

from sim.scenario import SourceTruth
from sim.source import source_path

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
