"""The world of a live flight, a process in real time: vehicles, cameras, source. ``python -m radron.sim.live.world CONFIG``.

The launcher reads the truth from the standard output, and ends the world by closing its standard input.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec import convert, to_builtins

from radron.agent.config.drone import DroneConfig
from radron.agent.errors import RadronError
from radron.sim.geometry import Array
from radron.sim.live.crew import Guidance, crew_parameters
from radron.sim.live.feed import ByteServer, FeedServer, LineServer
from radron.sim.live.vehicles import Vehicles
from radron.sim.live.worldlink import Order, Ready, Truth, WorldConfig, pack, read_order
from radron.sim.scoring.recorder import MAX_START_S
from radron.sim.vehicle.multirotor import Multirotors
from radron.sim.vehicle.px4.config import Datum, Px4Config
from radron.sim.vehicle.px4.fleet import Px4Fleet
from radron.sim.vehicle.px4.ground_station import GroundStation
from radron.sim.world.cameras import Cameras, Motion
from radron.sim.world.launch import launch_places
from radron.sim.world.localization import Localization
from radron.sim.world.movingframes import MovingFrames
from radron.sim.world.sightings import Sightings
from radron.sim.world.slam import Slam
from radron.sim.world.sources import Source, Sources
from radron.sim.world.streams import Streams, streams
from radron.sim.world.terrain import Terrain
from radron.sim.world.walls import Walls

STEP_S = 0.01
STEP_NS = 10_000_000
TRUTH_STEPS = 5  # the launcher samples at 20 Hz, like lockstep
EXPOSE_STEPS = 10  # a camera is exposed for 0.1 s at the pose in the middle
READ_STEPS = 20  # cameras are read out at 5 Hz
POSE_STEPS = 3  # SLAM poses at 33 Hz
ALIVE_STEPS = 50  # between keep-alive lines of sensors without data
CATCH_UP_STEPS = 10  # largest number of steps at once when the world is behind; then the links are served
SLIP_S = 0.3  # a world further behind has stood still: it continues from there under the present time
_BACKLOG_BYTES = 1 << 20  # of truths that the launcher has not read


class World:
    """The simulated world of a live flight: vehicles, cameras and sources, advanced in real time.

    Equal seeds give the random streams of a flight in lockstep (faster than real time).
    """

    def __init__(self, config: WorldConfig) -> None:
        self._config = config
        scenario, mission = config.scenario, config.scenario.mission
        random = streams(config.seed, len(mission.drones))
        self._began_ns = time.time_ns()
        position = launch_places(scenario.start, mission, random.start)
        self._vehicles, self._motion, slam = _vehicles(config, position, random)
        guided = [Guidance.of(scenario.localization.vehicles.get(drone.id)).vision for drone in mission.drones]
        self._slam = slam
        self._slam_feeds = [LineServer() if sees else None for sees in guided] if slam is not None else []
        self._sightings: Sightings | None = None
        if scenario.sightings is not None:
            walls = Walls(scenario.walls) if scenario.walls else None
            names = [drone.id for drone in mission.drones]
            self._sightings = Sightings(scenario.sightings, names, walls, STEP_S, random.sightings)
        self._sighting_feeds = [LineServer() for _ in mission.drones if self._sightings is not None]
        self._cameras: Cameras | None = None
        self._sources = Sources(scenario, MAX_START_S + scenario.end.longest_s(mission), random)
        if scenario.measured:
            drones = [DroneConfig(id=drone.id) for drone in mission.drones]
            self._cameras = Cameras(scenario, self._sources.nuclides, drones, random, self._began_ns)
        self._feeds = [FeedServer() for _ in mission.drones if self._cameras is not None]
        self._steps = 0
        self._went_s: float | None = None  # start of the mission
        self._late_s = 0.0
        self._dropped = 0
        self._dead_cameras: set[int] = set()

    async def start(self) -> Ready:
        """Open the links and the sensor feeds, and write the cameras' calibrations."""
        config = self._config
        if self._cameras is not None and config.calibrations and config.scenario.camera.calibration_spread > 0.0:
            self._cameras.write_calibrations([Path(folder) for folder in config.calibrations])
        feeds = await self._listen(self._feeds, config.feed_ports)
        visions = await self._listen(self._slam_feeds, config.vision_ports)
        sightings = await self._listen(self._sighting_feeds, config.sightings_ports)
        await self._vehicles.start()
        return Ready(feeds, visions, sightings)

    async def _listen(self, feeds: Sequence[ByteServer | None], ports: Sequence[int]) -> tuple[int, ...]:
        """Open feeds at these ports, or at free ones; return the ports, 0 for none."""
        asked = ports or (0,) * len(feeds)
        host = self._config.feed_host
        return tuple([0 if feed is None else await feed.start(host, port) for feed, port in zip(feeds, asked, strict=False)])

    async def run(self, out: asyncio.WriteTransport, orders: asyncio.StreamReader) -> None:
        """Simulate in real time until the stream of the launcher's orders ends. ``out``: pipe to the launcher, for the truth."""
        obeying = asyncio.create_task(self._obey(orders))
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        self._began_ns = time.time_ns()
        while not obeying.done():
            behind_s = loop.time() - began_s - self._steps * STEP_S
            self._late_s = max(self._late_s, behind_s)
            if behind_s > SLIP_S:
                # A starved machine might never catch up, and no agent uses a readout that is seconds old. And setpoints
                # arrive in real time: during a catch-up they are too rare, and the autopilots' failsafes begin.
                began_s += behind_s
                self._began_ns += int(behind_s * 1e9)
                behind_s = 0.0
            for _ in range(min(CATCH_UP_STEPS, int(behind_s / STEP_S) + 1)):
                self._step(out)
            await asyncio.sleep(max(0.0, began_s + self._steps * STEP_S - loop.time()))

    async def close(self) -> None:
        """Close all links and feeds."""
        self._vehicles.close()
        for feed in (*self._feeds, *self._slam_feeds, *self._sighting_feeds):
            if feed is not None:
                await feed.close()

    async def _obey(self, orders: asyncio.StreamReader) -> None:
        while line := await orders.readline():
            order, drone, fault = read_order(line)
            match order:
                case Order.GO:
                    self._went_s = self._steps * STEP_S
                    self._vehicles.begin()
                case Order.CAMERAS_OFF:
                    self._cameras = None
                case Order.SATELLITES_OFF:
                    self._vehicles.switch_satellites(drone, False)
                case Order.SATELLITES_ON:
                    self._vehicles.switch_satellites(drone, True)
                case Order.CAMERA_OFF:
                    self._dead_cameras.add(drone)
                case Order.CAMERA_ON:
                    self._dead_cameras.discard(drone)
                case Order.PILOT_MANUAL | Order.PILOT_HOLD | Order.PILOT_RETURN | Order.PILOT_LAND:
                    self._vehicles.take_over(drone, order.removeprefix("pilot "))
                case Order.BREAK if fault is not None:
                    self._vehicles.begin_fault(drone, fault)
                case Order.MEND if fault is not None:
                    self._vehicles.end_fault(drone, fault)

    def _sources_now(self) -> tuple[Source, ...]:
        """Return the sources. They appear at the start of the mission: as in lockstep the agents learn hardly anything
        before, however long they take to get ready.
        """
        return () if self._went_s is None else self._sources.at(self._steps * STEP_S - self._went_s)

    def _step(self, out: asyncio.WriteTransport) -> None:
        self._expose()
        self._see()
        self._vehicles.step()
        self._steps += 1
        if self._steps % TRUTH_STEPS == 0:
            self._tell(out)

    @property
    def _now_ns(self) -> int:
        return self._began_ns + self._steps * STEP_NS

    def _see(self) -> None:
        """Send SLAM poses and relative observations."""
        now_ns = self._now_ns
        if self._slam is not None and self._steps % POSE_STEPS == 0:
            for drone, slam in enumerate(self._slam_feeds):
                if slam is not None and slam.clients:
                    slam.send([self._slam.pose(drone, now_ns)])
        if self._sightings is None:
            return
        if self._sightings.due(self._steps):
            attitudes = [self._motion.quaternion(drone) for drone in range(len(self._sighting_feeds))]
            self._sightings.look(now_ns, self._motion.position_m, attitudes)
        for drone, seen in self._sightings.take(now_ns):
            self._sighting_feeds[drone].send(seen)
        if self._steps % ALIVE_STEPS == 0:
            for feed in self._sighting_feeds:
                feed.send([])

    def _expose(self) -> None:
        if self._cameras is None:
            return
        now_ns, half_ns = self._now_ns, EXPOSE_STEPS * STEP_NS // 2
        for drone, feed in enumerate(self._feeds):
            step = self._steps - drone * READ_STEPS // len(self._feeds)  # the cameras of a swarm are not synchronised
            if step > 0 and step % EXPOSE_STEPS == EXPOSE_STEPS // 2:
                self._cameras.expose(drone, now_ns - half_ns, now_ns + half_ns, self._motion, self._sources_now())
            if step > 0 and step % READ_STEPS == 0:
                readout = self._cameras.read_out(drone)
                if drone not in self._dead_cameras:
                    feed.send(readout)

    def _tell(self, out: asyncio.WriteTransport) -> None:
        """Send the truth; a launcher that does not read it must not delay the world."""
        if out.get_write_buffer_size() > _BACKLOG_BYTES:
            self._dropped += 1
            return
        out.write(
            pack(
                Truth(
                    time_s=self._steps * STEP_S,
                    position_m=tuple(map(tuple, self._motion.position_m.tolist())),
                    velocity_mps=tuple(map(tuple, self._motion.velocity_mps.tolist())),
                    sources=self._sources_now(),
                    vehicles=tuple(self._vehicles.reports()),
                    late_s=self._late_s,
                    dropped=self._dropped,
                    stamp_ns=self._now_ns,
                    attitude=tuple(map(self._motion.quaternion, range(len(self._motion.position_m)))),
                )
            )
        )
        self._late_s, self._dropped = 0.0, 0


class _WorldVehicles(NamedTuple):
    """The vehicles, their observable motion, and the SLAMs of the emulated ones."""

    vehicles: Vehicles
    motion: Motion
    slam: Slam | None = None


def _vehicles(config: WorldConfig, position: Array, random: Streams) -> _WorldVehicles:
    """The vehicles at their launch places (N, 3)."""
    scenario, mission = config.scenario, config.scenario.mission
    if config.vehicles == "mavlink":
        assert config.ground_station is not None
        others = GroundStation(position, config.ground_station)
        return _WorldVehicles(others, others)
    count = len(position)
    truth = scenario.localization
    error = Localization(truth, count, STEP_S, random.localization)
    layout = [(drone.origin_m, drone.yaw_deg) for drone in mission.drones]
    frames = MovingFrames(truth, [drone.id for drone in mission.drones], layout, mission.datum, STEP_S, random)
    # A live agent records its position at the start as its launch place, which would cancel a constant bias of its positions.
    # The bias therefore becomes an error of the launch place; likewise for a frame that begins beside it.
    beside = np.array([frame - drone.origin_m for frame, drone in zip(frames.begun_m, mission.drones, strict=True)])
    terrain = Terrain(scenario.terrain)
    put_down = terrain.on_ground(position - error.position_bias_m + beside * (1.0, 1.0, 0.0))
    motion = Multirotors(scenario.vehicle, put_down, np.zeros(count), STEP_S, random.vehicle)
    fleet = Px4Fleet(
        [
            Px4Config(
                onboard=onboard,
                ground_station=config.ground_station,
                parameters=crew_parameters(mission, place, Guidance.of(truth.vehicles.get(drone.id))),
            )
            for drone, onboard, place in zip(mission.drones, config.onboard, position.tolist(), strict=True)
        ],
        motion,
        error,
        STEP_S,
        random.radio,  # the radio is real; its stream is used for the vehicles' other random numbers
        datum=Datum() if mission.datum is None else convert(to_builtins(mission.datum), Datum),
        frame_yaw_rad=np.radians([drone.yaw_deg for drone in mission.drones]).tolist(),
        localized=frames if frames.moving else None,
        terrain=terrain,
    )
    return _WorldVehicles(fleet, motion, Slam(motion, error, frames))


async def _live(config: WorldConfig) -> None:
    loop = asyncio.get_running_loop()
    truths, _ = await loop.connect_write_pipe(asyncio.BaseProtocol, os.fdopen(os.dup(1), "wb"))
    os.dup2(2, 1)  # prints of libraries must not reach the truth
    orders = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(orders), sys.stdin)
    signal.signal(signal.SIGTERM, lambda *_: loop.call_soon_threadsafe(orders.feed_eof))
    world = World(config)
    try:
        truths.write(pack(await world.start()))
        await world.run(truths, orders)
    finally:
        await world.close()
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it is ending already, and has yet to report the reason
        truths.abort()


def main() -> None:
    """Run the world process with a configuration file."""
    config = msgspec.json.decode(Path(sys.argv[1]).read_bytes(), type=WorldConfig)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # handled by the launcher
    try:
        asyncio.run(_live(config))
    except (RadronError, OSError) as error:
        sys.exit(f"radron-sim: the world: {error}")
    os._exit(0)  # everything is closed; the interpreter would take another second to unload the compiled code


if __name__ == "__main__":
    main()
