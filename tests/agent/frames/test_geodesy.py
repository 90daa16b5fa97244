import math

import numpy as np
import pymap3d
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from radron.agent.config.mission import DatumConfig
from radron.agent.frames.geodesy import mission_from_geodetic, mission_from_geodetics, mission_from_launch
from support.flights.geodetic import geodetic_from_mission, geodetics_from_mission

GRAIN_M = 1e-8  # doubles of an Earth's radius are 1e-9 m apart, and a conversion adds up a few of them
places = st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-500.0, 4000.0))


@st.composite
def datums(draw):
    return DatumConfig(
        latitude_deg=draw(st.floats(-90.0, 90.0)),
        longitude_deg=draw(st.floats(-180.0, 180.0)),
        altitude_m=draw(st.floats(-400.0, 4000.0)),
    )


def datum(latitude_deg, longitude_deg, altitude_m=0.0):
    return DatumConfig(latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=altitude_m)


@given(datums(), places)
@example(datum(90.0, 0.0), (3000.0, -4000.0, 4000.0))
@example(datum(-90.0, 77.0), (0.0, 0.0, 10.0))
@example(datum(89.9999, 180.0), (0.0, 1e4, 0.0))
@example(datum(0.0, 180.0), (1e4, 0.0, 0.0))
@example(datum(10.0, -180.0), (-1e4, 1e4, 4000.0))
@example(datum(0.0, 0.0), (0.0, 0.0, 0.0))
def test_there_and_back_is_the_same_place(where, point):
    latitude, longitude, altitude = geodetic_from_mission(where, point)
    assert -90.0 <= latitude <= 90.0
    assert -180.0 <= longitude <= 180.0
    assert mission_from_geodetic(where, latitude, longitude, altitude) == pytest.approx(point, abs=GRAIN_M)


@given(datums(), places)
def test_the_way_over_earth_centred_coordinates_gives_the_same(where, point):
    latitude, longitude, altitude = geodetic_from_mission(where, point)
    ecef = np.array(pymap3d.geodetic2ecef(latitude, longitude, altitude))
    origin = np.array(pymap3d.geodetic2ecef(where.latitude_deg, where.longitude_deg, where.altitude_m))
    assert np.linalg.norm(ecef - origin) == pytest.approx(math.hypot(*point), abs=GRAIN_M)
    expected = pymap3d.ecef2enu(*ecef, where.latitude_deg, where.longitude_deg, where.altitude_m)
    assert mission_from_geodetic(where, latitude, longitude, altitude) == pytest.approx(expected, abs=GRAIN_M)


def test_east_north_and_up_are_what_they_say():
    where = datum(50.0, 14.0, 300.0)
    assert mission_from_geodetic(where, 50.0, 14.0, 310.0) == pytest.approx((0.0, 0.0, 10.0), abs=GRAIN_M)
    x, y, _ = mission_from_geodetic(where, 50.0, 14.001, 300.0)
    # 1e-3 degrees on the parallel: radius of the parallel at 300 m, N = a / sqrt(1 - e2 sin2)
    across = (6378137.0 / math.sqrt(1.0 - 0.00669437999014 * math.sin(math.radians(50.0)) ** 2) + 300.0) * math.cos(
        math.radians(50.0)
    )
    assert x == pytest.approx(across * math.sin(math.radians(1e-3)), abs=1e-6)
    assert 0.0 < y < 1e-3  # the parallel bends towards the pole
    assert mission_from_geodetic(where, 50.001, 14.0, 300.0)[1] > 111.0


def test_arrays_go_the_same_way_as_points():
    where = datum(-33.0, 151.0, 20.0)
    points = np.random.default_rng(3).uniform(-1e3, 1e3, (5, 3))
    geodetic = geodetics_from_mission(where, points)
    assert geodetic.tolist() == [list(geodetic_from_mission(where, tuple(point))) for point in points.tolist()]
    np.testing.assert_allclose(mission_from_geodetics(where, geodetic), points, atol=GRAIN_M)


@given(datums(), datums(), places, st.floats(-100.0, 100.0))
@example(datum(89.99, 0.0), datum(89.99, 180.0), (0.0, 0.0, 0.0), 10.0)
@example(datum(0.0, 179.999), datum(0.0, -179.999), (100.0, 0.0, 0.0), 10.0)
def test_a_launch_place_is_the_same_by_either_datum_and_the_tilt_bounds_the_error_around_it(mission, origin, launch_m, east):
    transform, tilt_rad = mission_from_launch(mission, origin, launch_m)
    there = mission_from_geodetic(mission, *geodetic_from_mission(origin, launch_m))
    assert transform.apply_point((0.0, 0.0, 0.0)) == pytest.approx(there, abs=2 * GRAIN_M)
    beside = mission_from_geodetic(mission, *geodetic_from_mission(origin, (launch_m[0] + east, *launch_m[1:])))
    assert math.dist(transform.apply_point((east, 0.0, 0.0)), beside) <= 2.0 * math.sin(tilt_rad / 2.0) * abs(east) + 1e-6


def test_a_vehicle_whose_origin_is_elsewhere_is_placed_in_the_mission_frame():
    mission, origin = datum(50.0, 14.0, 300.0), datum(50.02, 14.03, 320.0)  # 3 km away
    launch_m = (-2150.0, -2230.0, -15.0)
    transform, tilt_rad = mission_from_launch(mission, origin, launch_m)
    assert tilt_rad == pytest.approx(math.hypot(0.02, 0.03 * math.cos(math.radians(50.0))) * math.pi / 180.0, rel=0.01)
    convergence = math.radians(0.03) * math.sin(math.radians(50.01))
    assert abs(transform.yaw_rad) == pytest.approx(convergence, rel=1e-3)
    place = (40.0, -60.0, 8.0)  # in the vehicle's frame
    truth = mission_from_geodetic(
        mission, *geodetic_from_mission(origin, tuple(a + b for a, b in zip(launch_m, place, strict=True)))
    )
    wrong_m = math.dist(transform.apply_point(place), truth)
    assert wrong_m <= 2.0 * math.sin(tilt_rad / 2.0) * math.hypot(*place) + GRAIN_M
    assert transform.apply_point((0.0, 0.0, 0.0)) == pytest.approx(
        mission_from_geodetic(mission, *geodetic_from_mission(origin, launch_m)), abs=2 * GRAIN_M
    )
