"""The files of a drone's config partition, made from the fleet file; on board ``radron-provision`` uses them.

hostname               the computer's name
drone.toml             the drone file
mission/               the mission file, its elevation grid and its map of buildings
calibration/           the camera's a.txt, b.txt, c.txt, t.txt and drift.txt, if there are any
identity/              certificate, key, the swarm's authority
authorized_keys        public keys with a login
network/*.network      for systemd-networkd
chrony/                time servers, and the network of allowed time clients
firewall.nft           allowed incoming traffic
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePosixPath

import msgspec

from radron.agent.config.drone import DroneConfig, PeerMeshConfig, RecorderConfig, VehicleConfig
from radron.agent.config.loading import read_toml
from radron.agent.config.writing import as_toml
from radron.agent.detector.files.calibration import calibration_files, load_flight_calibration
from radron.deploy.fleet.config import FleetDrone
from radron.deploy.fleet.loading import Fleet, autopilot_of

# On board: the credentials from systemd, and the folder on the data partition.
CREDENTIALS, DATA = "/run/credentials/radron-agent.service", "/var/lib/radron"
UPDATES = "/var/lib/radron-update"
_CALIBRATION = PurePosixPath("calibration")


def files_of(fleet: Fleet, drone: FleetDrone) -> dict[PurePosixPath, bytes]:
    """Return all configuration files of a drone, except its certificate and key, by their paths on the configuration partition.

    Raises:
        ConfigError: the elevation grid or the map of buildings cannot be found on board.
        DetectorError: no valid calibration of the camera.
        OSError: a file cannot be read.
    """
    texts = {
        "hostname": f"{fleet.mission.swarm}-{drone.id}\n",
        "drone.toml": as_toml(drone_file(fleet, drone)),
        "authorized_keys": "".join(f"{key.strip()}\n" for key in fleet.config.ssh_keys),
        "network/10-mesh.network": _network(fleet, drone),
        "chrony/fleet.sources": _time_sources(fleet, drone),
        "chrony/fleet.conf": f"allow {fleet.subnet}\n",
        "firewall.nft": _firewall(fleet, drone),
    }
    files = {PurePosixPath(name): text.encode() for name, text in texts.items()}
    files |= _mission(fleet)
    calibration = fleet.calibration(drone)
    if calibration is not None:
        load_flight_calibration(calibration)
        names = {file: file.name if calibration.is_dir() else "" for file in calibration_files(calibration)}
        files |= {_CALIBRATION / name: file.read_bytes() for file, name in names.items()}
    return files


def write_files(folder: Path, files: Mapping[PurePosixPath, bytes]) -> None:
    """Write files, given by their relative paths, into a folder."""
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def drone_file(fleet: Fleet, drone: FleetDrone) -> DroneConfig:
    """Return the content of a drone's own configuration file, ``drone.toml``, made from the fleet file."""
    port = fleet.config.network.port
    endpoints = {one.id: f"tls/{one.address}:{port}" for one in fleet.config.drones}
    return DroneConfig(
        id=drone.id,
        mission=f"mission/{fleet.mission_file.name}",
        state=f"{DATA}/state",
        updates=UPDATES,
        camera_rpy_deg=drone.camera_rpy_deg,
        calibration=None if drone.calibration is None else str(_CALIBRATION),
        mesh=PeerMeshConfig(endpoints=endpoints, identity=CREDENTIALS, others=fleet.config.others),
        vehicle=_watching(drone),
        detector=drone.detector,
        sightings=drone.sightings,
        recorder=RecorderConfig(folder=f"{DATA}/flights", limit_mb=fleet.config.records_mb),
    )


def _watching(drone: FleetDrone) -> VehicleConfig:
    """Return the vehicle's settings, with a report of the parameters that the fleet file checks, too."""
    names = dict.fromkeys((*drone.vehicle.parameters, *drone.px4.parameters))
    return msgspec.structs.replace(drone.vehicle, parameters=tuple(names))


def _mission(fleet: Fleet) -> dict[PurePosixPath, bytes]:
    """Return the unchanged mission file and its named files: their content is the mission's identity."""
    file, folder = fleet.mission_file, PurePosixPath("mission")
    found = {folder / file.name: file.read_bytes()}
    # The loaded mission holds the buildings themselves, and no longer the name of their file.
    names = (fleet.mission.ground.grid, read_toml(file).get("buildings", {}).get("file"))
    return found | {folder / name: (file.parent / name).read_bytes() for name in names if name is not None}


def _network(fleet: Fleet, drone: FleetDrone) -> str:
    network = fleet.config.network
    gateway = "" if network.gateway is None else f"Gateway={network.gateway}\n"
    return (
        f"[Match]\nName={network.interface}\n\n"
        "[Link]\nRequiredForOnline=no\n\n"
        f"[Network]\nAddress={drone.address}/{fleet.subnet.prefixlen}\n{gateway}"
        # The mesh listens at the address before the radio is up.
        "ConfigureWithoutCarrier=yes\nLinkLocalAddressing=no\nIPv6AcceptRA=no\nDHCP=no\n"
    )


def _time_sources(fleet: Fleet, drone: FleetDrone) -> str:
    others = [one.address for one in fleet.config.drones if one.id != drone.id]
    lines = [f"server {server} iburst prefer" for server in fleet.config.network.ntp]
    lines += [f"server {address} iburst minpoll 2 maxpoll 5" for address in others]
    return "".join(f"{line}\n" for line in lines)


def _firewall(fleet: Fleet, drone: FleetDrone) -> str:
    table = "add element inet radron"
    lines = [f"{table} fleet {{ {fleet.subnet} }}", f"{table} mesh_ports {{ {fleet.config.network.port} }}"]
    autopilot = autopilot_of(drone, str(fleet.path))
    if autopilot is not None:
        lines.append(f"{table} autopilot {{ {autopilot[0]} . {autopilot[1]} }}")
    return "".join(f"{line}\n" for line in lines)
