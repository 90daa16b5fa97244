"""Sessions with certificates, over encrypted links on this machine."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from radron.protocol.identity import Identity, Role, load_identity
from radron.protocol.keys import command_key, drone_key
from radron.protocol.mesh.session import Mesh, MeshConfig
from support.mesh.meshes import DEADLINE_S, SWARM, Member, free_port, linked

DRONES = ("d1", "d2", "d3")
QUIET_S = 0.6  # in which a peer that is let in is linked many times over: that takes milliseconds, and it dials again after 0.2 s


def endpoint(port: int | None = None) -> str:
    return f"tls/127.0.0.1:{port or free_port()}"


class Listening(Member):
    """A member, and where it listens."""

    listen = ""


@asynccontextmanager
async def joined(
    own: Identity | None,
    listen: str | None = None,
    connect: tuple[str, ...] = (),
    answers: tuple[tuple[str, bytes], ...] = (),
    drones: tuple[str, ...] | None = DRONES,
    others: tuple[str, ...] | None = None,
    gossip: bool = True,
) -> AsyncIterator[Listening]:
    """A session with an identity; None: without encryption."""
    drone = own.own.name if own is not None and own.own.role is Role.DRONE else None
    one = Listening(drone, SWARM)
    one.listen = listen or ""
    config = MeshConfig(listen=listen, connect=connect, identity=own, drones=drones, others=others, gossip=gossip)
    one.mesh = await Mesh.open(config, SWARM, drone, receive=one.receive, answer=lambda _: list(answers))
    try:
        yield one
    finally:
        await one.mesh.close()


async def is_let_in(d1: Member, own: Identity | None, listen: str) -> bool:
    """Whether a member that dials d1 is heard by it: as a drone that is alive, or by a command."""
    async with joined(own, connect=(listen,)) as other:
        for _ in range(round(QUIET_S / 0.05)):
            other.mesh.publish(command_key(SWARM, "x"), b"command")
            if other.drone in d1.mesh.alive or d1.messages:
                return True
            await asyncio.sleep(0.05)
    return False


async def swarm(folder: Path, stack: AsyncExitStack, *names: str) -> list[Listening]:
    """Members that hear each other; the first ones listen."""
    ends = [endpoint() for _ in names]
    members = []
    for number, name in enumerate(names):
        own = load_identity(folder / name)
        listen = ends[number] if own.own.role is Role.DRONE else None
        answers = ((drone_key(SWARM, "d2", "cone"), b"cone of d2"),) if own.own.role is Role.DRONE else ()
        members.append(await stack.enter_async_context(joined(own, listen, tuple(ends[:number]), answers)))
    await linked(*members)
    return members


async def heard(publish: Callable[[], object], *members: Member) -> None:
    """Publish until the members have heard it: news goes nowhere before a subscription is known."""
    before = [len(one.messages) for one in members]
    end_s = time.monotonic() + DEADLINE_S
    while any(len(one.messages) == count for one, count in zip(members, before, strict=True)):
        assert time.monotonic() < end_s, "not heard"
        publish()
        await asyncio.sleep(0.05)
