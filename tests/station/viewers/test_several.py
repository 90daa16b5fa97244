"""Several sources of one estimate in Foxglove: on the map, in the scene and as tables."""

import json

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from radron.agent.config.mission import AreaConfig, DatumConfig, DroneInMission, MissionConfig
from radron.agent.frames.geodesy import mission_from_geodetic
from radron.agent.fusion.estimator import Hypothesis
from radron.station.picture.picture import Picture
from radron.station.viewers import topics
from radron.station.viewers.foxglove import Foxglove

MISSION = MissionConfig(
    name="m",
    area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0))),
    drones=(DroneInMission(id="d1"),),
    datum=DatumConfig(latitude_deg=50.0, longitude_deg=14.0),
)
NOW_NS = 1_800_000_000_000_000_000


def hypothesis(x, nuclide, others=()):
    return Hypothesis(NOW_NS, np.array([x, 5.0, 0.0]), np.diag([0.04, 0.01, 0.0]), np.zeros(3), 9, NOW_NS,
                      activity_bq=1e9, nuclide=nuclide, others=others)  # fmt: skip


@pytest.fixture
def told():
    """Messages on the sources by topic, after the estimate has changed the order of its list."""
    picture = Picture(MISSION, None)
    foxglove = Foxglove(picture)
    schemas = {topic.name: topic.schema for topic in foxglove.topics}
    found = {}
    for second, order in enumerate((("Cs-137", "Co-60"), ("Co-60", "Cs-137"))):
        x = {"Cs-137": 10.0, "Co-60": 40.0}
        picture.log.fusion.hypothesis = hypothesis(x[order[0]], order[0], (hypothesis(x[order[1]], order[1]),))
        frame = picture.frame(NOW_NS + second * 10**9)
        found = {message.topic: read(schemas[message.topic], message.encode()) for message in foxglove.show(frame, [], [])}
    return found


def read(schema, data):
    """A message by its schema."""
    if schema.encoding == "jsonschema":
        return json.loads(data)
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name)).FromString(data)


def test_the_scene_has_each_source_with_region_and_cordon_under_its_own_name(told):
    entities = {entity.id: entity for entity in told[topics.SOURCE_SCENE].entities}
    assert set(entities) == {f"{what}{number}" for what in ("source", "region", "cordon 10 µSv/h") for number in ("", " 2")}
    assert entities["source"].texts[0].text == "Cs-137"
    assert entities["source 2"].texts[0].text == "Co-60 2"
    assert entities["source 2"].spheres[0].pose.position.x == 40.0
    corners = [point.x for point in entities["region 2"].lines[0].points]
    assert (min(corners), max(corners)) == pytest.approx((40.0 - 2.146 * 0.2, 40.0 + 2.146 * 0.2), abs=1e-3)


def test_the_map_has_each_source_where_it_is(told):
    features = {each["properties"]["name"]: each["geometry"] for each in json.loads(told[topics.MAP].geojson)["features"]}
    assert set(features) == {"area", "source", "region", "cordon", "source 2", "region 2", "cordon 2"}
    longitude, latitude = features["source 2"]["coordinates"]
    assert mission_from_geodetic(MISSION.datum, latitude, longitude, 0.0)[:2] == pytest.approx((40.0, 5.0), abs=1e-3)


def test_the_tables_name_the_sources_by_their_numbers(told):
    first, other = told[topics.SOURCE], told[topics.OTHERS]
    assert [(one["number"], one["nuclide"], one["x_m"]) for one in (first, other)] == [(2, "Co-60", 40.0), (1, "Cs-137", 10.0)]
