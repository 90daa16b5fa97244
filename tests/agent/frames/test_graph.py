import math

import pytest

from agent.config import AreaConfig, DroneInMission, MissionConfig
from agent.frames.graph import FrameGraph
from agent.frames.transform import Transform


@pytest.fixture
def graph():
    drones = (DroneInMission(id="a"), DroneInMission(id="b", origin_m=(3.0, 4.0, 0.5), yaw_deg=90.0))
    area = AreaConfig(polygon_m=((0.0, 0.0), (10.0, 0.0), (10.0, 10.0)))
    return FrameGraph.from_launch_layout(MissionConfig(name="test", drones=drones, area=area))


def test_the_launch_layout_places_every_drone(graph):
    assert graph.mission_from_local("a", 0).apply_point((1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)
    b = graph.mission_from_local("b", 0)
    assert b.yaw_rad == pytest.approx(math.pi / 2)
    assert b.apply_point((1.0, 0.0, 0.0)) == pytest.approx((3.0, 5.0, 0.5))


def test_strangers_and_later_epochs_are_unknown(graph):
    assert graph.mission_from_local("z", 0) is None
    assert graph.mission_from_local("a", 1) is None


def test_the_newest_replaces_and_is_noticed(graph):
    before = graph.revision
    first, second = Transform(0.1), Transform(0.2)
    graph.place("a", 1, first)
    graph.place("a", 1, second)
    assert graph.mission_from_local("a", 1) is second
    assert graph.revision > before
