"""A live swarm of real processes over Zenoh and MAVLink in real time: start, observation, evaluation, end.

The launcher is an operator's station in the mesh; only it and the world process know the truth.
"""

from __future__ import annotations

import asyncio
import socket
import sysconfig
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from protocol.session import MeshConfig
from sim.live.course import Course
from sim.live.operator import Operator
from sim.live.processes import Child
from sim.live.report import LiveReport
from sim.live.runfolder import LOCAL, Ports, RunFolder, drone_config, free_ports, live_mission
from sim.live.view import View
from sim.live.worldlink import Ready, WorldConfig
from sim.live.worldprocess import WorldProcess
from sim.result import Flight
from sim.scenario import Scenario
from sim.vehicle.px4.config import Address

READY_S = 180.0  # time in which agents on this machine get ready: 10 s, or minutes where it is starved
ELSEWHERE_READY_S = 300.0  # agents elsewhere may have to be started first
STOP_S = 3.0  # an agent takes 2 s to end
FIRST_FEED_PORT, FIRST_VISION_PORT, FIRST_SIGHTINGS_PORT = 5600, 5700, 5800
MAVLINK_PORT, GROUND_STATION_PORT = 14540, 14550


@dataclass(frozen=True, slots=True)
class Places:
    """Addresses of a swarm's links.

    onboard: MAVLink address of vehicle 1, 2, ... mesh: the agents' endpoints. bind, feed_ports, vision_ports, sightings_ports:
    listening address of the feeds of cameras and other sensors; empty: free ports. ground_station: where to listen for vehicles
    that are not emulated; None: they are emulated. agents_here: they are started on this machine.
    """

    onboard: tuple[Address, ...]
    mesh: tuple[str, ...]
    bind: str
    feed_ports: tuple[int, ...] = ()
    vision_ports: tuple[int, ...] = ()
    sightings_ports: tuple[int, ...] = ()
    ground_station: Address | None = None
    agents_here: bool = False

    @classmethod
    def here(cls, count: int) -> Places:
        """Agents and emulated vehicles on this machine, at free ports."""
        return cls.with_vehicles(free_ports(count, socket.SOCK_DGRAM), None)

    @classmethod
    def with_vehicles(cls, ports: Sequence[int], ground_station: Address | None) -> Places:
        """Agents on this machine, each with its vehicle at one of these ports; with a ground station, the vehicles are flown
        elsewhere.
        """
        onboard = tuple((LOCAL, port) for port in ports)
        mesh = tuple(f"tcp/{LOCAL}:{port}" for port in free_ports(len(ports), socket.SOCK_STREAM))
        return cls(onboard, mesh, LOCAL, ground_station=ground_station, agents_here=True)

    @classmethod
    def elsewhere(cls, hosts: Sequence[str], mesh: Sequence[str], bind: str, emulated: bool = True) -> Places:
        """Agents on one host each, in containers or on drones, with the same ports."""
        feeds, visions, sightings = (
            tuple(range(first, first + len(hosts))) for first in (FIRST_FEED_PORT, FIRST_VISION_PORT, FIRST_SIGHTINGS_PORT)
        )
        station = None if emulated else (bind, GROUND_STATION_PORT)
        return cls(tuple((host, MAVLINK_PORT) for host in hosts), tuple(mesh), bind, feeds, visions, sightings, station)


class Swarm(NamedTuple):
    """A started swarm. agents: those on this machine, in the mission's order."""

    scenario: Scenario
    operator: Operator
    agents: tuple[Child, ...]


async def fly_live(
    scenario: Scenario, seed: int, folder: Path, elsewhere: Places | None, view: View
) -> tuple[Flight, LiveReport]:
    """Fly one mission with real agents; everything that was started is ended, whatever happens.

    Args:
        scenario: the mission and the truth.
        seed: of the world's random numbers; the flight itself also depends on real time.
        folder: for the files of the run, see ``RunFolder``.
        elsewhere: addresses of agents that are started by others; None: they are started here.
        view: receives progress messages.

    Raises:
        LiveError: the swarm does not get ready, or the world fails.
        ConfigError: the scenario cannot be flown.
        ProtocolError: the mesh cannot be joined.
    """
    places = elsewhere or Places.here(len(scenario.mission.drones))
    async with live_swarm(scenario, seed, folder, places, view) as swarm:
        course = Course(swarm.scenario, seed, swarm.operator)
        return await course.fly(READY_S if places.agents_here else ELSEWHERE_READY_S)


@asynccontextmanager
async def live_swarm(scenario: Scenario, seed: int, folder: Path, places: Places, view: View) -> AsyncIterator[Swarm]:
    """A world, its agents and an operator in their mesh, for as long as the block lasts; arguments and errors of ``fly_live``."""
    files = RunFolder(folder, agents_here=places.agents_here)
    scenario = replace(scenario, mission=live_mission(scenario, seed))
    files.write_mission(scenario.mission)
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
        if places.agents_here:
            view.say(f"starting {len(places.onboard)} agents; files and logs in {folder}")
            stack.push_async_callback(_stop_all, agents)
            await _start_agents(scenario, files, places, world.ready, agents)
        else:
            view.say(f"the agents are expected at {', '.join(places.mesh)}")
        operator = Operator(scenario.mission, world, agents, view)
        await operator.join(MeshConfig(connect=places.mesh), stack)
        yield Swarm(scenario, operator, tuple(agents))


async def _start_agents(scenario: Scenario, files: RunFolder, places: Places, feeds: Ready, agents: list[Child]) -> None:
    """Start all agents of the mission on this machine; adds each to ``agents`` once it is started."""
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
        command = [str(program), "run", "--verbose", "--config", str(files.drone_file(drone))]
        agents.append(await Child.start(drone, command, log=files.log_file(drone)))


async def _stop_all(agents: list[Child]) -> None:
    await asyncio.gather(*(agent.stop(STOP_S) for agent in agents))
