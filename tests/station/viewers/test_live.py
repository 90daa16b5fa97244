"""Foxglove's socket, read by a client of its protocol; each refusal beside the allowed case."""

import base64
import json
import struct
import time
from contextlib import ExitStack, contextmanager, suppress

import msgspec
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from msgspec.structs import replace
from websockets.exceptions import ConnectionClosed, InvalidStatus

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.station.hub import Hub
from radron.station.picture.frame import Event
from radron.station.picture.picture import Picture
from radron.station.viewers import live as live_module
from radron.station.viewers.live import LiveFoxglove
from radron.station.web.foxglove import MAX_CLIENTS, door
from support.page.served_page import served
from support.page.shown_drone import D1, NOW_NS, PLACE_M, POSE, SPEED_MPS, give

MISSION = MissionConfig(
    name="<b>m</b>",
    area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0))),
    drones=(D1,),
)
REFUSED = (ConnectionClosed, InvalidStatus)
PROTOCOL = "foxglove.sdk.v1"


@pytest.fixture
def live():
    """Foxglove's outlet of a hub."""
    hub = Hub(Picture(MISSION, None), replay=False)
    live = LiveFoxglove(hub)
    hub.outlets.append(live)
    return live, hub


@pytest.fixture
def page(live):
    """A page with Foxglove's door."""
    live, hub = live
    with served(hub, doors=lambda guard: [door(live, guard)]) as page:
        page.foxglove = live
        yield page


def foxglove(page, protocol=PROTOCOL, path="foxglove", **options):
    return page.socket(path=path, subprotocols=[protocol], **options)


def advertised(socket):
    """Channels by topic, after the greeting."""
    assert json.loads(socket.recv(timeout=10.0))["op"] == "serverInfo"
    return {channel["topic"]: channel for channel in json.loads(socket.recv(timeout=10.0))["channels"]}


@contextmanager
def subscribed(page, *topics):
    """A client of topics, by their places the subscriptions' numbers, and the channels."""
    with foxglove(page) as socket:
        channels = advertised(socket)
        wanted = [{"id": number, "channelId": channels[topic]["id"]} for number, topic in enumerate(topics)]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        wait(page, *range(len(topics)))
        yield socket, channels


def wait(page, *subscriptions):
    """Until the only client has these."""
    until = time.monotonic() + 10.0
    while page.call(lambda: sorted(page.foxglove.clients[0].subscribed.values())) != sorted(subscriptions):
        assert time.monotonic() < until


def show(page, now_ns):
    """The drone publishes a pose, and the station shows it."""
    pose = replace(POSE, stamp_ns=now_ns)
    page.call(lambda: give(page.hub.picture, MISSION, pose, now_ns=now_ns))
    page.call(page.hub.show, now_ns)


def received(socket, channel):
    """Subscription, log time and content of the next message, decoded by the announced schema."""
    data = socket.recv(timeout=10.0)
    opcode, subscription, log_ns = struct.unpack_from("<BIQ", data)
    assert opcode == 1
    if channel["encoding"] == "json":
        return subscription, log_ns, json.loads(data[13:])
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))
    return subscription, log_ns, kind.FromString(data[13:])


@pytest.mark.parametrize("protocol", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
def test_a_client_is_told_the_topics_with_their_schemas(page, protocol):
    with foxglove(page, protocol) as socket:
        assert socket.subprotocol == protocol
        channels = advertised(socket)
    assert channels["/d1/pose"]["schemaName"] == "foxglove.PoseInFrame"
    assert (channels["/d1/pose"]["encoding"], channels["/d1/pose"]["schemaEncoding"]) == ("protobuf", "protobuf")
    assert json.loads(channels["/d1/state"]["schema"])["properties"]["stage"] == {"type": "string"}
    assert "/d1/fix" not in channels  # this mission's frame has no place on Earth


def test_a_pose_comes_as_it_was_published_and_nothing_that_was_not_subscribed_to(page):
    with subscribed(page, "/d1/state", "/d1/pose") as (socket, channels):
        show(page, NOW_NS)
        subscription, log_ns, content = received(socket, channels["/d1/pose"])
        assert (subscription, log_ns) == (1, NOW_NS)
        place = content.pose.position
        assert (place.x, place.y, place.z) == pytest.approx(PLACE_M, abs=1e-12)
        subscription, _, table = received(socket, channels["/d1/state"])
        assert (subscription, table["speed_mps"], table["sigma_m"]) == (0, SPEED_MPS, 0.3)


def test_after_the_end_of_a_subscription_nothing_comes(page):
    with subscribed(page, "/d1/pose", "/events") as (socket, channels):
        socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [0]}))
        wait(page, 1)
        show(page, NOW_NS)
        page.call(page.hub.note, Event(at_ms=1, text="stage", values={"drone": "<i>d1</i>", "stage": "{stage}"}))
        subscription, _, content = received(socket, channels["/events"])
        while "heard" in content.message or "stage" not in content.message:
            subscription, _, content = received(socket, channels["/events"])
        assert (subscription, content.message) == (1, "<i>d1</i>: {stage}")  # passed on as published, not interpreted


@pytest.mark.parametrize(
    "origin", ["https://evil.example", "http://localhost:9", "null", "https://app.foxglove.dev.evil.example"]
)
def test_another_sites_scripts_are_refused(page, origin):
    with pytest.raises(REFUSED), foxglove(page, origin=origin) as socket:
        socket.recv(timeout=10.0)
    for allowed in (None, "https://app.foxglove.dev", "file://"):
        with foxglove(page, origin=allowed) as socket:
            assert "/tf" in advertised(socket)


def test_a_foreign_name_that_points_here_is_refused(page):
    with pytest.raises(REFUSED), foxglove(page, host="evil.example") as socket:
        socket.recv(timeout=10.0)


def test_the_page_itself_is_still_refused_to_foxgloves_site(page):
    with pytest.raises(REFUSED), page.socket(origin="https://app.foxglove.dev") as socket:
        socket.recv(timeout=10.0)


def test_a_client_of_another_protocol_is_refused(page):
    with pytest.raises(REFUSED), foxglove(page, "foxglove.other") as socket:
        socket.recv(timeout=10.0)


@pytest.mark.parametrize(
    "text", ["{", '{"op": 1}', '{"op": "subscribe", "subscriptions": [{"id": "x"}]}', '"' + "x" * 70_000 + '"']
)
def test_what_is_not_of_the_protocol_ends_the_connection(page, text):
    with foxglove(page) as socket:
        advertised(socket)
        socket.send(text)
        with pytest.raises(ConnectionClosed):
            socket.recv(timeout=10.0)


def test_a_flood_ends_the_connection(page):
    with foxglove(page) as socket:
        advertised(socket)
        with suppress(ConnectionClosed):
            for _ in range(1000):
                socket.send('{"op": "getParameters", "parameterNames": []}')
        with pytest.raises(ConnectionClosed):
            socket.recv(timeout=10.0)


def test_unknown_channels_and_requests_without_capability_are_without_effect(page):
    with foxglove(page) as socket:
        channels = advertised(socket)
        socket.send(json.dumps({"op": "fetchAsset", "uri": "file:///etc/passwd", "requestId": 1}))
        wanted = [{"id": 9, "channelId": 12345}, {"id": 0, "channelId": channels["/d1/pose"]["id"]}]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        wait(page, 0)
        show(page, NOW_NS)
        assert received(socket, channels["/d1/pose"])[0] == 0


def test_there_is_a_limit_to_the_clients(page):
    with ExitStack() as stack:
        for _ in range(MAX_CLIENTS):
            advertised(stack.enter_context(foxglove(page)))
        with pytest.raises(REFUSED), foxglove(page) as socket:
            socket.recv(timeout=10.0)


def test_a_client_that_does_not_read_is_let_go(live, monkeypatch):
    monkeypatch.setattr(live_module, "MAX_WAITING_MESSAGES", 20)
    live, hub = live
    with live.joined() as client:
        live.ask(client, json.dumps({"op": "subscribe", "subscriptions": [{"id": 0, "channelId": 1}]}))
        for place in range(20):
            pose = replace(POSE, stamp_ns=NOW_NS + place * 100_000_000)
            give(hub.picture, MISSION, pose, now_ns=pose.stamp_ns)
            hub.show(pose.stamp_ns)
        assert client.gone
    assert not live.clients


def test_a_client_of_another_mission_connects_again_and_is_told_its_topics(page):
    other = msgspec.structs.replace(MISSION, drones=(*MISSION.drones, DroneInMission(id="d2")))
    with subscribed(page, "/events") as (socket, channels):
        assert "/d2/pose" not in channels
        page.call(setattr, page.hub, "picture", Picture(other, None))
        page.call(page.hub.show, NOW_NS)
        with pytest.raises(ConnectionClosed):
            list(socket)
    with foxglove(page) as socket:
        assert "/d2/pose" in advertised(socket)
