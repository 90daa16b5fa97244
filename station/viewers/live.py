"""The swarm live for Foxglove: the part of its WebSocket protocol (foxglove.sdk.v1, foxglove.websocket.v1) for message sources.

Foxglove's own server is not used: it checks neither the host name nor the origin of a request, and has no token, so that any
page open in a browser of this computer could read the flight.
"""

from __future__ import annotations

import asyncio
import base64
import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

import msgspec
from msgspec import Struct

from radron.station.hub import Hub
from radron.station.picture.frame import ConeCurve, Event, Frame, Raster
from radron.station.viewers.foxglove import Foxglove, Message

PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
SITE = "https://app.foxglove.dev"  # origin of Foxglove in a browser
MAX_WAITING_MESSAGES = 4000  # messages for a client that reads too slowly: some seconds of a large swarm
_DATA = struct.Struct("<BIQ")  # opcode, subscription, time (ns)
_OPCODE = 1
_encode = msgspec.json.Encoder().encode


def is_foxglove(origin: str) -> bool:
    """Return whether a request may come from Foxglove, by its origin.

    Allowed are Foxglove's website and installed programs (``file://`` and the like).
    """
    return origin == SITE or urlsplit(origin).scheme not in ("", "http", "https")


class Subscription(Struct, frozen=True):
    """A Foxglove client's subscription to a channel (stream of messages).

    ``id``: number chosen by the client. ``channel``: number of an offered channel.
    """

    id: int
    channel: int = msgspec.field(name="channelId")


class Request(Struct, frozen=True):
    """A request of a Foxglove client, such as a subscription; requests for functions that are not offered have no effect."""

    op: str
    subscriptions: tuple[Subscription, ...] = ()
    ended: tuple[int, ...] = msgspec.field(name="subscriptionIds", default=())


class Client:
    """A connected Foxglove program.

    ``subscribed``: from channel to subscription id. ``gone``: the client must be disconnected.
    """

    def __init__(self) -> None:
        self.subscribed: dict[int, int] = {}
        self.gone = False
        self._waiting: asyncio.Queue[bytes] = asyncio.Queue(MAX_WAITING_MESSAGES)

    def send(self, data: bytes) -> None:
        """Queue a message to the client; a client too far behind is disconnected instead."""
        try:
            self._waiting.put_nowait(data)
        except asyncio.QueueFull:
            self.gone = True

    def leave(self) -> None:
        """Disconnect the client; Foxglove connects again by itself."""
        self.gone = True
        if self._waiting.empty():
            self._waiting.put_nowait(_encode({"op": "status", "level": 0, "message": "another mission"}))

    async def next(self) -> bytes:
        """Wait for the next message to the client, and return it."""
        return await self._waiting.get()


class LiveFoxglove:
    """Sends the state of the swarm to all connected Foxglove programs (``clients``)."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self.clients: list[Client] = []
        self._begin()

    def _begin(self) -> None:
        self._picture = self._hub.picture
        self._foxglove = Foxglove(self._picture)
        self._channels = {topic.name: number for number, topic in enumerate(self._foxglove.topics, 1)}

    @contextmanager
    def joined(self) -> Iterator[Client]:
        """Yield a newly connected Foxglove client, after it has been sent the list of channels."""
        client = Client()
        client.send(_encode({"op": "serverInfo", "name": self._picture.mission.name, "capabilities": [], "metadata": {}}))
        client.send(_encode({"op": "advertise", "channels": [self._about(name) for name in self._channels]}))
        self.clients.append(client)
        try:
            yield client
        finally:
            self.clients.remove(client)

    def ask(self, client: Client, text: str) -> None:
        """Carry out a client's request.

        Raises:
            MsgspecError: the text is no message of Foxglove's protocol.
        """
        request = msgspec.json.decode(text, type=Request)
        if request.op == "subscribe":
            known = self._channels.values()
            client.subscribed |= {each.channel: each.id for each in request.subscriptions if each.channel in known}
        elif request.op == "unsubscribe":
            client.subscribed = {channel: one for channel, one in client.subscribed.items() if one not in request.ended}

    def show(self, frame: Frame, layers: list[Raster], cones: list[ConeCurve]) -> None:
        """Send a state of the swarm to the subscribed clients.

        After a change of the mission all clients are disconnected; they connect again, and get the new mission's channels.
        """
        if self._hub.picture is not self._picture:
            self._begin()
            for client in self.clients:
                client.leave()
        self._send(self._foxglove.show(frame, layers, cones))

    def note(self, event: Event) -> None:
        """Send an event of the timeline to the subscribed clients."""
        self._send((self._foxglove.event(event),))

    def _send(self, messages: Iterable[Message]) -> None:
        for message in messages:
            channel = self._channels[message.topic]
            wanting = [client for client in self.clients if channel in client.subscribed]
            data = message.encode() if wanting else b""
            for client in wanting:
                client.send(_DATA.pack(_OPCODE, client.subscribed[channel], message.log_ns) + data)

    def _about(self, name: str) -> dict[str, object]:
        number = self._channels[name]
        topic = self._foxglove.topics[number - 1]
        schema = topic.schema
        as_text = schema.data.decode() if topic.encoding == "json" else base64.b64encode(schema.data).decode()
        return {
            "id": number,
            "topic": topic.name,
            "encoding": topic.encoding,
            "schemaName": schema.name,
            "schemaEncoding": schema.encoding,
            "schema": as_text,
        }
