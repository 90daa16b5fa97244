"""Network addresses of a live swarm's links."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

from radron.sim.live.relays.plan import Carried, RelayPlan, vehicle_of
from radron.sim.live.runfolder import LOCAL, free_ports
from radron.sim.vehicle.px4.config import Address

FIRST_FEED_PORT, FIRST_VISION_PORT, FIRST_SIGHTINGS_PORT = 5600, 5700, 5800
MAVLINK_PORT, GROUND_STATION_PORT = 14540, 14550


@dataclass(frozen=True, slots=True)
class Places:
    """Network addresses of a live swarm's links.

    onboard: MAVLink addresses of vehicle 1, 2 and so on. mesh: the agents' addresses for each other. bind, feed_ports,
    vision_ports, sightings_ports: listening address of the feeds of cameras and other sensors; empty: free ports. ground_station:
    listening address for vehicles that are not emulated; None: emulated vehicles. agents_here: the agents are started on this
    machine. mesh_relays: ports of the relays (which impair links) between agents 1 and 2, 1 and 3, and so on, then 2 and 3;
    mavlink_relays: ports to which the emulated vehicles send instead of to their agents; both empty: the links are direct.
    operator: folder with the operator's certificate; None: certificates are made for the flight, with endpoints ``tls/...``.
    """

    onboard: tuple[Address, ...]
    mesh: tuple[str, ...]
    bind: str
    feed_ports: tuple[int, ...] = ()
    vision_ports: tuple[int, ...] = ()
    sightings_ports: tuple[int, ...] = ()
    ground_station: Address | None = None
    agents_here: bool = False
    mesh_relays: tuple[int, ...] = ()
    mavlink_relays: tuple[int, ...] = ()
    operator: Path | None = None

    @classmethod
    def here(cls, count: int, encrypted: bool = True) -> Places:
        """Return addresses of agents and emulated vehicles on this machine, at free ports."""
        places = cls.with_vehicles(free_ports(count, socket.SOCK_DGRAM), None)
        return places if encrypted else replace(places, mesh=tuple(end.replace("tls/", "tcp/") for end in places.mesh))

    @classmethod
    def with_vehicles(cls, ports: Sequence[int], ground_station: Address | None) -> Places:
        """Return addresses of agents on this machine, each with its vehicle at one of these ports.

        With a ``ground_station``, the vehicles are flown by other programs.
        """
        onboard = tuple((LOCAL, port) for port in ports)
        mesh = tuple(f"tls/{LOCAL}:{port}" for port in free_ports(len(ports), socket.SOCK_STREAM))
        return cls(onboard, mesh, LOCAL, ground_station=ground_station, agents_here=True)

    @classmethod
    def relayed(cls, count: int) -> Places:
        """Return addresses of agents and emulated vehicles on this machine, with a relay in each of their links."""
        pairs = count * (count - 1) // 2
        streams, datagrams = free_ports(count + pairs, socket.SOCK_STREAM), free_ports(2 * count, socket.SOCK_DGRAM)
        return cls(
            onboard=tuple((LOCAL, port) for port in datagrams[:count]),
            mesh=tuple(f"tls/{LOCAL}:{port}" for port in streams[:count]),
            bind=LOCAL,
            agents_here=True,
            mesh_relays=tuple(streams[count:]),
            mavlink_relays=tuple(datagrams[count:]),
        )

    @classmethod
    def elsewhere(
        cls, hosts: Sequence[str], mesh: Sequence[str], bind: str, emulated: bool = True, operator: Path | None = None
    ) -> Places:
        """Return addresses of agents on one host each, in containers or on drones, all with equal ports."""
        feeds, visions, sightings = (
            tuple(range(first, first + len(hosts))) for first in (FIRST_FEED_PORT, FIRST_VISION_PORT, FIRST_SIGHTINGS_PORT)
        )
        station = None if emulated else (bind, GROUND_STATION_PORT)
        onboard = tuple((host, MAVLINK_PORT) for host in hosts)
        return cls(onboard, tuple(mesh), bind, feeds, visions, sightings, station, operator=operator)

    @property
    def encrypted(self) -> bool:
        """Whether the agents' links are encrypted."""
        return all(endpoint.startswith("tls/") for endpoint in self.mesh)

    @property
    def vehicles(self) -> tuple[Address, ...]:
        """Addresses to which the emulated vehicles send."""
        return tuple((LOCAL, port) for port in self.mavlink_relays) or self.onboard

    def endpoints(self, drones: Sequence[str], drone: str) -> dict[str, str]:
        """Return the network addresses for a drone's configuration.

        They are its own address, and the addresses of the drones before it in the mission, which it dials.
        """
        found = dict(zip(drones, self.mesh, strict=True))
        for (earlier, later), port in zip(combinations(drones, 2), self.mesh_relays, strict=False):
            if later == drone:
                found[earlier] = f"tls/{LOCAL}:{port}"
        return found

    def relay_plan(self, seed: int, drones: Sequence[str]) -> RelayPlan:
        """Return the relays in the links of these addresses. Of two agents the later one in the mission dials the other."""
        listens = {drone: (LOCAL, int(endpoint.rpartition(":")[2])) for drone, endpoint in zip(drones, self.mesh, strict=True)}
        pairs = zip(combinations(drones, 2), self.mesh_relays, strict=True)
        mesh = [Carried(later, earlier, port, listens[earlier]) for (earlier, later), port in pairs]
        vehicles = zip(drones, self.mavlink_relays, self.onboard, strict=True)
        mavlink = [Carried(vehicle_of(drone), drone, port, agent) for drone, port, agent in vehicles]
        return RelayPlan(seed, LOCAL, tuple(mesh), tuple(mavlink))
