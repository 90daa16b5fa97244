"""The computers at which a command works: given by addresses, or as drones of a fleet file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from radron.deploy.fleet.loading import Fleet, load_fleet
from radron.deploy.remote import Host, RemoteError, run
from radron.deploy.update.errors import UpdateError
from radron.protocol.onboard import Computer

PROGRAM = "/opt/radron/bin/radron-update"
Tell = Callable[[Host, str, int, int], None]  # present step at a computer, and its progress: bytes done and in all, or 0 of 0


def find_hosts(names: Sequence[str], fleet_file: Path | None, options: Sequence[str]) -> tuple[list[Host], Fleet | None]:
    """Return the computers at which a command must work, and the fleet, if a fleet file is given.

    Args:
        names: addresses; with a fleet, its drones' ids or addresses; empty: all drones.
        fleet_file: the fleet file.
        options: options of ssh, such as ``IdentityFile=key``.

    Raises:
        UpdateError: neither names nor a fleet, or a computer named twice.
        ConfigError: a fleet file with errors, or without a named drone.
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
    """Return the state of an onboard computer: release, disk, clock, agent and last update.

    Raises:
        RemoteError: no answer, no radron installed there, or an answer of another version.
    """
    missing = "echo 'is no drone yet: `radron-deploy image flash` makes its disk, or `radron-deploy install`' >&2; exit 1"
    said = await run(host, f"command -v {PROGRAM} > /dev/null || {{ {missing}; }}; {PROGRAM} status")
    try:
        return msgspec.json.decode(said, type=Computer)
    except msgspec.MsgspecError as error:
        raise RemoteError(f"{host.name}: tells what this version of radron does not understand: {error}") from None


def _host(name: str, fleet: Fleet, options: Sequence[str]) -> Host:
    """Return a drone of the fleet by its id, or any computer by its address. An address has a dot, a colon or an @."""
    if not set(name) & set(".:@") or any(drone.id == name for drone in fleet.config.drones):
        return Host(name, fleet.drone(name).address, options=tuple(options))
    return Host.parse(name, options)
