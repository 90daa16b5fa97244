"""A drone of the mesh alone in its process: joins, publishes, and leaves when its input ends or says so."""

from __future__ import annotations

import argparse
import asyncio
import sys

from radron.protocol.keys import drone_key
from radron.protocol.mesh import link
from radron.protocol.mesh.session import Mesh, MeshConfig


async def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drone")
    parser.add_argument("listen")
    parser.add_argument("connect", nargs="*")
    parser.add_argument("--entries", type=int, default=0, help="cones to publish at once when the input says 'burst'")
    parser.add_argument("--pose-bytes", type=int, default=0, help="size of the poses; 0: none")
    parser.add_argument("--pose-hz", type=float, default=20.0)
    parser.add_argument("--lease-ms", type=int, default=0, help="0: as it is set in flight")
    arguments = parser.parse_args()
    if arguments.lease_ms:
        link._SETTINGS["transport/link/tx/lease"] = arguments.lease_ms
    config = MeshConfig(listen=arguments.listen, connect=tuple(arguments.connect))
    mesh = await Mesh.open(config, "s", arguments.drone, receive=lambda key, payload: None)
    print("joined", flush=True)
    asked = asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline)
    number = 0
    while not asked.done():
        await asyncio.sleep(1.0 / arguments.pose_hz)
        if arguments.pose_bytes:
            number += 1
            mesh.publish(drone_key("s", arguments.drone, "pose"), b"%d " % number + bytes(arguments.pose_bytes))
    if await asked == "burst\n":
        for i in range(arguments.entries):
            mesh.publish(drone_key("s", arguments.drone, "cone"), b"%d " % i + bytes(400))
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline)
    await mesh.close()


if __name__ == "__main__":
    asyncio.run(main())
