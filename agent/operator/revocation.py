"""An operator's revocation of a member in flight: asks the swarm's logs, signs, sends, and waits until it is in effect."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from msgspec.structs import replace

from radron.agent.errors import RadronError
from radron.protocol.codec import decode_from, encode
from radron.protocol.errors import ProtocolError
from radron.protocol.identity import CERTIFICATE_FILE, Identity, checked_name, load_identity, utc
from radron.protocol.keys import key_of
from radron.protocol.mesh.diagnosis import refusals
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Status
from radron.protocol.revocations import MAX_REVOKED_BOOTS, Revocation, Revoked
from radron.protocol.signing import Verifier, sign_revocation
from radron.protocol.summary import decode_summary
from radron.protocol.trust import trust_of

LISTEN_S = 2.5  # a drone publishes its status every second
FIND_S = 8.0
EFFECT_S = 10.0
REPEAT_S = 1.0
ATTEMPTS = 3  # to fetch the content of a log
_GET = "run `radron-deploy pki issue NAME --role operator --may-revoke`, and give the folder that it makes"


class RevocationError(RadronError):
    """A revocation was not sent, or is not in effect at every drone."""


@dataclass(frozen=True, slots=True)
class Request:
    """The request to revoke a member of a swarm: to withdraw its rights during a flight.

    ``member``: a drone or an operator. ``nothing``: none of a drone's log entries count; ``last``: number of the last entry that
    counts, by boot (start of its agent); else all entries count that the other drones hold by now. ``days``: duration; None: as
    long as the certificate of the swarm's authority.
    """

    member: str
    swarm: str
    connect: tuple[str, ...]
    identity: Path
    nothing: bool = False
    last: Mapping[str, int] = field(default_factory=dict)
    days: int | None = None


async def revoke(request: Request, confirm: Callable[[str], bool], say: Callable[[str], None]) -> None:
    """Revoke a member of a swarm; ``confirm`` is asked before it is sent, ``say`` called with a line for each step.

    Raises:
        RevocationError: no right to revoke, no such swarm, not confirmed, or drones that have not put it into effect.
        ProtocolError: a name, certificate or endpoint that cannot be used.
    """
    identity = _identity(request)
    heard, links = _Heard(identity), MeshConfig(connect=request.connect, identity=identity)
    mesh = await Mesh.open(links, request.swarm, None, receive=heard.receive)
    try:
        drones = await _find(request, heard)
        # Only now are the names known that have rights: until then, the member itself could answer in the others' names.
        await mesh.reopen(replace(links, drones=tuple(drones), revoked=frozenset({request.member})))
        heard.revoked.clear()
        last = await _last(request, mesh, drones)
        if not confirm(f"{request.member}: {_told(request, last)}; heard by {', '.join(drones)}"):
            raise RevocationError("not revoked: confirm it, or give --yes")
        revocation = _signed(request, identity, last)
        await _send(request.swarm, mesh, revocation, drones, heard)
        say(f"{request.member} is revoked: in effect at {', '.join(drones)}; drones that join later learn it from them")
        say(f"then, where the authority's key is: radron-deploy pki revoke {request.member}")
    finally:
        await mesh.close()


class _Heard:
    """The newest signed status of each drone, and the revocations that each drone forwards."""

    def __init__(self, identity: Identity) -> None:
        self.identity = identity  # this computer's
        self._verifier = Verifier(identity.authority)
        self.statuses: dict[str, Status] = {}
        self.revoked: dict[str, tuple[Revocation, ...]] = {}

    def receive(self, key: str, payload: bytes) -> None:
        try:
            message = decode_from(key, payload)
        except ProtocolError:
            return
        if isinstance(message, Status):
            if self._verifier.accepts_status(message):
                self.statuses[message.drone] = message
        elif isinstance(message, Revoked):
            self.revoked[message.drone] = message.held


def _identity(request: Request) -> Identity:
    identity = load_identity(request.identity)
    checked_name(request.member)
    if request.member == identity.own.name:
        raise RevocationError(f"{request.member} is the name of your own certificate ({request.identity}); another operator can")
    if not identity.own.may_revoke:
        file = request.identity / CERTIFICATE_FILE
        raise RevocationError(f"{file}: {identity.own.name} has no right to revoke others; {_GET}")
    return identity


async def _find(request: Request, heard: _Heard) -> list[str]:
    """All drones heard, without the revoked member."""
    began_s = time.monotonic()
    while (waited_s := time.monotonic() - began_s) < FIND_S:
        drones = sorted(name for name in heard.statuses if name != request.member)
        if drones and waited_s > LISTEN_S:
            return drones
        await asyncio.sleep(0.1)
    refused = (await refusals(heard.identity, request.connect, time.time_ns())).values()
    places = ", ".join(request.connect)
    told = "; ".join((f"at {places} within {FIND_S:g} s", *refused))
    raise RevocationError(f"nothing heard from any other drone of the swarm {request.swarm!r} {told}")


async def _last(request: Request, mesh: Mesh, drones: Collection[str]) -> dict[str, int]:
    """By boot, the last sequence number that counts."""
    if request.nothing or request.last:
        return dict(request.last)
    found: dict[str, int] = {}
    for drone in drones:
        payload = None
        for _ in range(ATTEMPTS):
            payload = payload or await mesh.summary_of(drone)
        if payload is None:
            raise RevocationError(f"{drone} does not tell what its log holds; try again, or give --nothing or --last")
        _, summary = decode_summary(payload)
        for (publisher, boot), held in summary.items():
            if publisher == request.member and held.ranges:
                found[boot] = max(found.get(boot, -1), held.ranges[-1][1])
    kept = sorted(found, key=lambda boot: found[boot])[-MAX_REVOKED_BOOTS:]
    return {boot: found[boot] for boot in kept}


def _told(request: Request, last: Mapping[str, int]) -> str:
    if not last:
        return "none of its log entries count" if request.nothing else "the swarm holds no log entries of it, and takes none"
    return "its log entries count up to " + ", ".join(f"number {number} of boot {boot}" for boot, number in sorted(last.items()))


def _signed(request: Request, identity: Identity, last: dict[str, int]) -> Revocation:
    trust = trust_of(identity)
    if trust is None:
        raise RevocationError("without certificates nobody can be revoked")
    stamp_ns = time.time_ns()
    ends_ns = int(identity.authority.certificate.not_valid_after_utc.timestamp()) * 1_000_000_000
    until_ns = ends_ns if request.days is None else stamp_ns + request.days * 86_400_000_000_000
    bare = Revocation(
        stamp_ns=stamp_ns, station=trust.name, member=request.member, until_ns=until_ns, last=last, certificate=trust.certificate
    )
    if not identity.own.not_before_ns <= stamp_ns <= identity.own.not_after_ns:
        now, until = (f"{utc(at_ns):%Y-%m-%d %H:%M} UTC" for at_ns in (stamp_ns, identity.own.not_after_ns))
        file = identity.folder / CERTIFICATE_FILE
        raise RevocationError(f"{file}: is valid until {until}, and this computer's clock shows {now}: set it, or {_GET}")
    return sign_revocation(bare, trust)


async def _send(swarm: str, mesh: Mesh, revocation: Revocation, drones: Collection[str], heard: _Heard) -> None:
    """Send the revocation again and again until all drones forward it."""
    key, payload = key_of(swarm, revocation), encode(revocation)
    deadline_s, due_s = time.monotonic() + EFFECT_S, 0.0
    while True:
        waiting = [name for name in drones if not any(one.covers(revocation) for one in heard.revoked.get(name, ()))]
        if not waiting:
            return
        if time.monotonic() > deadline_s:
            raise RevocationError("; ".join(_why(name, heard.statuses[name]) for name in waiting))
        if time.monotonic() >= due_s:
            due_s = time.monotonic() + REPEAT_S
            mesh.publish(key, payload)
        await asyncio.sleep(0.05)


def _why(drone: str, status: Status) -> str:
    refused = [name.removeprefix("dropped_revocation_") for name in status.counters if name.startswith("dropped_revocation_")]
    reason = f"it refuses it ({', '.join(sorted(refused)).replace('_', ' ')})" if refused else "it may learn it from the others"
    return f"{drone} has not put it into effect: {reason}"
