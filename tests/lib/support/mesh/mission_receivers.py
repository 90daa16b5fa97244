"""Stand-ins of drones on the ground, on a real mesh: they take an uploaded mission, refuse it, or say nothing."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from radron.protocol.codec import decode, encode
from radron.protocol.keys import key_of
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Answer, Stage, Status, Ticket, Upload
from support.flights.one_pilot import MISSION
from support.mesh.meshes import endpoint


class Drone:
    """Begins anew with an uploaded mission, or refuses it for a reason; ``forgets``: begins anew without it."""

    def __init__(self, name: str, refuses: str = "", deaf: bool = False, forgets: bool = False, has: str = "") -> None:
        self.name, self.refuses, self.deaf, self.forgets = name, refuses, deaf, forgets
        self.mission, self.boot = has or MISSION.mission_id, "0" * 16
        self.number = 1
        self.stage = Stage.PREFLIGHT
        self.answer: Answer | None = None
        self.uploads: list[Upload] = []
        self.problems: tuple[str, ...] = ()
        self.endpoint = endpoint()
        self.content: bytes | None = None

    def receive(self, key: str, payload: bytes) -> None:
        message = decode(payload)
        if not isinstance(message, Upload) or self.name not in message.to or self.deaf:
            return
        if message.to[self.name] != Ticket("0" * 16, self.number):
            return
        self.uploads.append(message)
        self.answer = Answer(message.stamp_ns, message.mission, self.refuses)
        if not self.refuses:
            self.number += 1

    async def live(self, mesh: Mesh) -> None:
        while True:
            status = Status(
                stamp_ns=time.time_ns(), drone=self.name, mission=self.mission, boot=self.boot, stage=self.stage,
                problems=self.problems, ticket=Ticket("0" * 16, self.number), upload=self.answer,
            )  # fmt: skip
            mesh.publish(key_of("radron", status), encode(status))
            await asyncio.sleep(0.1)
            if status.upload is not None and not status.upload.refused and self.boot == "0" * 16:
                taken = self.uploads[-1]
                self.content = await mesh.fetch_mission(taken.station, taken.parts)
                self.boot, self.answer = "1" * 16, None
                self.mission = self.mission if self.forgets else taken.mission
                self.problems = ("the uploaded mission cannot be used",) if self.forgets else ()

    @asynccontextmanager
    async def running(self, dial: tuple[str, ...]) -> AsyncIterator[None]:
        mesh = await Mesh.open(MeshConfig(listen=self.endpoint, connect=dial), "radron", self.name, receive=self.receive)
        living = asyncio.create_task(self.live(mesh))
        try:
            yield
        finally:
            living.cancel()
            await mesh.close()
