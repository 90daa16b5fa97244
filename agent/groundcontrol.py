"""An operator's command to a flying swarm: finds its mission, refuses if drones differ, sends, and waits until it is obeyed."""

from __future__ import annotations

import asyncio
import os
import re
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from agent.errors import RadronError
from protocol.codec import decode_from, encode
from protocol.errors import ProtocolError
from protocol.identity import CERTIFICATE_FILE, Identity, Role, load_identity, utc
from protocol.keys import key_of, parse_key
from protocol.messages import Action, Command, Stage, Status, Ticket
from protocol.session import Mesh, MeshConfig
from protocol.signing import Trust, sign_command
from protocol.trust import trust_of

LISTEN_S = 2.5  # a drone publishes its status every second
FIND_S = 8.0  # how long to search for the swarm
OBEY_S = 5.0
REPEAT_S = 1.0  # until the command is repeated: a drone that has obeyed it ignores the copy
FRESH_S = 3.0
CLOCKS_S = 3.0  # clock difference that is reported: a start is refused once it is too old

_AIRBORNE = (Stage.TAKEOFF, Stage.SURVEY, Stage.TRACK, Stage.REACQUIRE)
_DONE: dict[Action, tuple[Stage, ...]] = {
    Action.START: _AIRBORNE,
    Action.HOLD: (Stage.HOLD,),
    Action.RESUME: (*_AIRBORNE, Stage.RETURN),
    Action.RETURN: (Stage.RETURN, Stage.LANDING, Stage.LANDED),
    Action.LAND: (Stage.LANDING, Stage.LANDED),
    Action.ABORT: (Stage.ABORT, Stage.LANDED),
}


class CommandError(RadronError):
    """A command that was not sent, or that a drone did not carry out."""


@dataclass(frozen=True, slots=True)
class Order:
    """An action, the drones that are to do it (empty: all), and the endpoints at which the swarm is reached.

    ``without``: all but these are to do it, whether these are heard or not; problems that only concern them are no obstacle.
    """

    action: Action
    swarm: str
    connect: tuple[str, ...]
    drones: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    anyway: bool = False  # start although drones report problems; a drone that cannot start still refuses
    identity: Path | None = None  # folder with the operator's certificate; None: links are not encrypted, nothing is signed


async def command(order: Order, say: Callable[[str], None]) -> None:
    """Carry out an order; ``say`` is called with a line for each step.

    Raises:
        CommandError: no such swarm, drones with different missions, or a drone that does not obey, with its reasons.
        ProtocolError: an endpoint that cannot be used.
    """
    statuses = _Statuses()
    links = MeshConfig(connect=order.connect, identity=_identity(order))
    mesh = await Mesh.open(links, order.swarm, None, receive=statuses.receive)
    try:
        drones = await _find(order, statuses, links.identity, lambda: mesh.differing)
        if order.action is Action.START:
            if mesh.differing:
                raise CommandError(f"not started: {'; '.join(mesh.differing)}")
            if not order.anyway:
                _look_for_problems(drones, statuses, order.without)
            for line in (f"{name}: {text}" for name in drones for text in statuses[name].notices):
                say(line)
        statuses.keep_numbers(drones)
        say(f"{order.action}: to {', '.join(drones)}")
        await _send_until_done(mesh, order, trust_of(links.identity), drones, statuses)
        say(f"{order.action}: " + ", ".join(f"{name} {statuses[name].stage}" for name in drones))
    finally:
        await mesh.close()


_COMING_DOWN = (Action.RETURN, Action.LAND, Action.ABORT)
_RENEW = "run `radron-deploy pki issue NAME --role operator`, and copy the folder that it makes"


def _identity(order: Order) -> Identity | None:
    """The operator's certificate. Its times are left to the drones' clocks: a laptop's wrong clock must not prevent a landing."""
    if order.identity is None:
        return None
    identity = load_identity(order.identity)
    own = identity.own
    if own.role is not Role.OPERATOR:
        file = order.identity / CERTIFICATE_FILE
        raise CommandError(f"{file}: is the certificate of {own.name}, whose role is {own.role}, not operator; {_RENEW}")
    return identity


def _lapsed(identity: Identity | None, now_ns: int) -> str:
    """Why nothing is heard, if it may be for the operator's certificate."""
    if identity is None or identity.own.not_before_ns <= now_ns <= identity.own.not_after_ns:
        return ""
    until, now = (f"{utc(at_ns):%Y-%m-%d %H:%M} UTC" for at_ns in (identity.own.not_after_ns, now_ns))
    file = identity.folder / CERTIFICATE_FILE
    return f"; {file} is valid until {until}, and this computer's clock shows {now}: set it, or {_RENEW}"


class _Statuses:
    """The newest status of each drone."""

    def __init__(self) -> None:
        self._newest: dict[str, Status] = {}
        self._heard_s: dict[str, float] = {}  # this computer's monotonic clock: a wrong UTC clock must not prevent a landing
        self._ahead_s: dict[str, float] = {}
        self._numbers: dict[str, int] = {}  # of this command, by drone

    def keep_numbers(self, drones: Collection[str]) -> None:
        """Number the command to these drones, from now on the same in all its copies."""
        tickets = {name: self._newest[name].ticket for name in drones}
        self._numbers = {name: ticket.number for name, ticket in tickets.items() if ticket is not None}

    def ticket(self, drone: str) -> Ticket | None:
        """What a copy of the command needs for this drone: its newest nonce, and the command's number."""
        newest, number = self._newest[drone].ticket, self._numbers.get(drone)
        return None if newest is None or number is None else Ticket(newest.nonce, number)

    def receive(self, key: str, payload: bytes) -> None:
        try:
            if parse_key(key).kind != "status":
                return
            message = decode_from(key, payload)
        except ProtocolError:
            return
        if isinstance(message, Status):
            self._newest[message.drone] = message
            self._heard_s[message.drone] = time.monotonic()
            self._ahead_s[message.drone] = (message.stamp_ns - time.time_ns()) * 1e-9

    def __getitem__(self, drone: str) -> Status:
        return self._newest[drone]

    def heard(self) -> list[str]:
        """The drones heard recently."""
        oldest_s = time.monotonic() - FRESH_S
        return sorted(name for name, heard_s in self._heard_s.items() if heard_s > oldest_s)

    def why(self, action: Action, drone: str) -> str:
        """Why a drone does not obey, in one line."""
        status = self._newest[drone]
        if drone not in self.heard():
            return f"{drone}: no longer heard"
        if status.ticket is None:
            return f"{drone}: its status tells no nonce, without which no command is obeyed"
        newest, number = status.ticket, self._numbers.get(drone)
        if number is not None and newest.number > number:
            return f"{drone}: another command came first: give this one again"
        if action is Action.START and abs(self._ahead_s[drone]) > CLOCKS_S:
            return f"{drone}: its clock differs by {self._ahead_s[drone]:+.1f} s from this computer's: synchronise both"
        if action is Action.START and status.stage is Stage.PREFLIGHT and status.problems:
            return f"{drone}: {', '.join(status.problems)}"
        return f"{drone}: {action} is not possible in {status.stage}"


async def _find(
    order: Order, statuses: _Statuses, identity: Identity | None, differing: Callable[[], tuple[str, ...]]
) -> list[str]:
    """The drones that the order addresses, all of them heard."""
    began_s = time.monotonic()
    while (waited_s := time.monotonic() - began_s) < FIND_S:
        heard = [name for name in statuses.heard() if name not in order.without]
        if order.drones and set(order.drones) <= set(heard):
            return sorted(order.drones)
        if not order.drones and heard and waited_s > LISTEN_S:
            return heard
        await asyncio.sleep(0.1)
    places = ", ".join(order.connect)
    if differing():
        raise CommandError(f"{order.action}: {'; '.join(differing())}")
    missing = ", ".join(sorted(set(order.drones) - set(statuses.heard()))) or f"any drone of the swarm {order.swarm!r}"
    lapsed = _lapsed(identity, time.time_ns())
    raise CommandError(f"{order.action}: nothing heard from {missing} at {places} within {FIND_S:g} s{lapsed}")


def _mission_of(drones: Collection[str], statuses: _Statuses) -> str:
    missions = {name: statuses[name].mission for name in drones}
    if len(set(missions.values())) > 1:
        told = ", ".join(f"{name} {mission}" for name, mission in missions.items())
        raise CommandError(f"the drones have different mission files ({told}): give all the same one")
    return next(iter(missions.values()))


def _look_for_problems(drones: Collection[str], statuses: _Statuses, without: Collection[str]) -> None:
    """Refuse to start a swarm in which one drone has a problem: else the others would start without it.

    ``without``: drones that are left behind on purpose: what only concerns them is no problem.
    """
    found = {name: [text for text in statuses[name].problems if not _concerns(text, without)] for name in drones}
    told = [f"{name}: {', '.join(texts)}" for name, texts in found.items() if texts]
    if told:
        raise CommandError(f"not started: {'; '.join(told)} (--anyway starts those that can)")


def _concerns(problem: str, drones: Collection[str]) -> bool:
    """Whether a problem is that one of these drones is not heard, or what it has."""
    return any(re.match(rf"(no contact with )?{re.escape(name)}\b", problem) for name in drones)


def _message(action: Action, trust: Trust | None, stamp_ns: int, drones: Collection[str], statuses: _Statuses) -> Command:
    message = Command(
        stamp_ns=stamp_ns,
        station=trust.name if trust is not None else f"command-{os.getpid()}",
        mission=_mission_of(drones, statuses),
        action=action,
        to={name: ticket for name in drones if (ticket := statuses.ticket(name)) is not None},
    )
    return message if trust is None else sign_command(message, trust)


async def _send_until_done(mesh: Mesh, order: Order, trust: Trust | None, drones: list[str], statuses: _Statuses) -> None:
    """Send a command again and again: copies have the same stamp and numbers, and the newest nonces.

    One that brings the vehicles down is numbered anew each time: it must not fail because another operator's command came first.
    It is not sent to a drone again that has obeyed: meanwhile a human pilot may have the vehicle.
    """
    obeyed: set[str] = set()
    deadline_s = time.monotonic() + OBEY_S
    due_s, stamp_ns = 0.0, time.time_ns()
    while True:
        waiting = [name for name in drones if statuses[name].stage not in _DONE[order.action]]
        obeyed.update(name for name in drones if name not in waiting)
        if not waiting:
            return
        now_s = time.monotonic()
        if now_s > deadline_s:
            raise CommandError("; ".join(statuses.why(order.action, name) for name in waiting))
        if now_s >= due_s:
            due_s = now_s + REPEAT_S
            if order.action in _COMING_DOWN:
                statuses.keep_numbers([name for name in waiting if name not in obeyed])
            message = _message(order.action, trust, stamp_ns, drones, statuses)
            if message.to:
                mesh.publish(key_of(order.swarm, message), encode(message))
        await asyncio.sleep(0.05)
