"""An operator's command to a swarm: finds its mission, refuses a start if drones differ, sends, and waits until it is obeyed."""

from __future__ import annotations

import asyncio
import os
import re
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from agent.errors import RadronError
from agent.outputs import printable
from protocol.codec import decode_from, encode
from protocol.errors import ProtocolError
from protocol.identity import CERTIFICATE_FILE, Identity, Role, load_identity, utc
from protocol.keys import key_of, parse_key
from protocol.mesh.diagnosis import refusals
from protocol.mesh.session import Mesh, MeshConfig
from protocol.messages import Action, Command, Stage, Status, Ticket
from protocol.signing import Trust, Verifier, sign_command
from protocol.trust import trust_of

LISTEN_S = 2.5  # a drone publishes its status every second
FIND_S = 8.0  # how long to search for the swarm
OBEY_S = 5.0
REPEAT_S = 1.0  # until the command is repeated: a drone that has obeyed it ignores the copy
PAUSE_S = 0.05  # between two commands: the drones drop what comes sooner (protocol/mesh/rights.py)
FRESH_S = 3.0
CLOCKS_S = 3.0  # clock difference that is reported: a start is refused once it is too old
_MOST_NAMES = 5  # that are told

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
class Addressees:
    """Drones of a swarm (empty: all), or all ``without`` some, and the endpoints at which the swarm is reached."""

    swarm: str
    connect: tuple[str, ...]
    drones: tuple[str, ...] = ()
    without: tuple[str, ...] = ()


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
    mission: str = ""  # id of the mission that is meant; empty: the one that the drones have

    @property
    def addressees(self) -> Addressees:
        """Whom it is for."""
        return Addressees(self.swarm, self.connect, self.drones, self.without)


async def command(order: Order, say: Callable[[str], None]) -> None:
    """Carry out an order; ``say`` is called with a line for each step.

    Raises:
        CommandError: no such swarm, drones with different missions, or a drone that does not obey, with its reasons.
        ProtocolError: an endpoint that cannot be used.
    """
    links = MeshConfig(connect=order.connect, identity=operator_identity(order.identity))
    statuses = Statuses(links.identity)
    mesh = await Mesh.open(links, order.swarm, None, receive=statuses.receive)
    try:
        await carry_out(order, mesh, links.identity, statuses, say)
    finally:
        await mesh.close()


async def carry_out(order: Order, mesh: Mesh, identity: Identity | None, statuses: Statuses, say: Callable[[str], None]) -> None:
    """The same over a link that is open; ``statuses`` gets every message from it. Raises CommandError as ``command``."""
    drones = await find(order.addressees, order.action, statuses, identity, lambda: mesh.differing)
    _check_mission(order, drones, statuses)
    if order.action is Action.START:
        if mesh.differing:
            raise CommandError(f"not started: {'; '.join(mesh.differing)}")
        if not order.anyway:
            _look_for_problems(drones, statuses, order.without)
        for line in (f"{name}: {text}" for name in drones for text in statuses[name].notices):
            say(line)
    statuses.keep_numbers(drones)
    for mission, names in _by_mission(drones, statuses).items():
        say(f"{order.action}: to {', '.join(names)}, mission {mission}")
    await _send_until_done(mesh, order, trust_of(identity), drones, statuses)
    say(f"{order.action}: " + ", ".join(f"{name} {statuses[name].stage}" for name in drones))


_COMING_DOWN = (Action.RETURN, Action.LAND, Action.ABORT)
_RENEW = "run `radron-deploy pki issue NAME --role operator`, and copy the folder that it makes"


def operator_identity(folder: Path | None) -> Identity | None:
    """The operator's certificate. Its times are left to the drones' clocks: a laptop's wrong clock must not prevent a landing.

    Raises:
        CommandError: it is not an operator's.
        IdentityError: it cannot be used.
    """
    if folder is None:
        return None
    identity = load_identity(folder)
    own = identity.own
    if own.role is not Role.OPERATOR:
        file = folder / CERTIFICATE_FILE
        raise CommandError(f"{file}: is the certificate of {own.name}, whose role is {own.role}, not operator; {_RENEW}")
    return identity


def lapsed(identity: Identity | None, now_ns: int) -> str:
    """Why nothing is heard, if it may be for the operator's certificate."""
    if identity is None or identity.own.not_before_ns <= now_ns <= identity.own.not_after_ns:
        return ""
    until, now = (f"{utc(at_ns):%Y-%m-%d %H:%M} UTC" for at_ns in (identity.own.not_after_ns, now_ns))
    file = identity.folder / CERTIFICATE_FILE
    return f"; {file} is valid until {until}, and this computer's clock shows {now}: set it, or {_RENEW}"


class Statuses:
    """The newest status of each drone. ``unsigned``: in whose names there were some that it has not signed."""

    def __init__(self, identity: Identity | None = None) -> None:
        """``identity``: this computer's; None: the swarm has no certificates, and nothing is verified."""
        self._verifier = Verifier(identity.authority) if identity is not None else None
        self.unsigned: set[str] = set()
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

    def receive(self, key: str, payload: bytes) -> bool:
        """Take a message of the mesh; whether it is a status that counts: signed by its drone, and no old one again."""
        try:
            if parse_key(key).kind != "status":
                return False
            message = decode_from(key, payload)
        except ProtocolError:
            return False
        if not isinstance(message, Status):
            return False
        if self._verifier is not None and not self._verifier.accepts_status(message):
            self.unsigned = {*sorted(self.unsigned)[:_MOST_NAMES], message.drone}
            return False
        known = self._newest.get(message.drone)
        if known is not None and message.stamp_ns <= known.stamp_ns and message.drone in self.heard():
            return False  # after a pause it counts: the drone's clock may have been set back
        self._newest[message.drone] = legible(message)
        self._heard_s[message.drone] = time.monotonic()
        self._ahead_s[message.drone] = (message.stamp_ns - time.time_ns()) * 1e-9
        return True

    def __getitem__(self, drone: str) -> Status:
        return self._newest[drone]

    def heard(self) -> list[str]:
        """The drones heard recently."""
        oldest_s = time.monotonic() - FRESH_S
        return sorted(name for name, heard_s in self._heard_s.items() if heard_s > oldest_s)

    def is_overtaken(self, drone: str) -> bool:
        """Whether another command has been carried out since this one was numbered."""
        newest, number = self._newest[drone].ticket, self._numbers.get(drone)
        return newest is not None and number is not None and newest.number > number

    def why(self, action: Action, drone: str) -> str:
        """Why a drone does not obey, in one line."""
        status = self._newest[drone]
        if drone not in self.heard():
            return f"{drone}: no longer heard"
        if status.ticket is None:
            return f"{drone}: its status tells no nonce, without which no command is obeyed"
        if self.is_overtaken(drone) and action is Action.RESUME:  # one that is refused is used up, too
            return f"{drone}: resume was not possible, or another command came first (now in {status.stage})"
        if self.is_overtaken(drone):
            return f"{drone}: another command came first: give this one again"
        if action is Action.START and abs(self._ahead_s[drone]) > CLOCKS_S:
            return f"{drone}: its clock differs by {self._ahead_s[drone]:+.1f} s from this computer's: synchronise both"
        if action is Action.START and status.stage is Stage.PREFLIGHT and status.problems:
            return f"{drone}: {', '.join(status.problems)}"
        return f"{drone}: {action} is not possible in {status.stage}"


def legible(status: Status) -> Status:
    """A status whose texts can be shown on a terminal."""
    problems, notices = (tuple(map(printable, texts)) for texts in (status.problems, status.notices))
    upload = None if status.upload is None else replace(status.upload, refused=printable(status.upload.refused))
    return replace(status, problems=problems, notices=notices, finding=printable(status.finding), upload=upload)


async def find(
    wanted: Addressees, what: str, statuses: Statuses, identity: Identity | None, differing: Callable[[], tuple[str, ...]]
) -> list[str]:
    """The drones that are wanted, all of them heard.

    Raises:
        CommandError: not all of them are; ``what`` is named in the text.
    """
    began_s = time.monotonic()
    while (waited_s := time.monotonic() - began_s) < FIND_S:
        heard = [name for name in statuses.heard() if name not in wanted.without]
        if wanted.drones and set(wanted.drones) <= set(heard):
            return sorted(wanted.drones)
        if not wanted.drones and heard and waited_s > LISTEN_S:
            return heard
        await asyncio.sleep(0.1)
    places = ", ".join(wanted.connect)
    if differing():
        raise CommandError(f"{what}: {'; '.join(differing())}")
    missing = ", ".join(sorted(set(wanted.drones) - set(statuses.heard()))) or f"any drone of the swarm {wanted.swarm!r}"
    names = ", ".join(sorted(statuses.unsigned)[:_MOST_NAMES])
    forged = f"; statuses were left out that {names} did not sign" if names else ""
    refused = (await refusals(identity, wanted.connect, time.time_ns())).values()
    hint = "".join(f"; {text}" for text in refused) or lapsed(identity, time.time_ns())
    raise CommandError(f"{what}: nothing heard from {missing} at {places} within {FIND_S:g} s{forged}{hint}")


def station_name(trust: Trust | None) -> str:
    """Name of this station: that of its certificate, or one that no other station has."""
    return trust.name if trust is not None else f"command-{os.getpid()}"


def _by_mission(drones: Collection[str], statuses: Statuses) -> dict[str, list[str]]:
    """These drones by the mission that they have."""
    found: dict[str, list[str]] = {}
    for name in drones:
        found.setdefault(statuses[name].mission, []).append(name)
    return found


def _check_mission(order: Order, drones: Collection[str], statuses: Statuses) -> None:
    """Refuse to start drones with different missions, or to command ones with another mission than the operator means."""
    missions = _by_mission(drones, statuses)
    told = "; ".join(f"{', '.join(names)}: {mission}" for mission, names in missions.items())
    if order.action is Action.START and len(missions) > 1:
        raise CommandError(f"not started: the drones have different missions ({told}): upload the same one to all")
    if order.mission and set(missions) != {order.mission}:
        raise CommandError(f"{order.action}: the mission meant is {order.mission}, and the drones have another one ({told})")


def _look_for_problems(drones: Collection[str], statuses: Statuses, without: Collection[str]) -> None:
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


def _message(
    action: Action, trust: Trust | None, stamp_ns: int, mission: str, drones: Collection[str], statuses: Statuses
) -> Command | None:
    """A copy of the command; None where no drone's status has what it needs."""
    tickets = {name: ticket for name in drones if (ticket := statuses.ticket(name)) is not None}
    if not tickets:
        return None
    message = Command(
        stamp_ns=stamp_ns,
        station=station_name(trust),
        mission=mission,
        action=action,
        to=tickets,
    )
    return message if trust is None else sign_command(message, trust)


async def _send_until_done(mesh: Mesh, order: Order, trust: Trust | None, drones: list[str], statuses: Statuses) -> None:
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
            for mission, names in _by_mission(drones, statuses).items():
                message = _message(order.action, trust, stamp_ns, mission, names, statuses)
                if message is not None:
                    mesh.publish(key_of(order.swarm, message), encode(message))
                    await asyncio.sleep(PAUSE_S)
        await asyncio.sleep(0.05)
