"""A mission uploaded to the drones of a swarm on the ground: offered, fetched by each, and waited for until they have it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from radron.agent.config.loading import mission_content
from radron.agent.config.mission import MissionConfig
from radron.agent.operator.groundcontrol import Addressees, CommandError, find, lapsed, operator_identity, station_name
from radron.agent.operator.statuses import Statuses, Tickets
from radron.protocol.codec import encode
from radron.protocol.elapsed import elapsed_s
from radron.protocol.identity import Identity
from radron.protocol.keys import key_of
from radron.protocol.mesh.queries import hash_of, split
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Upload
from radron.protocol.signing import Trust, sign_command
from radron.protocol.trust import trust_of

ANSWER_S = 6.0  # a drone publishes its status every second
BACK_S = 90.0  # until a drone that takes the mission over has begun anew with it: mostly some seconds
REPEAT_S = 1.0
LOOK_S = 0.05
Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class UploadOrder:
    """The order to upload a mission to its drones, and the addresses of the swarm. ``without``: drones excluded from the
    upload.
    """

    mission: MissionConfig
    connect: tuple[str, ...]
    without: tuple[str, ...] = ()
    identity: Path | None = None  # folder with the operator's certificate; None: links are not encrypted, nothing is signed
    given_s: float | None = None  # when the operator gave it (``elapsed_s``); None: once the drones are found


async def upload(order: UploadOrder, say: Say) -> dict[str, str]:
    """Upload a mission to drones on the ground; ``say`` is called with a line for each step of each drone.

    Each drone decides for itself: a drone that refuses keeps its mission, and no start is possible until all have equal missions.

    Returns:
        By drone: the reason for its refusal; empty after the mission was taken.

    Raises:
        CommandError: not all the mission's drones are heard, or the certificate is not an operator's; nothing was sent.
        ProtocolError: an endpoint that cannot be used, or a mission that is too large.
    """
    links = MeshConfig(connect=order.connect, identity=operator_identity(order.identity))
    statuses = Statuses(links.identity)
    mesh = await Mesh.open(links, order.mission.swarm, None, receive=statuses.receive)
    try:
        return await carry_out(order, mesh, links.identity, statuses, say)
    finally:
        await mesh.close()


async def carry_out(order: UploadOrder, mesh: Mesh, identity: Identity | None, statuses: Statuses, say: Say) -> dict[str, str]:
    """Upload a mission as ``upload`` does, over a link that is already open; ``statuses`` gets every message from it."""
    drones = tuple(member.id for member in order.mission.drones if member.id not in order.without)
    if not drones:
        raise CommandError("upload: no drone of the mission is left")
    swarm, parts, trust = order.mission.swarm, split(mission_content(order.mission)), trust_of(identity)
    await mesh.serve_mission(station_name(trust), parts)
    found = await find(Addressees(swarm, order.connect, drones), "upload", statuses, identity, lambda: mesh.differing)
    tickets = Tickets(statuses, found, elapsed_s() if order.given_s is None else order.given_s)
    hashes = tuple(hash_of(part) for part in parts)
    sending = _Sending(mesh, swarm, trust, tickets, order.mission.mission_id, hashes, time.time_ns())
    say(f"upload: to {', '.join(found)}, mission {sending.mission}")
    return await _followed(sending, [_Drone(name, statuses[name].boot) for name in found], identity, say)


@dataclass(slots=True)
class _Drone:
    """Progress of the upload to a drone. ``boot``: of its agent before; ``result``: None while open."""

    name: str
    boot: str
    takes: bool = False
    result: str | None = None


@dataclass(frozen=True, slots=True)
class _Sending:
    """One upload. Its copies have the same stamp, nonces and numbers."""

    mesh: Mesh
    swarm: str
    trust: Trust | None
    tickets: Tickets
    mission: str
    hashes: tuple[bytes, ...]
    stamp_ns: int

    def send(self, drones: list[str]) -> None:
        """Send the upload to these drones, as far as their tickets are known."""
        if to := self.tickets.to(drones):
            station = station_name(self.trust)
            message = Upload(stamp_ns=self.stamp_ns, station=station, mission=self.mission, to=to, parts=self.hashes)
            message = message if self.trust is None else sign_command(message, self.trust)
            self.mesh.publish(key_of(self.swarm, message), encode(message))


async def _followed(sending: _Sending, drones: list[_Drone], identity: Identity | None, say: Say) -> dict[str, str]:
    """Send to all drones without an answer, until each has taken or refused the mission."""
    began_s, due_s = elapsed_s(), 0.0
    while waiting := [one for one in drones if one.result is None]:
        now_s = elapsed_s()
        for one in waiting:
            _look(sending, one, now_s - began_s, identity, say)
        unanswered = [one.name for one in waiting if one.result is None and not one.takes]
        if unanswered and now_s >= due_s:
            due_s = now_s + REPEAT_S
            sending.send(unanswered)
        await asyncio.sleep(LOOK_S)
    return {one.name: one.result or "" for one in drones}


def _look(sending: _Sending, one: _Drone, waited_s: float, identity: Identity | None, say: Say) -> None:
    """Record a drone's answer."""
    status = sending.tickets.statuses[one.name]
    answer = status.upload
    answered = answer is not None and answer.stamp_ns == sending.stamp_ns
    if status.mission == sending.mission:
        one.result = ""
        say(f"{one.name}: has it" if one.boot != status.boot else f"{one.name}: has it already")
    elif answer is not None and answered and answer.refused:
        one.result = f"refused: {answer.refused}"
    elif status.boot != one.boot:
        one.result = "; ".join(("it has begun anew without the mission", *status.problems))
    elif answered and not one.takes:
        one.takes = True
        say(f"{one.name}: takes it over")
    elif not one.takes and waited_s > ANSWER_S and one.name in sending.tickets.statuses.heard():
        one.result = _silence(sending.tickets, one.name) + lapsed(identity, time.time_ns())
    elif waited_s > BACK_S:
        one.result = f"not heard with the mission within {BACK_S:g} s: see its log"
    if one.result:
        say(f"{one.name}: {one.result}")


def _silence(tickets: Tickets, drone: str) -> str:
    """Why a drone that is heard has not answered."""
    if tickets.is_overtaken(drone):
        return "another command came first: upload it again"
    return "does not answer: its flight record tells why (radron-agent audit)"
