"""The MCAP file for Foxglove, read by MCAP's own reader and decoded by the schemas in it."""

import asyncio
import base64
import json
from collections import defaultdict

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from radron.agent.config.mission import DatumConfig
from radron.agent.errors import FlightRecordError
from radron.agent.frames.geodesy import mission_from_geodetic
from radron.protocol.codec import decode_from
from radron.protocol.entries import Exposure
from radron.protocol.messages import Pose
from radron.station.hub import Hub
from radron.station.picture.picture import Picture
from radron.station.replay import Records, play
from radron.station.viewers.record import STEP_MS, export

FOXGLOVE = {  # https://docs.foxglove.dev/docs/sdk/schemas
    "/tf": "foxglove.FrameTransforms",
    "/scene/area": "foxglove.SceneUpdate",
    "/scene/drones": "foxglove.SceneUpdate",
    "/scene/source": "foxglove.SceneUpdate",
    "/scene/cones": "foxglove.SceneUpdate",
    "/posterior": "foxglove.Grid",
    "/dose": "foxglove.Grid",
    "/events": "foxglove.Log",
    "/map": "foxglove.GeoJSON",
    "/source/fix": "foxglove.LocationFix",
    "/d1/fix": "foxglove.LocationFix",
    "/d1/pose": "foxglove.PoseInFrame",
    "/d1/plan": "foxglove.PosesInFrame",
    "/source": "radron.Source",
    "/search": "radron.Search",
    "/log": "radron.Log",
    "/d1/state": "radron.Drone",
    "/d1/counts": "radron.Counts",
    "/d1/spectrum": "radron.Spectrum",
}


@pytest.fixture(scope="module")
def written(flights, tmp_path_factory):
    """The file and the layout beside it."""
    shares = []
    files, flaws = export(flights[:1], tmp_path_factory.mktemp("out") / "flight.mcap", shares.append)
    assert (shares[-1], flaws) == (1.0, ())
    return files


@pytest.fixture(scope="module")
def messages(written):
    """All messages by topic: log time, decoded content."""
    found = defaultdict(list)
    with written[0].open("rb") as file:
        reader, protobuf, validators = make_reader(file, validate_crcs=True), DecoderFactory(), {}
        summary = reader.get_summary()
        schemas = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
        assert {topic: schemas[topic] for topic in FOXGLOVE} == FOXGLOVE
        for schema, channel, message in reader.iter_messages():
            content = (protobuf.decoder_for(channel.message_encoding, schema) or json.loads)(message.data)
            if schema.encoding == "jsonschema":
                validator = validators.setdefault(schema.name, jsonschema.Draft7Validator(json.loads(schema.data)))
                validator.validate(content)
            found[channel.topic].append((message.log_time, content))
    return found


@pytest.fixture(scope="module")
def heard(flights):
    """Messages that the drone has received and sent."""
    return [decode_from(each.key, each.payload) for each in Records(flights[:1]).messages()]


def stamp_ns(timestamp):
    return timestamp.seconds * 1_000_000_000 + timestamp.nanos


def test_every_topic_has_messages_and_decodes_by_its_schema(messages):
    assert set(FOXGLOVE) <= set(messages)
    assert {topic for topic in messages if topic.startswith("/d")} >= {f"/d{n}/pose" for n in (1, 2, 3)}


def test_the_schemas_of_tables_are_as_plain_as_foxglove_reads_them(written):
    with written[0].open("rb") as file:
        schemas = make_reader(file).get_summary().schemas.values()
    tables = [json.loads(schema.data) for schema in schemas if schema.encoding == "jsonschema"]
    assert len(tables) == 6
    for table in tables:
        for about in table["properties"].values():
            plain = about["items"] if about["type"] == "array" else about
            assert plain == {"type": plain["type"]}
            assert plain["type"] in ("string", "number", "boolean")


def test_bodies_stand_in_their_local_frames_exactly_where_the_drones_have_published_them(messages, heard):
    published = {(pose.drone, pose.stamp_ns): pose for pose in heard if isinstance(pose, Pose)}
    compared = 0
    for _, content in messages["/tf"]:
        local, body = content.transforms
        assert (local.parent_frame_id, local.child_frame_id) == ("mission", body.parent_frame_id)
        pose = published[body.child_frame_id, stamp_ns(body.timestamp)]
        at, turn = body.translation, body.rotation
        assert (at.x, at.y, at.z) == pose.position_m
        assert (turn.w, turn.x, turn.y, turn.z) == pose.quaternion
        compared += 1
    assert compared > 300  # ten times a second


def test_a_pose_in_the_mission_frame_is_that_of_the_two_transforms(messages):
    of_d1 = [content for _, content in messages["/tf"] if content.transforms[1].child_frame_id == "d1"]
    transforms = {stamp_ns(content.transforms[1].timestamp): content for content in of_d1}
    for _, content in messages["/d1/pose"]:
        local, body = transforms[stamp_ns(content.timestamp)].transforms
        yaw = 2.0 * np.arctan2(local.rotation.z, local.rotation.w)
        turn = np.exp(1j * yaw) * complex(body.translation.x, body.translation.y)
        place = content.pose.position
        assert (place.x, place.y) == pytest.approx((turn.real + local.translation.x, turn.imag + local.translation.y), abs=1e-9)
        assert place.z == pytest.approx(body.translation.z + local.translation.z, abs=1e-9)


def test_the_counts_are_those_of_the_log(messages, heard):
    exposures = {(entry.drone, entry.end_ns * 1e-9): entry for entry in heard if isinstance(entry, Exposure)}
    told = [(drone, table) for drone in ("d1", "d2", "d3") for _, table in messages[f"/{drone}/counts"]]
    assert len(told) == len({(drone, table["end_s"]) for drone, table in told}) > 100
    for drone, table in told:
        exposure = exposures[drone, table["end_s"]]
        assert table["live_time_s"] == exposure.live_time_s
        assert [table[name] for name in ("hits", "photopeak", "coincidences")] == [
            exposure.counts.hits,
            exposure.counts.photopeak,
            exposure.counts.coincidences,
        ]
        assert sum(table["singles"]) == sum(each.singles for each in exposure.spectrum)
        assert sum(table["coincident"]) == sum(each.coincidences for each in exposure.spectrum)


class Seen:
    """Frames for the page, by their times, and the newest layer of each kind."""

    def __init__(self):
        self.frames, self.layers = {}, {}

    def show(self, frame, layers, cones):
        self.frames[frame.at_ms] = frame
        self.layers |= {layer.kind: layer for layer in layers}

    def note(self, event):
        """Events are not looked at."""


@pytest.fixture(scope="module")
def seen(flights):
    """Frames for the page from the same records."""
    records, seen = Records(flights[:1]), Seen()
    hub = Hub(Picture(records.mission, records.verifier), replay=True)
    hub.outlets.append(seen)
    asyncio.run(play(hub, records, STEP_MS))
    return seen


def test_the_source_is_that_of_the_page(messages, seen):
    for log_ns, table in messages["/source"]:
        source = seen.frames[log_ns // 1_000_000].source
        assert (table["x_m"], table["y_m"], table["z_m"]) == source.place
        assert (table["rms_m"], table["activity_bq"]) == (source.rms_m, source.activity_bq)
        assert tuple(table["covariance_m2"]) == source.covariance_m2
    assert len(messages["/source"]) > 5
    for log_ns, table in messages["/log"]:
        assert table["digest"] == seen.frames[log_ns // 1_000_000].digest


def test_places_on_earth_are_those_of_the_mission_frame(messages):
    datum = DatumConfig(latitude_deg=47.4, longitude_deg=8.5, altitude_m=488.0)
    poses = {stamp_ns(content.timestamp): content.pose.position for _, content in messages["/d1/pose"]}
    for _, fix in messages["/d1/fix"]:
        place = poses[stamp_ns(fix.timestamp)]
        found = mission_from_geodetic(datum, fix.latitude, fix.longitude, fix.altitude)
        assert found == pytest.approx((place.x, place.y, place.z), abs=1e-6)
    for (_, fix), (_, table) in zip(messages["/source/fix"], messages["/source"], strict=True):
        assert (fix.latitude, fix.longitude) == pytest.approx((table["latitude_deg"], table["longitude_deg"]), abs=1e-9)
    features = json.loads(messages["/map"][-1][1].geojson)["features"]
    assert [feature["properties"]["name"] for feature in features] == ["area", "source", "region", "cordon"]


def test_the_layers_are_those_of_the_page_in_their_units(messages, seen):
    for topic, kind in (("/posterior", "belief"), ("/dose", "dose")):
        layer = seen.layers[kind]
        grid = next(content for _, content in reversed(messages[topic]) if stamp_ns(content.timestamp) == layer.at_ms * 1_000_000)
        steps = np.frombuffer(base64.b64decode(layer.values), np.uint8)
        values = np.frombuffer(grid.data, "<f4")
        assert (grid.column_count, len(values)) == (layer.columns, len(steps))
        assert (grid.pose.position.x, grid.pose.position.y) == layer.origin
        assert grid.cell_size.x == grid.cell_size.y == layer.cell_m
        assert values.argmax() == steps.argmax()
        # the greatest value, in the page's scale: a step of the dose rate is a 32nd of a decade
        assert values.max() == pytest.approx(layer.scale, rel=1e-6 if kind == "belief" else 10 ** (1 / 32) - 1)


def test_events_are_told_in_the_words_of_the_page(messages):
    texts = [content.message for _, content in messages["/events"]]
    assert texts.count("source found") == 1
    stages = [f"d1: {stage}" for stage in ("preflight", "takeoff", "track")]
    assert [text for text in texts if text in stages] == stages


def test_a_scene_replaces_what_was_there_and_ends_with_source_region_and_cordon(messages):
    for topic in ("/scene/area", "/scene/drones", "/scene/source", "/scene/cones"):
        for _, update in messages[topic]:
            assert [deletion.type for deletion in update.deletions] == [1]  # all
    assert [entity.id for entity in messages["/scene/source"][-1][1].entities] == ["source", "region", "cordon 10 µSv/h"]
    assert [entity.id for entity in messages["/scene/area"][0][1].entities] == ["area", "fence"]
    bodies = [entity for entity in messages["/scene/drones"][-1][1].entities if entity.frame_locked]
    assert [(body.id, body.frame_id) for body in bodies] == [(name, name) for name in ("d1", "d2", "d3")]
    assert any(len(entity.lines) > 0 for _, update in messages["/scene/cones"] for entity in update.entities)


def test_the_layout_names_only_topics_and_fields_that_are_there(written, messages):
    layout = json.loads(written[1].read_text())
    paths = [line["value"] for panel in layout["configById"].values() for line in panel.get("paths", ())]
    paths += [layout["configById"]["Plot!spectrum"]["xAxisPath"]["value"]]
    for path in paths:
        topic, field = path.rsplit(".", 1)
        assert any(field.removesuffix("[:]") in table for _, table in messages[topic]), path
    assert set(layout["configById"]["3D!scene"]["topics"]) <= set(messages)
    assert set(layout["configById"]["map!earth"]["topicColors"]) <= set(messages)
    assert _panels(layout["layout"]) == set(layout["configById"])


def _panels(split):
    return {split} if isinstance(split, str) else _panels(split["first"]) | _panels(split["second"])


def test_a_record_is_not_replaced(flights):
    (record,) = flights[0].glob("*.mcap")
    before = record.read_bytes()
    with pytest.raises(FlightRecordError, match="is one of the records"):
        export(flights[:1], record, lambda share: None)
    assert record.read_bytes() == before
