"""Statuses of the drones on an operator's computer, and the tickets that orders need, each of one moment."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Collection

from msgspec.structs import replace

from radron.agent.outputs import printable
from radron.protocol.codec import decode_from
from radron.protocol.elapsed import elapsed_s
from radron.protocol.errors import ProtocolError
from radron.protocol.identity import Identity
from radron.protocol.keys import parse_key
from radron.protocol.messages import MAX_ORDER_AGE_NS, Action, Stage, Status, Ticket
from radron.protocol.signing import Verifier

LAPSE_S = MAX_ORDER_AGE_NS * 1e-9  # age of an order at which all drones refuse it
FRESH_S = 3.0
CLOCKS_S = 3.0  # clock difference that is reported: a start is refused once it is too old
MAX_NAMES = 5  # of drones with unsigned statuses


class Statuses:
    """Stores the newest status message of each drone on an operator's computer, and checks the signatures.

    ``unsigned``: names of drones in whose names unsigned statuses arrived.
    """

    def __init__(self, identity: Identity | None = None) -> None:
        """Start without statuses. ``identity``: this computer's; None: the swarm has no certificates, and nothing is verified."""
        self._verifier = Verifier(identity.authority) if identity is not None else None
        self.unsigned: set[str] = set()
        self._newest: dict[str, Status] = {}
        self._heard_s: dict[str, float] = {}  # since this computer's start: a wrong UTC clock must not prevent a landing
        self._ahead_s: dict[str, float] = {}
        self._tickets: dict[str, deque[tuple[float, Ticket | None]]] = {}  # with their arrival, of the last seconds

    def ticket(self, drone: str, at_s: float | None = None) -> Ticket | None:
        """Return the ticket (data that a command must carry once) in a drone's newest status.

        ``at_s``: in the newest status that had arrived by this time (``elapsed_s``).
        """
        if at_s is None:
            return self._newest[drone].ticket
        return next((ticket for heard_s, ticket in reversed(self._tickets.get(drone, ())) if heard_s <= at_s), None)

    def receive(self, key: str, payload: bytes) -> bool:
        """Take a message of the radio network; return whether it is a valid status: signed by its drone, and no replay."""
        try:
            if parse_key(key).kind != "status":
                return False
            message = decode_from(key, payload)
        except ProtocolError:
            return False
        if not isinstance(message, Status):
            return False
        if self._verifier is not None and not self._verifier.accepts_status(message):
            self.unsigned = {*sorted(self.unsigned)[:MAX_NAMES], message.drone}
            return False
        known = self._newest.get(message.drone)
        if known is not None and message.stamp_ns <= known.stamp_ns and message.drone in self.heard():
            return False  # valid after a pause: the drone's clock may have stepped backward
        self._newest[message.drone] = legible(message)
        self._heard_s[message.drone] = now_s = elapsed_s()
        tickets = self._tickets.setdefault(message.drone, deque())
        tickets.append((now_s, message.ticket))
        while len(tickets) > 1 and tickets[1][0] < now_s - LAPSE_S:
            tickets.popleft()
        self._ahead_s[message.drone] = (message.stamp_ns - time.time_ns()) * 1e-9
        return True

    def __getitem__(self, drone: str) -> Status:
        return self._newest[drone]

    def heard(self) -> list[str]:
        """Return the names of the drones whose status arrived recently."""
        oldest_s = elapsed_s() - FRESH_S
        return sorted(name for name, heard_s in self._heard_s.items() if heard_s > oldest_s)

    def clock_ahead_s(self, drone: str) -> float:
        """Return the time (s) by which a drone's clock is ahead of this computer's; it includes the delay of the newest
        status.
        """
        return self._ahead_s[drone]


class Tickets:
    """The tickets of one command for its drones: data from a drone's status, by which the drone refuses old or repeated commands.

    All copies of the command carry the nonces (random numbers) published by the time of the command, and its numbers. Every drone
    therefore refuses each copy ``MAX_ORDER_AGE_NS`` after the command, for any delay on the way.
    """

    def __init__(self, statuses: Statuses, drones: Collection[str], given_s: float) -> None:
        """Take the tickets of the drones. ``given_s``: when the command was given (``elapsed_s``)."""
        self.statuses, self.drones = statuses, tuple(drones)
        self._tickets = {name: ticket for name in drones if (ticket := statuses.ticket(name, given_s)) is not None}

    def to(self, drones: Collection[str]) -> dict[str, Ticket]:
        """Return the tickets for a copy of the command to these drones, without drones that published no ticket."""
        return {name: self._tickets[name] for name in drones if name in self._tickets}

    def renumber(self, drones: Collection[str]) -> None:
        """Give the command a new number for these drones, above the number of the commands that they have carried out
        meanwhile.
        """
        for name, ticket in self.to(drones).items():
            newest = self.statuses.ticket(name)
            self._tickets[name] = ticket if newest is None else replace(ticket, number=newest.number)

    def is_overtaken(self, drone: str) -> bool:
        """Return whether a drone has carried out another command since this one was numbered."""
        newest, own = self.statuses.ticket(drone), self._tickets.get(drone)
        return newest is not None and own is not None and newest.number > own.number

    def why(self, action: Action, drone: str) -> str:
        """Return the probable reason why a drone has not obeyed, in one line."""
        status, ahead_s = self.statuses[drone], self.statuses.clock_ahead_s(drone)
        if drone not in self.statuses.heard():
            return f"{drone}: no longer heard"
        if drone not in self._tickets:
            return f"{drone}: its status tells no nonce, without which no command is obeyed"
        if self.is_overtaken(drone) and action is Action.RESUME:  # a refused number is used up, too
            return f"{drone}: resume was not possible, or another command came first (now in {status.stage})"
        if self.is_overtaken(drone):
            return f"{drone}: another command came first: give this one again"
        if action is Action.START and abs(ahead_s) > CLOCKS_S:
            return f"{drone}: its clock differs by {ahead_s:+.1f} s from this computer's: synchronise both"
        if action is Action.START and status.stage is Stage.PREFLIGHT and status.problems:
            return f"{drone}: {', '.join(status.problems)}"
        return f"{drone}: {action} is not possible in {status.stage}, or came too late and was dropped"


def legible(status: Status) -> Status:
    """Return a status with texts that are safe on a terminal, without control characters."""
    problems, notices = (tuple(map(printable, texts)) for texts in (status.problems, status.notices))
    upload = None if status.upload is None else replace(status.upload, refused=printable(status.upload.refused))
    return replace(status, problems=problems, notices=notices, finding=printable(status.finding), upload=upload)
