"""A live swarm of real processes over Zenoh and MAVLink in real time: start, observation, evaluation, end.

The launcher is an operator's station in the network; only the launcher and the world process know the truth.
"""

from __future__ import annotations

import asyncio
import socket
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from radron.agent.config.drone import PeerMeshConfig
from radron.protocol.identity import Identity, load_identity
from radron.protocol.mesh.session import MeshConfig
from radron.sim.live.agents import Agents
from radron.sim.live.course import Course
from radron.sim.live.faults.playable import check_playable, late_drones, needs_relays
from radron.sim.live.faults.player import FaultPlayer
from radron.sim.live.operator import Operator
from radron.sim.live.places import Places
from radron.sim.live.processes import Child
from radron.sim.live.relays.launcher import RelayProcess
from radron.sim.live.report import LiveReport
from radron.sim.live.runfolder import Ports, RunFolder, drone_config, free_ports, live_mission
from radron.sim.live.view import View
from radron.sim.live.worldlink import Ready, WorldConfig
from radron.sim.live.worldprocess import WorldProcess
from radron.sim.result import Flight
from radron.sim.scenario import Scenario
from radron.sim.vehicle.px4.config import Address

READY_S = 180.0  # time for agents on this machine to get ready: 10 s, or minutes on a starved machine
_PAGE_ENDS_S = 2.0
_LOOK_S = 0.2  # between two attempts to reach a page that is not served yet
ELSEWHERE_READY_S = 300.0  # agents elsewhere may have to be started first


class Swarm(NamedTuple):
    """A live swarm whose processes have been started.

    agents: processes on this machine. faults, relays: None if there are none.
    """

    scenario: Scenario
    operator: Operator
    agents: Agents
    faults: FaultPlayer | None
    relays: RelayProcess | None


async def fly_live(
    scenario: Scenario,
    seed: int,
    folder: Path,
    elsewhere: Places | None,
    view: View,
    page: bool = False,
    ground_station: Address | None = None,
) -> tuple[Flight, LiveReport]:
    """Fly one mission with real agents, and return its scores and a report; all started processes are ended in any case.

    Args:
        scenario: the mission, the truth, and the faults.
        seed: seed of the world's random numbers; the flight itself also depends on real time.
        folder: for the files of the flight, see ``RunFolder``.
        elsewhere: addresses of agents that other programs start; None: they are started here.
        view: receives progress messages.
        page: serve the operator's page meanwhile.
        ground_station: address to which emulated vehicles send their ground-station links.

    Raises:
        LiveError: the swarm does not get ready, or the world fails.
        ConfigError: the scenario cannot be flown.
        ProtocolError: the network cannot be joined.
    """
    check_playable(scenario, here=elsewhere is None)
    count = len(scenario.mission.drones)
    places = elsewhere or (Places.relayed(count) if needs_relays(scenario.fault) else Places.here(count))
    async with live_swarm(scenario, seed, folder, places, view, page, ground_station) as swarm:
        course = Course(swarm.scenario, seed, swarm.operator, swarm.faults)
        return await course.fly(READY_S if places.agents_here else ELSEWHERE_READY_S)


@asynccontextmanager
async def live_swarm(
    scenario: Scenario,
    seed: int,
    folder: Path,
    places: Places,
    view: View,
    page: bool = False,
    ground_station: Address | None = None,
) -> AsyncIterator[Swarm]:
    """Start a world, its agents and an operator in their network, for the duration of the block.

    Arguments and errors are those of :func:`fly_live`. ``places``: addresses of all links.
    """
    files = RunFolder(folder, agents_here=places.agents_here)
    scenario = replace(scenario, mission=live_mission(scenario, seed))
    files.write_mission(scenario.mission)
    drones = [drone.id for drone in scenario.mission.drones]
    async with AsyncExitStack() as stack:
        view.say("starting the world")
        config = WorldConfig(
            scenario=scenario,
            seed=seed,
            vehicles="emulated" if places.ground_station is None else "mavlink",
            onboard=places.vehicles,
            ground_station=places.ground_station or ground_station,
            feed_host=places.bind,
            feed_ports=places.feed_ports,
            vision_ports=places.vision_ports,
            sightings_ports=places.sightings_ports,
            calibrations=tuple(str(files.calibration(drone)) for drone in drones),
        )
        world = await WorldProcess.start(config, files.world_file)
        stack.push_async_callback(world.stop)
        relays: RelayProcess | None = None
        if places.mesh_relays or places.mavlink_relays:
            relays = await RelayProcess.start(places.relay_plan(seed, drones))
            stack.push_async_callback(relays.stop)
        identity = _identity(places, files, drones, view)
        agents = Agents(files, drones if places.agents_here else ())
        stack.push_async_callback(agents.stop)
        if places.agents_here:
            _write_drones(scenario, files, places, world.ready)
            view.say(f"starting {len(drones)} agents; files and logs in {folder}")
            for drone in drones:
                if drone not in late_drones(scenario):
                    await agents.start(drone)
        else:
            view.say(f"the agents are expected at {', '.join(places.mesh)}")
        operator = Operator(scenario.mission, world, agents, view)
        await operator.join(MeshConfig(connect=places.mesh, identity=identity, drones=tuple(drones)), stack)
        if page:
            serving, port = await _serve_page(files, places)
            stack.push_async_callback(serving.stop, _PAGE_ENDS_S)
            telling = asyncio.create_task(_tell_page(serving, port, files.page_token, view))
            stack.callback(telling.cancel)
        faults = FaultPlayer(scenario, seed, agents, relays, world, view, places) if scenario.fault else None
        if faults is not None:
            stack.push_async_callback(faults.close)
        yield Swarm(scenario, operator, agents, faults, relays)


async def _serve_page(files: RunFolder, places: Places) -> tuple[Child, int]:
    """Serve the operator's page, in a process of its own; return the process and its port."""
    (port,) = free_ports(1, socket.SOCK_STREAM)
    links = [word for endpoint in places.mesh for word in ("--connect", endpoint)]
    identity = ["--identity", str((places.operator or files.page).resolve())] if places.encrypted else ["--insecure"]
    mission = str(files.mission_file.resolve())
    files.page_token.unlink(missing_ok=True)  # of an earlier flight in this folder
    token = ["--token-file", str(files.page_token.resolve())]
    command = [sys.executable, "-m", "radron.station", "serve", mission, *links, *identity, "--port", str(port), *token]
    page = await Child.start("page", command, log=files.folder / "page.log", folder=files.folder)
    return page, port


async def _tell_page(page: Child, port: int, token: Path, view: View) -> None:
    """Report the page's address with its token, as soon as it can be opened."""
    while page.exit_code is None:
        try:
            _, writer = await asyncio.open_connection("127.0.0.1", port)
        except OSError:
            await asyncio.sleep(_LOOK_S)
        else:
            writer.close()
            view.say(f"the operator's page: http://localhost:{port}/?token={token.read_text().strip()}")
            return
    view.say(f"the operator's page has ended: {page.last_line()}")


def _identity(places: Places, files: RunFolder, drones: Sequence[str], view: View) -> Identity | None:
    """Return the operator's certificate; by default, make certificates for all members."""
    if not places.encrypted:
        view.say("links between the agents are NOT encrypted: their endpoints are tcp/...")
        return None
    if places.operator is None:
        files.make_identities(drones)
    view.say("links between the agents are encrypted (TLS; certificates of this flight only)")
    return load_identity(places.operator or files.operator)


def _write_drones(scenario: Scenario, files: RunFolder, places: Places, feeds: Ready) -> None:
    """Write the drone files of all agents on this machine."""
    drones = [drone.id for drone in scenario.mission.drones]
    nowhere = (0,) * len(drones)
    ports = zip(
        (port for _, port in places.onboard),
        feeds.feed_ports or nowhere,
        feeds.vision_ports or nowhere,
        feeds.sightings_ports or nowhere,
        strict=True,
    )
    for drone, links in zip(drones, ports, strict=True):
        # Gossip would let the agents dial each other directly, past the relays.
        mesh = PeerMeshConfig(
            endpoints=places.endpoints(drones, drone),
            gossip=not places.mesh_relays,
            identity=files.identity(drone).name if places.encrypted else None,
            insecure=not places.encrypted,
        )
        files.write_drone(drone_config(scenario, drone, files.calibration(drone).is_dir(), Ports(*links), mesh))
