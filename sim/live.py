"""The swarm as real processes, over real Zenoh and real MAVLink, in real time: starts it, watches it, judges it, ends it.

The launcher is an operator's station in the mesh; it and the world process are the only ones that know the truth.
"""

from __future__ import annotations

import asyncio
import socket
import sysconfig
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from agent.config import MissionConfig
from protocol.session import MeshConfig
from sim.course import Course
from sim.livereport import LiveReport
from sim.liveview import View
from sim.processes import Child
from sim.result import Flight
from sim.runfolder import LOCAL, Ports, RunFolder, drone_config, free_ports, live_mission
from sim.scenario import Scenario
from sim.vehicle.px4.config import Address
from sim.worldlink import Ready, WorldConfig
from sim.worldprocess import WorldProcess

READY_S = 60.0  # in which agents on this machine are ready
ELSEWHERE_READY_S = 300.0  # others may have to be started first
STOP_S = 3.0  # an agent ends in 2 s
FIRST_FEED_PORT, FIRST_VISION_PORT, FIRST_SIGHTINGS_PORT = 5600, 5700, 5800
MAVLINK_PORT, GROUND_STATION_PORT = 14540, 14550


@dataclass(frozen=True, slots=True)
class Places:
    """Where a swarm's links are.

    onboard: where vehicle 1, 2, ... sends its MAVLink. mesh: the agents' endpoints. bind, feed_ports, vision_ports,
    sightings_ports: where the feeds of cameras and other sensors listen; empty: at free ports. ground_station: where vehicles
    that are not emulated are listened to; none: they are emulated.
    """

    onboard: tuple[Address, ...]
    mesh: tuple[str, ...]
    bind: str
    feed_ports: tuple[int, ...] = ()
    vision_ports: tuple[int, ...] = ()
    sightings_ports: tuple[int, ...] = ()
    ground_station: Address | None = None

    @classmethod
    def elsewhere(cls, hosts: Sequence[str], mesh: Sequence[str], bind: str, emulated: bool = True) -> Places:
        """Agents on one host each, in containers or on drones, with the ports that all of them have."""
        feeds, visions, sightings = (
            tuple(range(first, first + len(hosts))) for first in (FIRST_FEED_PORT, FIRST_VISION_PORT, FIRST_SIGHTINGS_PORT)
        )
        station = None if emulated else (bind, GROUND_STATION_PORT)
        return cls(tuple((host, MAVLINK_PORT) for host in hosts), tuple(mesh), bind, feeds, visions, sightings, station)


async def fly_live(
    scenario: Scenario, seed: int, folder: Path, elsewhere: Places | None, view: View
) -> tuple[Flight, LiveReport]:
    """Fly one mission with real agents; whatever happens, what was started is ended.

    Args:
        scenario: the mission and the truth it meets.
        seed: of the world's randomness; what follows from it differs from flight to flight as real time does.
        folder: for the files of the run, see ``RunFolder``.
        elsewhere: of agents that others start; none: they are started here.
        view: is told what happens.

    Raises:
        LiveError: the swarm does not get ready, or the world breaks down.
        ConfigError: the scenario cannot be flown.
        ProtocolError: the mesh cannot be joined.
    """
    files = RunFolder(folder, agents_here=elsewhere is None)
    scenario = replace(scenario, mission=live_mission(scenario, seed))
    files.write_mission(scenario.mission)
    places = elsewhere or _places_here(scenario.mission)
    async with AsyncExitStack() as stack:
        view.say("starting the world")
        config = WorldConfig(
            scenario=scenario,
            seed=seed,
            vehicles="emulated" if places.ground_station is None else "mavlink",
            onboard=places.onboard,
            ground_station=places.ground_station,
            feed_host=places.bind,
            feed_ports=places.feed_ports,
            vision_ports=places.vision_ports,
            sightings_ports=places.sightings_ports,
            calibrations=tuple(str(files.calibration(drone.id)) for drone in scenario.mission.drones),
        )
        world = await WorldProcess.start(config, files.world_file)
        stack.push_async_callback(world.stop)
        agents: list[Child] = []
        if elsewhere is None:
            view.say(f"starting {len(places.onboard)} agents; files and logs in {folder}")
            stack.push_async_callback(_stop_all, agents)
            await _start_agents(scenario, files, places, world.ready, agents)
        else:
            view.say(f"the agents are expected at {', '.join(places.mesh)}")
        course = Course(scenario, seed, world, agents, view)
        await course.join(MeshConfig(connect=places.mesh), stack)
        return await course.fly(READY_S if elsewhere is None else ELSEWHERE_READY_S)


def _places_here(mission: MissionConfig) -> Places:
    """On this machine, at ports that are free."""
    count = len(mission.drones)
    onboard = tuple((LOCAL, port) for port in free_ports(count, socket.SOCK_DGRAM))
    return Places(onboard, tuple(f"tcp/{LOCAL}:{port}" for port in free_ports(count, socket.SOCK_STREAM)), LOCAL)


async def _start_agents(scenario: Scenario, files: RunFolder, places: Places, feeds: Ready, agents: list[Child]) -> None:
    """Start all agents of the mission on this machine; adds each to ``agents`` as it comes."""
    drones = [drone.id for drone in scenario.mission.drones]
    mesh = dict(zip(drones, places.mesh, strict=True))
    nowhere = (0,) * len(drones)
    ports = zip(
        (port for _, port in places.onboard),
        feeds.feed_ports or nowhere,
        feeds.vision_ports or nowhere,
        feeds.sightings_ports or nowhere,
        strict=True,
    )
    program = Path(sysconfig.get_path("scripts")) / "radron-agent"
    for drone, links in zip(drones, ports, strict=True):
        files.write_drone(drone_config(scenario, drone, files.calibration(drone).is_dir(), Ports(*links), mesh))
        command = [str(program), "run", "--config", str(files.drone_file(drone))]
        agents.append(await Child.start(drone, command, log=files.log_file(drone)))


async def _stop_all(agents: list[Child]) -> None:
    await asyncio.gather(*(agent.stop(STOP_S) for agent in agents))
