"""Reading of a fleet file, with all checks that are possible without a drone."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Iterable
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from radron.agent.config.loading import convert, load_mission, merged, read_toml
from radron.agent.config.mission import MissionConfig
from radron.agent.detector.files.calibration import NAMES
from radron.agent.errors import ConfigError
from radron.deploy.fleet.config import FleetConfig, FleetDrone

CALIBRATION_FILES = tuple(f"{name}.txt" for name in NAMES)
T = TypeVar("T")
_SHARED = ("vehicle", "detector", "sightings", "camera_rpy_deg", "px4")  # top-level keys for all drones
_KEY_TYPES = ("ssh-ed25519", "ssh-rsa", "ecdsa-sha2-nistp256", "sk-ssh-ed25519@openssh.com", "sk-ecdsa-sha2-nistp256@openssh.com")


@dataclass(frozen=True, slots=True)
class Fleet:
    """A fleet file (description of all drones of a swarm) that has been read and checked, with its mission."""

    path: Path
    config: FleetConfig
    mission: MissionConfig

    @property
    def subnet(self) -> IPv4Network:
        """IPv4 network in which the drones talk to each other."""
        return IPv4Network(self.config.network.subnet)

    @property
    def mission_file(self) -> Path:
        """Path of the mission file."""
        return self.path.parent / self.config.mission

    def drone(self, name: str) -> FleetDrone:
        """Return the configuration of the drone with this id.

        Raises:
            ConfigError: no drone with this id.
        """
        for drone in self.config.drones:
            if drone.id == name:
                return drone
        raise ConfigError(
            f"{self.path}: there is no drone {name!r}; its drones are {', '.join(one.id for one in self.config.drones)}"
        )

    def calibration(self, drone: FleetDrone) -> Path | None:
        """Return the path of the calibration of a drone's camera; None if the drone has none."""
        return None if drone.calibration is None else self.path.parent / drone.calibration


def load_fleet(path: Path) -> Fleet:
    """Read and check a fleet file and its mission file.

    Raises:
        ConfigError: unreadable, unknown keys, values out of range, or drones, addresses, files and keys that do not fit together.
    """
    document = _with_shared_keys(read_toml(path))
    config = convert(document, FleetConfig, str(path))
    mission_file = path.parent / config.mission
    fleet = Fleet(path, config, load_mission(mission_file))
    _check_drones(fleet)
    _check_network(fleet)
    for drone in config.drones:
        _check_sensors(fleet, drone)
    for number, key in enumerate(config.ssh_keys, start=1):
        _check_ssh_key(f"{path}: ssh_keys: key {number}", key)
    return fleet


def _with_shared_keys(document: dict[str, Any]) -> dict[str, Any]:
    """Return the document with its top-level tables merged into each drone; a drone's own keys win.

    The drones come last, so that an error in a shared table is reported for the shared table.
    """
    drones = document.get("drones")
    if not isinstance(drones, list) or not all(isinstance(drone, dict) for drone in drones):
        return document
    shared = {key: document[key] for key in _SHARED if key in document}
    whole = [merged(shared, drone) for drone in drones]
    return {key: value for key, value in document.items() if key != "drones"} | {"drones": whole}


def _check_drones(fleet: Fleet) -> None:
    """Check that fleet and mission have the same drones."""
    here, there = [drone.id for drone in fleet.config.drones], [drone.id for drone in fleet.mission.drones]
    twice = _first_double(here)
    if twice is not None:
        raise ConfigError(f"{fleet.path}: drones: {twice!r} is there twice")
    for names, others, lacking in ((here, there, fleet.mission_file), (there, here, fleet.path)):
        for name in names:
            if name not in others:
                raise ConfigError(f"{lacking}: drones: {name!r} is missing; the fleet and its mission must have the same drones")


def _check_network(fleet: Fleet) -> None:
    network, where = fleet.config.network, str(fleet.path)
    try:
        subnet = IPv4Network(network.subnet)
    except ValueError as error:
        raise ConfigError(f'{where}: network.subnet: {error}; it is like "10.7.1.0/24"') from None
    if subnet.num_addresses < 4:
        raise ConfigError(f"{where}: network.subnet: {subnet} has no room for drones")
    addresses = {drone.id: _address(f"{where}: drones: {drone.id}: address", drone.address) for drone in fleet.config.drones}
    for name, address in addresses.items():
        if address not in subnet or address in (subnet.network_address, subnet.broadcast_address):
            raise ConfigError(f"{where}: drones: {name}: address {address} is no host's address in network.subnet = {subnet}")
    twice = _first_double(addresses.values())
    if twice is not None:
        owners = " and ".join(name for name, address in addresses.items() if address == twice)
        raise ConfigError(f"{where}: drones: {owners} have the same address {twice}")
    if network.gateway is not None and _address(f"{where}: network.gateway", network.gateway) in addresses.values():
        raise ConfigError(f"{where}: network.gateway: {network.gateway} is the address of a drone")
    for server in network.ntp:
        _address(f"{where}: network.ntp", server)
    if any(symbol in network.interface for symbol in "\n\r[]#;"):
        raise ConfigError(f"{where}: network.interface: {network.interface!r} is no name of an interface")


def _check_sensors(fleet: Fleet, drone: FleetDrone) -> None:
    where = f"{fleet.path}: drones: {drone.id}"
    path = fleet.calibration(drone)
    if path is not None and not path.is_file():
        missing = [name for name in CALIBRATION_FILES if not (path / name).is_file()]
        if missing:
            raise ConfigError(f"{where}: calibration: {path} lacks {', '.join(missing)}")
    autopilot_of(drone, where)


def autopilot_of(drone: FleetDrone, where: str) -> tuple[IPv4Address, int] | None:
    """Return the network address of a drone's autopilot, and the drone's port for it; None for a serial line or loopback.

    ``where``: place in the fleet file, for the error.

    Raises:
        ConfigError: the autopilot's own address is missing: any computer could then send to this port.
    """
    vehicle = drone.vehicle
    link = urlsplit(vehicle.address)
    if link.scheme not in ("udp", "udpin") or (link.hostname or "").startswith("127."):
        return None
    try:
        port = link.port
    except ValueError:  # above 65535
        port = None
    if vehicle.source is None or not port:
        example = 'address = "udpin://10.41.10.1:14540" and source = "10.41.10.2"'
        raise ConfigError(f"{where}: vehicle: an autopilot on the network needs its port and its own address, such as {example}")
    return _address(f"{where}: vehicle.source", vehicle.source), port


def _check_ssh_key(where: str, key: str) -> None:
    """Check one line of ``authorized_keys``: no options, as options could run commands."""
    kind, _, rest = key.strip().partition(" ")
    body = rest.split(" ", 1)[0]
    if "PRIVATE KEY" in key:
        raise ConfigError(f"{where}: is a private key; give the public one, such as ~/.ssh/id_ed25519.pub")
    try:
        named = base64.b64decode(body, validate=True)
    except (binascii.Error, ValueError):
        named = b""
    if kind not in _KEY_TYPES or "\n" in key.strip() or kind.encode() not in named[:64]:
        raise ConfigError(f'{where}: {key.strip()[:40]!r} is no public SSH key; it is like "ssh-ed25519 AAAA... anna@laptop"')


def _address(where: str, text: str) -> IPv4Address:
    try:
        return IPv4Address(text)
    except ValueError:
        raise ConfigError(f"{where}: {text!r} is no IPv4 address") from None


def _first_double(items: Iterable[T]) -> T | None:
    seen: list[T] = []
    for item in items:
        if item in seen:
            return item
        seen.append(item)
    return None
