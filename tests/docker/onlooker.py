"""An operator's view of the swarm, as JSON lines: run inside an agent's container, as it sees all the others.

Each half second, until the standard input ends: the stage of each drone heard lately, and at which angle it flies around its
hypothesis, degrees.
"""

import asyncio
import json
import math
import os
import sys
import time
import tomllib
from pathlib import Path

from radron.agent.config.loading import load_mission
from radron.protocol.codec import decode_from
from radron.protocol.errors import ProtocolError
from radron.protocol.identity import load_identity
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Estimate, Pose, Status

PERIOD_S = 0.5
FRESH_S = 2.5  # a status comes each second


async def look_on() -> None:
    mission = load_mission(Path("/results/agents/mission.toml"))
    members = {drone.id: drone for drone in mission.drones}
    endpoints = tomllib.loads(f"all = {os.environ['RADRON_MESH__ENDPOINTS']}")["all"]
    stages: dict[str, tuple[float, str]] = {}
    places: dict[str, tuple[float, float]] = {}  # mission frame, m
    centres: dict[str, tuple[float, float]] = {}

    def receive(key: str, payload: bytes) -> None:
        try:
            message = decode_from(key, payload)
        except ProtocolError:
            return
        if isinstance(message, Status):
            stages[message.drone] = (time.monotonic(), str(message.stage))
        elif isinstance(message, Estimate):
            centres[message.drone] = message.sources[0].position_m[:2]
        elif isinstance(message, Pose):
            member = members[message.drone]
            (x, y, _), yaw = message.position_m, math.radians(member.yaw_deg)
            places[message.drone] = (
                member.origin_m[0] + x * math.cos(yaw) - y * math.sin(yaw),
                member.origin_m[1] + x * math.sin(yaw) + y * math.cos(yaw),
            )

    def angle_deg(drone: str) -> float | None:
        if drone not in places or drone not in centres:
            return None
        (x, y), (cx, cy) = places[drone], centres[drone]
        return math.degrees(math.atan2(y - cy, x - cx))

    identity = load_identity(Path(os.environ["RADRON_MESH__IDENTITY"]))  # that of the container in which this runs
    config = MeshConfig(connect=tuple(endpoints[drone] for drone in members), identity=identity)
    mesh = await Mesh.open(config, mission.swarm, None, receive=receive)
    ended = asyncio.create_task(asyncio.to_thread(sys.stdin.read))
    while not ended.done():
        now_s = time.monotonic()
        heard = {drone: stage for drone, (heard_s, stage) in stages.items() if now_s - heard_s < FRESH_S}
        print(json.dumps({drone: {"stage": stage, "angle_deg": angle_deg(drone)} for drone, stage in heard.items()}), flush=True)
        await asyncio.wait([ended], timeout=PERIOD_S)
    await mesh.close()


asyncio.run(look_on())
