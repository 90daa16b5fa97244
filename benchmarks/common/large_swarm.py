"""The swarm of a large flight as one process with one Zenoh session: publishes it in real time until its input ends.

Then it prints when it published which place of the first drone (JSON: [[ms UTC, x, y], ...], mission frame, metres).
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import time
from pathlib import Path

from common.large_flight import LargeFlight
from radron.agent.frames.transform import Transform
from radron.protocol.codec import decode
from radron.protocol.keys import drone_key
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Pose

LONGEST_S = 600.0
LIVE_BOOT = "1" * 16
Ended = asyncio.Future[str]


async def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("flown", type=Path, help="what the flight is made from")
    parser.add_argument("drones", type=int)
    parser.add_argument("flown_s", type=float, help="of the flight, before this process joins it")
    parser.add_argument("listen")
    arguments = parser.parse_args()
    flight = LargeFlight(arguments.drones, arguments.flown)
    swarm, names = flight.mission.swarm, [drone.id for drone in flight.mission.drones]
    mesh = await Mesh.open(MeshConfig(listen=arguments.listen), swarm, names[0], receive=lambda key, payload: None)
    assert mesh._session is not None  # the tokens of all drones, which each would declare itself
    tokens = [mesh._session.liveliness().declare_token(drone_key(swarm, name, "alive")) for name in names[1:]]
    print("joined", flush=True)
    ended = asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    first = flight.mission.drones[0]
    published = await _publish(mesh, flight, arguments.flown_s, names[0], ended)
    transform = Transform(first.yaw_deg * 3.141592653589793 / 180.0, first.origin_m)
    places = [(at_ms, *transform.apply_point(pose.position_m)[:2]) for at_ms, pose in published]
    print(json.dumps([[at_ms, round(x, 2), round(y, 2)] for at_ms, x, y in places]))
    del tokens
    await mesh.close()


async def _publish(mesh: Mesh, flight: LargeFlight, flown_s: float, first: str, ended: Ended) -> list[tuple[float, Pose]]:
    """Publish until the input ends; the first drone's poses with the times, ms UTC."""
    published = []
    begin_ns = time.time_ns() - round(flown_s * 1e9)
    for sent in flight.sent(begin_ns, flown_s, flown_s + LONGEST_S, LIVE_BOOT):
        wait_s = (sent.at_ns - time.time_ns()) * 1e-9
        if wait_s > 0.0:
            await asyncio.sleep(wait_s)
            if ended.done():
                break
        mesh.publish(sent.key, sent.payload)
        if sent.drone == first and sent.key.endswith("/pose"):
            message = decode(sent.payload)
            assert isinstance(message, Pose)
            published.append((time.time_ns() * 1e-6, message))
    return published


if __name__ == "__main__":
    asyncio.run(main())
