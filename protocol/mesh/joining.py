"""The Zenoh session of a member, with the rights of each of its peers."""

from __future__ import annotations

import zenoh

from radron.protocol.errors import MeshError
from radron.protocol.identity import CERTIFICATE_FILE, Identity, Role
from radron.protocol.mesh.link import MeshConfig, open_session
from radron.protocol.mesh.rights import access_control, limits


async def session_of(config: MeshConfig, swarm: str, drone: str | None) -> zenoh.Session:
    """Open the network session (Zenoh) of a member of the swarm, with rules for what each peer may send.

    Links to revoked members are closed. ``drone``: own id; None: an operator. Raises MeshError or IdentityError.
    """
    identity, access, revoked = config.identity, None, config.revoked
    if identity is not None:
        _check_owner(identity, drone)
        revoked |= identity.revoked.names
        access = access_control(swarm, config.drones, revoked, config.others)
    dial_all = config.listen is None
    return await open_session(config, dial_all, access=access, limits=limits(swarm), refused=revoked)


def _check_owner(identity: Identity, drone: str | None) -> None:
    own = identity.own
    place = f"{identity.folder / CERTIFICATE_FILE}: is the certificate of {own.name} ({own.role})"
    if drone is not None and (own.name, own.role) != (drone, Role.DRONE):
        raise MeshError(f"{place}, and this drone is {drone}; run `radron-deploy pki issue {drone} --role drone`")
