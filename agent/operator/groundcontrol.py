"""An operator's command to a swarm: finds its mission, refuses a start if drones differ, sends, and waits until it is obeyed."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Collection, Set
from dataclasses import dataclass
from pathlib import Path

from radron.agent.errors import RadronError
from radron.agent.operator.statuses import LAPSE_S, MAX_NAMES, Statuses, Tickets
from radron.protocol.codec import encode
from radron.protocol.elapsed import elapsed_s
from radron.protocol.identity import CERTIFICATE_FILE, Identity, Role, load_identity, utc
from radron.protocol.keys import key_of
from radron.protocol.mesh.diagnosis import refusals
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Action, Command, Stage, Ticket
from radron.protocol.signing import Trust, sign_command
from radron.protocol.stages import RETURNING, TAKING_PART
from radron.protocol.trust import trust_of

LISTEN_S = 2.5  # a drone publishes its status every second
FIND_S = 8.0  # how long to search for the swarm
OBEY_S = LAPSE_S + 1.0  # until every drone has obeyed, and said so in its next status
REPEAT_S = 1.0  # until the command is repeated; a drone ignores copies of an obeyed command
PAUSE_S = 0.05  # between two commands: the drones drop earlier ones (protocol/mesh/rights.py)

_DONE: dict[Action, tuple[Stage, ...]] = {
    Action.START: TAKING_PART,
    Action.HOLD: (Stage.HOLD,),
    Action.RESUME: (*TAKING_PART, Stage.RETURN),
    Action.RETURN: (*RETURNING, Stage.LANDED),
    Action.LAND: (Stage.LANDING, Stage.LANDED),
    Action.ABORT: (Stage.ABORT, Stage.LANDED),
}


class CommandError(RadronError):
    """An operator's command was not sent, or a drone did not carry it out."""


@dataclass(frozen=True, slots=True)
class Addressees:
    """The drones to which a command goes, and the network addresses at which the swarm is reached.

    ``drones``: empty: all drones; ``without``: drones that are excluded.
    """

    swarm: str
    connect: tuple[str, ...]
    drones: tuple[str, ...] = ()
    without: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Order:
    """A command to a swarm: action, addressed drones (empty: all), and network addresses of the swarm.

    ``without``: drones excluded from the action, heard or not; problems that only concern these are no obstacle.
    """

    action: Action
    swarm: str
    connect: tuple[str, ...]
    drones: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    anyway: bool = False  # start although drones report problems; a drone that cannot start still refuses
    identity: Path | None = None  # folder with the operator's certificate; None: links are not encrypted, nothing is signed
    mission: str = ""  # id of the intended mission; empty: the drones' present mission
    given_s: float | None = None  # when the operator gave it (``elapsed_s``); None: once the drones are found

    @property
    def addressees(self) -> Addressees:
        """The drones to which the command goes, and their addresses."""
        return Addressees(self.swarm, self.connect, self.drones, self.without)


async def command(order: Order, say: Callable[[str], None]) -> None:
    """Send a command to a swarm, and wait until it is obeyed; ``say`` is called with a line of text for each step.

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


async def carry_out(
    order: Order,
    mesh: Mesh,
    identity: Identity | None,
    statuses: Statuses,
    say: Callable[[str], None],
    withdrawn: Set[str] = frozenset(),
) -> None:
    """Send a command as ``command`` does, over a link that is already open; ``statuses`` gets every message from it.

    ``withdrawn``: drones with a later command meanwhile, which get no more copies of this one. Raises CommandError as
    ``command``.
    """
    drones = await find(order.addressees, order.action, statuses, identity, lambda: mesh.differing)
    _check_mission(order, drones, statuses)
    if order.action is Action.START:
        if mesh.differing:
            raise CommandError(f"not started: {'; '.join(mesh.differing)}")
        if not order.anyway:
            _look_for_problems(drones, statuses, order.without)
        for line in (f"{name}: {text}" for name in drones for text in statuses[name].notices):
            say(line)
    given_s = elapsed_s() if order.given_s is None else order.given_s
    tickets = Tickets(statuses, drones, given_s)
    for mission, names in _by_mission(drones, statuses).items():
        say(f"{order.action}: to {', '.join(names)}, mission {mission}")
    await _send_until_done(mesh, order, trust_of(identity), tickets, given_s, withdrawn)
    done = [f"{name} {statuses[name].stage}" for name in drones if name not in withdrawn]
    say(f"{order.action}: {', '.join(done) or 'a later command came first'}")


_COMING_DOWN = (Action.RETURN, Action.LAND, Action.ABORT)
_RENEW = "run `radron-deploy pki issue NAME --role operator`, and copy the folder that it makes"


def operator_identity(folder: Path | None) -> Identity | None:
    """Load the operator's certificate and key; None without a folder.

    The certificate's times are not checked here but by the drones: a laptop's wrong clock must not prevent a landing.

    Raises:
        CommandError: the certificate is not an operator's.
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
    """Return a text on the operator's expired certificate, which may be why no drone answers; empty if it is valid now."""
    if identity is None or identity.own.not_before_ns <= now_ns <= identity.own.not_after_ns:
        return ""
    until, now = (f"{utc(at_ns):%Y-%m-%d %H:%M} UTC" for at_ns in (identity.own.not_after_ns, now_ns))
    file = identity.folder / CERTIFICATE_FILE
    return f"; {file} is valid until {until}, and this computer's clock shows {now}: set it, or {_RENEW}"


async def find(
    wanted: Addressees, what: str, statuses: Statuses, identity: Identity | None, differing: Callable[[], tuple[str, ...]]
) -> list[str]:
    """Wait until all wanted drones are heard, and return their names.

    Raises:
        CommandError: not all drones are heard in time; ``what`` (the action) begins the text.
    """
    began_s = elapsed_s()
    while (waited_s := elapsed_s() - began_s) < FIND_S:
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
    names = ", ".join(sorted(statuses.unsigned)[:MAX_NAMES])
    forged = f"; statuses were left out that {names} did not sign" if names else ""
    refused = (await refusals(identity, wanted.connect, time.time_ns())).values()
    hint = "".join(f"; {text}" for text in refused) or lapsed(identity, time.time_ns())
    raise CommandError(f"{what}: nothing heard from {missing} at {places} within {FIND_S:g} s{forged}{hint}")


def station_name(trust: Trust | None) -> str:
    """Return the name of this station: from its certificate, or a unique one."""
    return trust.name if trust is not None else f"command-{os.getpid()}"


def _by_mission(drones: Collection[str], statuses: Statuses) -> dict[str, list[str]]:
    """These drones by the mission that they have."""
    found: dict[str, list[str]] = {}
    for name in drones:
        found.setdefault(statuses[name].mission, []).append(name)
    return found


def _check_mission(order: Order, drones: Collection[str], statuses: Statuses) -> None:
    """Refuse to start drones with different missions, or to command drones with another mission than intended."""
    missions = _by_mission(drones, statuses)
    told = "; ".join(f"{', '.join(names)}: {mission}" for mission, names in missions.items())
    if order.action is Action.START and len(missions) > 1:
        raise CommandError(f"not started: the drones have different missions ({told}): upload the same one to all")
    if order.mission and set(missions) != {order.mission}:
        raise CommandError(f"{order.action}: the mission meant is {order.mission}, and the drones have another one ({told})")


def _look_for_problems(drones: Collection[str], statuses: Statuses, without: Collection[str]) -> None:
    """Refuse to start a swarm with a problem on any drone: otherwise the others would start without that drone.

    ``without``: drones left behind on purpose; problems that concern only these drones are ignored.
    """
    found = {name: [text for text in statuses[name].texts.problems if text.about not in without] for name in drones}
    told = [f"{name}: {', '.join(texts)}" for name, texts in found.items() if texts]
    if told:
        raise CommandError(f"not started: {'; '.join(told)} (--anyway starts those that can)")


def _message(action: Action, trust: Trust | None, stamp_ns: int, mission: str, to: dict[str, Ticket]) -> Command:
    message = Command(stamp_ns=stamp_ns, station=station_name(trust), mission=mission, action=action, to=to)
    return message if trust is None else sign_command(message, trust)


async def _send_until_done(
    mesh: Mesh, order: Order, trust: Trust | None, tickets: Tickets, given_s: float, withdrawn: Set[str]
) -> None:
    """Send a command again and again, until it lapses: copies have the same stamp, nonces and numbers.

    A command that brings the vehicles down is numbered anew each time: it must not fail because another operator's command came
    first. No copy goes to a drone that has obeyed: the safety pilot may have the vehicle by then. A drone that is landing gets
    ``land`` once: on the ground its agent disarms then.
    """
    statuses, obeyed = tickets.statuses, set[str]()
    to_disarm = {name for name in tickets.drones if (order.action, statuses[name].stage) == (Action.LAND, Stage.LANDING)}
    due_s, stamp_ns = 0.0, time.time_ns()
    while True:
        addressed = [name for name in tickets.drones if name not in withdrawn]
        waiting = [name for name in addressed if name in to_disarm or statuses[name].stage not in _DONE[order.action]]
        obeyed.update(name for name in addressed if name not in waiting)
        if not waiting:
            return
        now_s = elapsed_s()
        if now_s > given_s + OBEY_S:
            raise CommandError("; ".join(tickets.why(order.action, name) for name in waiting))
        if due_s <= now_s < given_s + LAPSE_S:
            due_s = now_s + REPEAT_S
            if order.action in _COMING_DOWN:
                tickets.renumber([name for name in waiting if name not in obeyed])
            for mission, names in _by_mission(addressed, statuses).items():
                if to := tickets.to(names):
                    message = _message(order.action, trust, stamp_ns, mission, to)
                    mesh.publish(key_of(order.swarm, message), encode(message))
                    to_disarm -= to.keys()
                    await asyncio.sleep(PAUSE_S)
        await asyncio.sleep(0.05)
