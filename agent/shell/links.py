"""The links of one drone: its own endpoint, the endpoints that it dials, and its certificate."""

from __future__ import annotations

from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.shell.identity import own_identity
from radron.protocol.mesh.link import MeshConfig


def mesh_config(drone: DroneConfig, mission: MissionConfig) -> MeshConfig:
    """Return the network settings of a drone: it listens at its own address, and connects to the drones before it in the mission.

    So there is one link for each pair, never one in each direction.

    Raises:
        ConfigError: the drone has no endpoint, or no certificate.
        IdentityError: a certificate or key that cannot be used.
    """
    endpoints = drone.mesh.endpoints
    listen = drone.mesh.listen or endpoints.get(drone.id)
    if listen is None:
        raise ConfigError(f'mesh.endpoints has no entry for {drone.id}: add one, such as "tls/10.7.1.11:7447"')
    members = [member.id for member in mission.drones]
    before = members[: members.index(drone.id)]
    connect = tuple(endpoints[name] for name in before if name in endpoints)
    identity, others = own_identity(drone), drone.mesh.others
    drones = tuple(members)
    return MeshConfig(listen=listen, connect=connect, gossip=drone.mesh.gossip, identity=identity, drones=drones, others=others)


def without(revoked: frozenset[str], links: MeshConfig, drone: DroneConfig) -> MeshConfig:
    """Return the network settings without the revoked members, which are neither accepted nor contacted."""
    left_out = {drone.mesh.endpoints.get(name) for name in revoked}
    return replace(links, revoked=revoked, connect=tuple(peer for peer in links.connect if peer not in left_out))
