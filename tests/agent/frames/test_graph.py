import math

import numpy as np
import pytest

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform


@pytest.fixture
def graph():
    drones = (
        DroneInMission(id="a"),
        DroneInMission(id="b", origin_m=(3.0, 4.0, 0.5), yaw_deg=90.0),
        DroneInMission(id="s", localization="slam"),
    )
    area = AreaConfig(polygon_m=((0.0, 0.0), (10.0, 0.0), (10.0, 10.0)))
    return FrameGraph.from_launch_layout(MissionConfig(name="test", drones=drones, area=area))


def test_the_launch_layout_places_every_drone_that_it_is_exact_for(graph):
    assert graph.mission_from_local("a", 0).apply_point((1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)
    b = graph.mission_from_local("b", 0)
    assert b.yaw_rad == pytest.approx(math.pi / 2)
    assert b.apply_point((1.0, 0.0, 0.0)) == pytest.approx((3.0, 5.0, 0.5))
    assert graph.mission_from_local("s", 0) is None


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


def test_each_time_has_its_transform():
    graph, one, two = FrameGraph(), Transform(0.1), Transform(0.2)
    graph.replace_from("s", 0, 100, [(100, one), (200, two), (300, None)])
    found = [graph.mission_from_local("s", 0, stamp) for stamp in (5, 100, 199, 200, 300)]
    assert found == [one, one, one, two, None]  # before it was known first: as it was known first
    assert graph.mission_from_local("s", 0) is None


def test_changes_name_the_earliest_stamp_since_a_revision():
    graph, one, two, three = FrameGraph(), Transform(0.1), Transform(0.2), Transform(0.3)
    graph.replace_from("s", 0, 100, [(100, one)])
    first = graph.revision
    assert graph.changes(0) == {("s", 0): 0}
    graph.replace_from("s", 0, 200, [(200, two)])
    second = graph.revision
    graph.replace_from("s", 0, 300, [(300, three)])
    assert graph.changes(first) == {("s", 0): 200}
    assert graph.changes(second) == {("s", 0): 300}
    graph.replace_from("s", 0, 150, [(200, three)])
    assert graph.changes(second) == {("s", 0): 200}
    assert graph.changes(graph.revision) == {}
    assert graph.mission_from_local("s", 0, 400) is three


def test_what_is_cut_off_changes_from_there_on():
    graph, one, two = FrameGraph(), Transform(0.1), Transform(0.2)
    graph.replace_from("s", 0, 100, [(100, one), (200, two)])
    before = graph.revision
    graph.replace_from("s", 0, 150, [])
    assert graph.changes(before) == {("s", 0): 200}
    assert graph.mission_from_local("s", 0, 250) is one


def test_the_same_again_is_no_change():
    graph = FrameGraph()
    graph.replace_from("s", 0, 100, [(100, Transform(0.1, (1.0, 2.0, 3.0), np.eye(4)))])
    before = graph.revision
    graph.replace_from("s", 0, 100, [(100, Transform(0.1, (1.0, 2.0, 3.0), np.eye(4)))])
    assert graph.revision == before
    graph.replace_from("s", 0, 100, [(100, Transform(0.1, (1.0, 2.0, 3.0), 2.0 * np.eye(4)))])
    assert graph.changes(before) == {("s", 0): 0}


def test_a_place_of_the_launch_lies_as_the_first_sightings_tell_and_not_as_the_layout_says(graph):
    """The layout was 5.7 m off, and so was the home of that drone."""
    second, place = 1_000_000_000, (5.8, -0.9, 0.0)
    layout, seen = (
        Transform(0.0, (x, 2.0, 0.0), covariance=np.diag([sigma_m**2] * 2 + [0.01, 0.001]))
        for x, sigma_m in ((39.4, 2.0), (33.8, 0.3))
    )
    graph.replace_from("s", 0, 0, [(0, layout)])
    assert graph.surest("s", 0, second // 2, place)[0] is layout
    drifted = Transform(0.0, (30.0, 2.0, 0.0), covariance=np.diag([0.01, 0.01, 0.01, 0.0]))
    graph.replace_from("s", 0, second, [(second, seen), (2 * second, None), (9 * second, drifted), (40 * second, drifted)])
    assert graph.surest("s", 0, second // 2, place)[0] is seen
    assert graph.surest("s", 0, 5 * second, place)[0] is drifted  # not known then
    assert graph.surest("s", 1, second, place) is graph.surest("z", 0, second, place) is None
    assert graph.surest("a", 0, second, place) == (graph.mission_from_local("a", 0), 0.0)
