"""Files of a live flight: the mission, a drone file and a folder for each agent, and the world's configuration."""

from __future__ import annotations

import random
import shutil
import socket
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from radron.agent.config.drone import (
    DroneConfig,
    PeerMeshConfig,
    RecorderConfig,
    SightingsConfig,
    VehicleConfig,
    VisionConfig,
)
from radron.agent.config.loading import without_files
from radron.agent.config.mission import MissionConfig
from radron.agent.config.responses import shipped_tables
from radron.agent.config.writing import as_toml
from radron.protocol.identity import Role
from radron.protocol.issuing import throwaway
from radron.sim.live.crew import Guidance
from radron.sim.runfile import make_folder, write_text
from radron.sim.scenario import Scenario
from radron.sim.world.launch import launch_places
from radron.sim.world.owncameras import drone_file
from radron.sim.world.streams import streams

_PORTS = range(20_000, 32_000)  # below the range from which the kernel assigns ports
LOCAL = "127.0.0.1"
OPERATOR = "operator"  # the name in its certificate
PAGE = "page"  # name in the page's certificate


class RunFolder:
    """The folder of a live flight.

    ``agents/``: all files of the agents: ``mission.toml``; for each ``{drone}/`` with ``drone.toml``, ``agent.log``,
    ``calibration/``, ``flight/`` (the recordings), ``identity/`` and ``state/``. Unknown to the agents: ``operator/`` and
    ``page/``, the certificates of the operator and the operator's page, ``page.token``, the page's token, and ``world.json``,
    the truth.
    """

    def __init__(self, folder: Path, agents_here: bool) -> None:
        """``agents_here``: the agents run on this machine; their files of an earlier flight are removed."""
        self.folder = folder
        self.mission_file = folder / "agents" / "mission.toml"
        self.world_file = folder / "world.json"
        self.operator = folder / "operator"
        self.page = folder / "page"
        self.page_token = folder / "page.token"
        if agents_here:
            shutil.rmtree(folder / "agents", ignore_errors=True)
        make_folder(folder / "agents")

    def agent(self, drone: str) -> Path:
        """Return the folder of a drone's agent."""
        return self.folder / "agents" / drone

    def drone_file(self, drone: str) -> Path:
        """Return the path of a drone's configuration file."""
        return self.agent(drone) / "drone.toml"

    def log_file(self, drone: str) -> Path:
        """Return the path of the file with the standard error of a drone's agent."""
        return self.agent(drone) / "agent.log"

    def calibration(self, drone: str) -> Path:
        """Return the folder with the calibration files of a drone's camera."""
        return self.agent(drone) / "calibration"

    def identity(self, drone: str) -> Path:
        """Return the folder with the certificate and the key of a drone's agent."""
        return self.agent(drone) / "identity"

    def make_identities(self, drones: Sequence[str]) -> None:
        """Make certificates that are valid for this flight only; the key of their authority is not kept."""
        members = {self.identity(drone): (drone, Role.DRONE) for drone in drones}
        stations = {self.operator: (OPERATOR, Role.OPERATOR), self.page: (PAGE, Role.OPERATOR)}
        throwaway({**members, **stations}, time.time_ns())

    def write_mission(self, mission: MissionConfig) -> None:
        """Write the mission file, its elevation grid and its tables of response; the mission's id is unchanged."""
        ground = mission.ground
        if ground.grid is not None and ground.grid_data is not None:
            (self.mission_file.parent / ground.grid).write_bytes(ground.grid_data)
        for response in mission.responses:
            if response.name not in shipped_tables():
                (self.mission_file.parent / response.name).write_bytes(response.content)
        write_text(self.mission_file, as_toml(without_files(mission)))

    def write_drone(self, drone: DroneConfig) -> None:
        """Write a drone's configuration file into its folder."""
        self.agent(drone.id).mkdir(exist_ok=True)
        write_text(self.drone_file(drone.id), as_toml(drone))


def live_mission(scenario: Scenario, seed: int) -> MissionConfig:
    """Return the scenario's mission for a live swarm, in which each drone's local frame begins at its true launch place."""
    mission = scenario.mission
    places = launch_places(scenario.start, mission, streams(seed, len(mission.drones)).start).tolist()
    drones = tuple(
        replace(drone, origin_m=(x, y, drone.origin_m[2])) for drone, (x, y, _) in zip(mission.drones, places, strict=True)
    )
    return replace(mission, drones=drones)


class Ports(NamedTuple):
    """Ports of a drone on this machine: onboard MAVLink link and sensor feeds; 0: no such sensor."""

    mavlink: int
    camera: int = 0
    vision: int = 0
    sightings: int = 0


def drone_config(scenario: Scenario, drone: str, calibrated: bool, ports: Ports, mesh: PeerMeshConfig) -> DroneConfig:
    """Return the configuration of a drone on this machine, with the true settings of vehicle and localisation.

    Args:
        scenario: of the flight.
        drone: id of the drone.
        calibrated: its camera has calibration files.
        ports: of its links.
        mesh: the addresses at which it reaches the other drones.
    """
    error = scenario.localization
    guidance = Guidance.of(error.vehicles.get(drone))
    written = DroneConfig(
        id=drone,
        mission="../mission.toml",
        state="state",
        calibration="calibration" if calibrated else None,
        mesh=mesh,
        vehicle=VehicleConfig(
            address=f"udpin://{LOCAL}:{ports.mavlink}",
            position_sigma_m=error.reported_horizontal_m,
            yaw_sigma_deg=error.reported_yaw_deg,
            gnss=guidance.gnss,
            response=scenario.response,
            vision=VisionConfig(address=f"{LOCAL}:{ports.vision}") if ports.vision else None,
        ),
        detector=scenario.detector_file(drone, f"{LOCAL}:{ports.camera}" if ports.camera else None),
        sightings=SightingsConfig(address=f"{LOCAL}:{ports.sightings}" if ports.sightings else None),
        recorder=RecorderConfig(folder="flight"),
    )
    return drone_file(written, scenario.cameras)


def free_ports(count: int, kind: socket.SocketKind) -> list[int]:
    """Return free ports of this machine, outside the range that the kernel assigns."""
    found: list[socket.socket] = []
    try:
        for port in random.sample(_PORTS, len(_PORTS)):
            if len(found) == count:
                break
            candidate = socket.socket(socket.AF_INET, kind)
            try:
                candidate.bind((LOCAL, port))
                found.append(candidate)
            except OSError:
                candidate.close()
        return [bound.getsockname()[1] for bound in found]
    finally:
        for bound in found:
            bound.close()
