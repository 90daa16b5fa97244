"""The way home around the homes of others that are not heard."""

import numpy as np
import pytest

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.navigation.unheard.wayaround import KeptPlace, WayAround


def mission(left, right, margin_m):
    area = AreaConfig(polygon_m=((left, 0.0), (right, 0.0), (right, 40.0), (left, 40.0)), fence_margin_m=margin_m)
    return MissionConfig(name="test", area=area, drones=(DroneInMission(id="a"),))


MISSION = mission(0.0, 40.0, 20.0)
ROW = tuple(KeptPlace((x, 9.0), 0.3) for x in (5.0, 12.0, 19.0, 26.0))
HERE, HOME = (16.0, 20.0), (12.0, 2.0)


def length_m(way):
    return float(np.hypot(*np.diff(way, axis=0).T).sum())


def nearest_m(way, place):
    """From a place to the way, sampled."""
    along = np.linspace(0.0, len(way) - 1.0, 2000)
    points = np.column_stack([np.interp(along, np.arange(len(way)), way[:, axis]) for axis in (0, 1)])
    return float(np.hypot(*(points - place).T).min())


def test_it_leads_around_a_row_of_homes_and_not_up_to_it():
    """On a straight way a drone hovered for half a minute before the row, where another drone came home."""
    way = WayAround(MISSION).way(HERE, HOME, ROW, 0.0)
    assert way[0] == pytest.approx(HERE)
    assert way[-1] == pytest.approx(HOME)
    assert min(nearest_m(way, home.place) for home in ROW) > 5.6 - 1e-3  # 3 m, the margin of plans, and 2 sigma
    assert 30.0 < length_m(way) < 45.0


def test_it_is_straight_where_no_home_lies_on_it():
    assert WayAround(MISSION).way(HERE, HOME, (), 0.0) == pytest.approx(np.array([HERE, HOME]))
    assert WayAround(MISSION).way(HERE, HOME, (KeptPlace((30.0, 9.0)),), 0.0) == pytest.approx(np.array([HERE, HOME]))


def test_a_drone_that_is_nearer_to_a_home_than_plans_keep_comes_no_nearer():
    way = WayAround(MISSION).way((16.0, 13.0), HOME, ROW, 0.0)
    assert nearest_m(way, (19.0, 9.0)) > 5.0 - 0.5  # 5 m, less the grain of circles, and corners for arcs
    assert length_m(way) > 20.0


def test_a_home_next_to_its_own_does_not_keep_it_from_there():
    beside = KeptPlace((HOME[0] + 3.0, HOME[1]))
    way = WayAround(MISSION).way(HERE, HOME, (beside,), 0.0)
    assert way[-1] == pytest.approx(HOME)
    assert nearest_m(way, beside.place) > 2.0


def test_it_stays_inside_the_fence_and_is_straight_where_there_is_no_way():
    way = WayAround(mission(10.0, 20.0, 0.0)).way((16.0, 30.0), (13.0, 2.0), ROW, 0.0)
    assert way == pytest.approx(np.array([(16.0, 30.0), (13.0, 2.0)]))
