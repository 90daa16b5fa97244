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

from protocol.session import MeshConfig
from sim.course import Course
from sim.livereport import LiveReport
from sim.liveview import View
from sim.processes import Child
from sim.result import Flight
from sim.runfolder import LOCAL, RunFolder, drone_config, free_ports, live_mission
from sim.scenario import Scenario
from sim.worldlink import WorldConfig
from sim.worldprocess import WorldProcess

READY_S = 60.0  # in which agents on this machine are ready
ELSEWHERE_READY_S = 300.0  # others may have to be started first
STOP_S = 3.0  # an agent ends in 2 s
FIRST_FEED_PORT, MAVLINK_PORT = 5600, 14540


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """Agents that somebody else starts: in containers, or on drones.

    Vehicle i sends its MAVLink to ``hosts[i]``:14540, its camera's feed listens on ``bind``:5600+i; ``mesh``: agents' endpoints.
    """

    hosts: tuple[str, ...]
    mesh: tuple[str, ...]
    bind: str = "0.0.0.0"


async def fly_live(
    scenario: Scenario, seed: int, folder: Path, elsewhere: Elsewhere | None, view: View
) -> tuple[Flight, LiveReport]:
    """Fly one mission with real agents; whatever happens, what was started is ended.

    Args:
        scenario: the mission and the truth it meets.
        seed: of the world's randomness; what follows from it differs from flight to flight as real time does.
        folder: for the files of the run, see ``RunFolder``.
        elsewhere: agents that others start; none: they are started here.
        view: is told what happens.

    Raises:
        LiveError: the swarm does not get ready, or the world breaks down.
        ConfigError: the scenario cannot be flown.
        ProtocolError: the mesh cannot be joined.
    """
    files = RunFolder(folder)
    scenario = replace(scenario, mission=live_mission(scenario, seed))
    files.write_mission(scenario.mission)
    async with AsyncExitStack() as stack:
        agents: list[Child] = []
        if elsewhere is None:
            world, mesh = await _start_here(scenario, seed, files, agents, stack, view)
        else:
            view.say(f"starting the world; the agents are expected at {', '.join(elsewhere.mesh)}")
            feeds = tuple(range(FIRST_FEED_PORT, FIRST_FEED_PORT + len(elsewhere.hosts)))
            config = WorldConfig(
                scenario=scenario, seed=seed, onboard=tuple((host, MAVLINK_PORT) for host in elsewhere.hosts),
                feed_host=elsewhere.bind, feed_ports=feeds,
            )  # fmt: skip
            world, mesh = await WorldProcess.start(config, files.world_file), elsewhere.mesh
            stack.push_async_callback(world.stop)
        course = Course(scenario, seed, world, agents, view)
        await course.join(MeshConfig(connect=mesh), stack)
        return await course.fly(READY_S if elsewhere is None else ELSEWHERE_READY_S)


async def _start_here(
    scenario: Scenario, seed: int, files: RunFolder, agents: list[Child], stack: AsyncExitStack, view: View
) -> tuple[WorldProcess, tuple[str, ...]]:
    """World and agents on this machine, on ports that are free; returns the world and the agents' endpoints."""
    drones = [drone.id for drone in scenario.mission.drones]
    links = free_ports(len(drones), socket.SOCK_DGRAM)
    calibrated = scenario.source is not None and scenario.camera.calibration_spread > 0.0
    config = WorldConfig(
        scenario=scenario, seed=seed, onboard=tuple((LOCAL, port) for port in links), feed_host=LOCAL,
        calibrations=tuple(str(files.calibration(drone)) for drone in drones) if calibrated else (),
    )  # fmt: skip
    view.say("starting the world")
    world = await WorldProcess.start(config, files.world_file)
    stack.push_async_callback(world.stop)
    ports = free_ports(len(drones), socket.SOCK_STREAM)
    mesh = {drone: f"tcp/{LOCAL}:{port}" for drone, port in zip(drones, ports, strict=True)}
    view.say(f"starting {len(drones)} agents; files and logs in {files.folder}")
    feeds: Sequence[int | None] = world.feed_ports or (None,) * len(drones)
    for drone, link, feed in zip(drones, links, feeds, strict=True):
        files.write_drone(drone_config(scenario, drone, calibrated, link, feed, mesh))
    stack.push_async_callback(_stop_all, agents)
    program = Path(sysconfig.get_path("scripts")) / "radron-agent"
    for drone in drones:
        command = [str(program), "run", "--config", str(files.drone_file(drone))]
        agents.append(await Child.start(drone, command, log=files.log_file(drone)))
    return world, tuple(mesh.values())


async def _stop_all(agents: list[Child]) -> None:
    await asyncio.gather(*(agent.stop(STOP_S) for agent in agents))
