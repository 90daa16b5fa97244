"""Which onboard computers a command is for: addresses, or drones of a fleet file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from deploy.fleet.loading import Fleet, load_fleet
from deploy.remote import Host, RemoteError, run
from deploy.update.errors import UpdateError
from protocol.onboard import Computer

PROGRAM = "/opt/radron/bin/radron-update"
Tell = Callable[[Host, str, int, int], None]  # what is being done there, and how far it is: bytes, or 0 of 0


def find_hosts(names: Sequence[str], fleet_file: Path | None, options: Sequence[str]) -> tuple[list[Host], Fleet | None]:
    """The computers, and the fleet.

    Args:
        names: addresses; with a fleet its drones' ids or addresses, none of them: all drones.
        fleet_file: the fleet file.
        options: of ssh, such as ``IdentityFile=key``.

    Raises:
        UpdateError: neither names nor a fleet, or a computer that is named twice.
        ConfigError: a fleet file with errors, or without a drone that is named.
    """
    if fleet_file is None:
        if not names:
            raise UpdateError("which computers? give their addresses, or --fleet fleet.toml for all drones of a fleet")
        hosts, fleet = [Host.parse(name, options) for name in names], None
    else:
        fleet = load_fleet(fleet_file)
        hosts = [_host(name, fleet, options) for name in names or [drone.id for drone in fleet.config.drones]]
    places = [(host.address, host.port) for host in hosts]
    for host, place in zip(hosts, places, strict=True):
        if places.count(place) > 1:
            raise UpdateError(f"{host.name}: is named twice")
    return hosts, fleet


async def ask(host: Host) -> Computer:
    """What a computer tells of itself.

    Raises:
        RemoteError: it does not answer, or is none that radron's image made.
    """
    missing = "echo 'is no drone yet: `radron-deploy image flash` makes its disk, or `radron-deploy install`' >&2; exit 1"
    said = await run(host, f"command -v {PROGRAM} > /dev/null || {{ {missing}; }}; {PROGRAM} status")
    try:
        return msgspec.json.decode(said, type=Computer)
    except msgspec.MsgspecError as error:
        raise RemoteError(f"{host.name}: tells what this version of radron does not understand: {error}") from None


def _host(name: str, fleet: Fleet, options: Sequence[str]) -> Host:
    """A drone of the fleet by its id, or any computer by its address: that has a dot, a colon or an @ in it."""
    if not set(name) & set(".:@") or any(drone.id == name for drone in fleet.config.drones):
        return Host(name, fleet.drone(name).address, options=tuple(options))
    return Host.parse(name, options)
