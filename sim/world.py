"""The world of a live flight, as a process of its own in real time: vehicles, cameras, source. ``python -m sim.world CONFIG``.

The launcher reads the truth from the standard output, and ends the world by closing its standard input.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections.abc import Sequence
from math import ceil, hypot
from pathlib import Path
from typing import Protocol

import msgspec
import numpy as np
from shapely import Polygon

from agent.config import DroneConfig, MissionConfig
from agent.errors import RadronError
from sim.cameras import Array, Cameras, Motion
from sim.feed import FeedServer
from sim.launch import launch_places
from sim.localization import Localization
from sim.recorder import LONGEST_START_S
from sim.source import source_path
from sim.streams import Streams, streams
from sim.vehicle.multirotor import Multirotors
from sim.vehicle.px4.config import Px4Config
from sim.vehicle.px4.fleet import Px4Fleet, VehicleReport
from sim.vehicle.px4.ground_station import GroundStation
from sim.worldlink import Order, Ready, Truth, WorldConfig, pack

STEP_S = 0.01
STEP_NS = 10_000_000
TRUTH_STEPS = 5  # the launcher samples at 20 Hz, as lockstep does
EXPOSE_STEPS = 10  # the geometry of a camera's exposure is that of the middle of 0.1 s
READ_STEPS = 20  # cameras hand over their hits at 5 Hz
CATCH_UP_STEPS = 10  # at once, where the world is behind; then the links get their turn
_FENCE_SPARE_M = 10.0  # the autopilot's own fence is a circle around its home, beyond the mission's
_BACKLOG_BYTES = 1 << 20  # of truths that the launcher has not taken


class Vehicles(Protocol):
    """Whoever flies the vehicles."""

    async def start(self) -> None:
        """Open the links on the running loop."""

    def step(self) -> None:
        """Advance by one step."""

    def reports(self) -> list[VehicleReport]:
        """What an observer sees of each, beside its motion."""

    def close(self) -> None:
        """Close the links."""


class World:
    """Everything that is, at one instant. Same seed, same random streams as in lockstep."""

    def __init__(self, config: WorldConfig) -> None:
        self._config = config
        scenario, mission = config.scenario, config.scenario.mission
        random = streams(config.seed, len(mission.drones))
        self._began_ns = time.time_ns()
        position = launch_places(scenario.start, mission, random.start)
        self._vehicles, self._motion = _vehicles(config, position, random)
        self._cameras: Cameras | None = None
        self._path = None
        if scenario.measured:
            drones = [DroneConfig(id=drone.id) for drone in mission.drones]
            self._cameras = Cameras(scenario, drones, random.cameras, self._began_ns)
        if scenario.source is not None:
            duration_s = LONGEST_START_S + scenario.end.longest_s(mission)
            self._path = source_path(scenario.source, Polygon(mission.area.polygon_m), duration_s, random.source)
        self._feeds = [FeedServer() for _ in mission.drones if self._cameras is not None]
        self._steps = 0
        self._went_s: float | None = None  # when the mission began
        self._late_s = 0.0
        self._dropped = 0

    async def start(self) -> Ready:
        """Open the links and the feeds, and write the cameras' calibrations."""
        config = self._config
        if self._cameras is not None and config.calibrations and config.scenario.camera.calibration_spread > 0.0:
            self._cameras.write_calibrations([Path(folder) for folder in config.calibrations])
        ports = config.feed_ports or (0,) * len(self._feeds)
        found = [await feed.start(config.feed_host, port) for feed, port in zip(self._feeds, ports, strict=False)]
        await self._vehicles.start()
        return Ready(tuple(found))

    async def run(self, out: asyncio.WriteTransport, orders: asyncio.StreamReader) -> None:
        """Go on in real time until the orders end."""
        obeying = asyncio.create_task(self._obey(orders))
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        self._began_ns = time.time_ns()
        while not obeying.done():
            behind_s = loop.time() - began_s - self._steps * STEP_S
            self._late_s = max(self._late_s, behind_s)
            for _ in range(min(CATCH_UP_STEPS, int(behind_s / STEP_S) + 1)):
                self._step(out)
            await asyncio.sleep(max(0.0, began_s + self._steps * STEP_S - loop.time()))

    async def close(self) -> None:
        """Close everything."""
        self._vehicles.close()
        for feed in self._feeds:
            await feed.close()

    async def _obey(self, orders: asyncio.StreamReader) -> None:
        while line := await orders.readline():
            match Order(line.decode().strip()):
                case Order.GO:
                    self._went_s = self._steps * STEP_S
                case Order.CAMERAS_OFF:
                    self._cameras = None

    def _source(self) -> tuple[float, float] | None:
        """Where the source is. It is brought when the mission begins: however long the agents take to get ready, they find out
        as little before as in lockstep.
        """
        if self._path is None or self._went_s is None:
            return None
        return self._path(self._steps * STEP_S - self._went_s)

    def _step(self, out: asyncio.WriteTransport) -> None:
        self._sense()
        self._vehicles.step()
        self._steps += 1
        if self._steps % TRUTH_STEPS == 0:
            self._tell(out)

    def _sense(self) -> None:
        if self._cameras is None:
            return
        now_ns, half_ns = self._began_ns + self._steps * STEP_NS, EXPOSE_STEPS * STEP_NS // 2
        for drone, feed in enumerate(self._feeds):
            step = self._steps - drone * READ_STEPS // len(self._feeds)  # nothing synchronises the cameras of a swarm
            if step > 0 and step % EXPOSE_STEPS == EXPOSE_STEPS // 2:
                self._cameras.expose(drone, now_ns - half_ns, now_ns + half_ns, self._motion, self._source())
            if step > 0 and step % READ_STEPS == 0:
                feed.send(self._cameras.read_out(drone))

    def _tell(self, out: asyncio.WriteTransport) -> None:
        """Send the truth; a launcher that does not take it must not hold up the world."""
        if out.get_write_buffer_size() > _BACKLOG_BYTES:
            self._dropped += 1
            return
        out.write(
            pack(
                Truth(
                    time_s=self._steps * STEP_S,
                    position_m=tuple(map(tuple, self._motion.position_m.tolist())),
                    velocity_mps=tuple(map(tuple, self._motion.velocity_mps.tolist())),
                    source_m=self._source(),
                    vehicles=tuple(self._vehicles.reports()),
                    late_s=self._late_s,
                    dropped=self._dropped,
                )
            )
        )
        self._late_s, self._dropped = 0.0, 0


def _vehicles(config: WorldConfig, position: Array, random: Streams) -> tuple[Vehicles, Motion]:
    """The vehicles at their launch places (N, 3), and what is to be seen of their motion."""
    scenario, mission = config.scenario, config.scenario.mission
    if config.vehicles == "mavlink":
        assert config.ground_station is not None
        others = GroundStation(position, config.ground_station)
        return others, others
    count = len(position)
    error = Localization(scenario.localization, count, STEP_S, random.localization)
    # A live agent takes where it stands at the start for its launch place, and a constant bias of its positions would be gone.
    # It stays as the error of the place where the vehicle was put down.
    motion = Multirotors(scenario.vehicle, position - error.position_bias_m, np.zeros(count), STEP_S, random.vehicle)
    fleet = Px4Fleet(
        [
            Px4Config(onboard=onboard, ground_station=config.ground_station, parameters=crew_parameters(mission, place))
            for onboard, place in zip(config.onboard, position.tolist(), strict=True)
        ],
        motion,
        error,
        STEP_S,
        random.radio,  # the radio is a real one; its stream is free for what else the vehicles draw
        frame_yaw_rad=np.radians([drone.yaw_deg for drone in mission.drones]).tolist(),
    )
    return fleet, motion


def crew_parameters(mission: MissionConfig, place: Sequence[float]) -> dict[str, float]:
    """What a crew sets in a PX4 before this mission, where it is launched from ``place``; the rest is as delivered."""
    area = mission.area
    farthest_m = max(hypot(x - place[0], y - place[1]) for x, y in area.polygon_m) + area.fence_margin_m
    return {
        "COM_OBL_RC_ACT": 3.0,  # return when the agent is gone
        "RTL_RETURN_ALT": min(10.0, 0.8 * area.ceiling_m),
        "RTL_DESCEND_ALT": min(10.0, 0.8 * area.ceiling_m),
        "GF_MAX_HOR_DIST": ceil(farthest_m + _FENCE_SPARE_M),
    }


async def _live(config: WorldConfig) -> None:
    loop = asyncio.get_running_loop()
    truths, _ = await loop.connect_write_pipe(asyncio.BaseProtocol, os.fdopen(os.dup(1), "wb"))
    os.dup2(2, 1)  # what anybody prints is no truth
    orders = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(orders), sys.stdin)
    loop.add_signal_handler(signal.SIGTERM, orders.feed_eof)
    world = World(config)
    try:
        truths.write(pack(await world.start()))
        await world.run(truths, orders)
    finally:
        await world.close()
        truths.abort()


def main() -> None:
    """Run the world of a configuration file."""
    config = msgspec.json.decode(Path(sys.argv[1]).read_bytes(), type=WorldConfig)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the launcher's affair
    try:
        asyncio.run(_live(config))
    except (RadronError, OSError) as error:
        sys.exit(f"radron-sim: the world: {error}")
    os._exit(0)  # all is closed; the interpreter takes another second to clear away the compiled code


if __name__ == "__main__":
    main()
