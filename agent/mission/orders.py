"""The commands that reach this drone's mission: signed by an operator, for this mission, and not sent before.

A command carries, for each drone that it addresses, a ticket from that drone's status at the time the command was given. The
ticket is a nonce, and a number above that of the last command carried out. The drone changes the nonce twice a second by its own
time, and never uses it again after a restart. So neither a recorded nor a delayed nor a reordered command is obeyed, and none
given more than ``MAX_ORDER_AGE_NS`` ago, by the drone's own time alone. The operator's clock only matters for a start, whose
stamp is the beginning of the swarm's mission.

Nonces follow from a key that each agent draws at its start. Before their publication they are secret: a brief hold of an
operator's key is not enough to sign commands for later.
"""

from __future__ import annotations

from hashlib import blake2b

from radron.agent.owntime import Utc
from radron.protocol.messages import MAX_ORDER_AGE_NS, Action, Command, Obeyed, Order, Ticket
from radron.protocol.signing import Verifier

NONCE_NS = 500_000_000  # a nonce is published for this long, and valid until MAX_ORDER_AGE_NS after it was first published
START_AGE_NS = 10_000_000_000  # by its stamp, the mission's beginning: a start by a clock that differs more is refused
MOST_AHEAD = 2**40  # of a number: a command with the largest one would leave none for the commands after it


class Orders:
    """The commands to one drone. ``obeyed``: the last command carried out, for the status."""

    def __init__(
        self,
        drone: str,
        mission_id: str,
        nonce_key: bytes,
        verifier: Verifier | None,
        utc: Utc,
        tells_obeyed: bool = True,
    ) -> None:
        """``nonce_key``: random, up to 64 bytes. ``verifier`` None: the swarm has no certificates, and commands no signatures.
        ``tells_obeyed``: whether ``obeyed`` is kept.
        """
        self._drone, self._mission_id, self._nonce_key = drone, mission_id, nonce_key
        self._verifier, self._utc = verifier, utc
        self._last = 0  # number of the last command carried out
        self._tells_obeyed = tells_obeyed
        self.obeyed: Obeyed | None = None

    def ticket(self, now_ns: int) -> Ticket:
        """Return the ticket for the next command, as published in the status."""
        return Ticket(self._nonce(now_ns // NONCE_NS), self._last + 1)

    def refusal(self, command: Order, now_ns: int) -> str | None:
        """Why a command must not be carried out, or None: then ``note`` follows once it is."""
        if isinstance(command, Command) and command.mission != self._mission_id:
            return "of_another_mission"
        ticket = command.to.get(self._drone)
        if ticket is None:
            return "to_others"
        if self._verifier is not None:
            refused = self._verifier.refusal(command, self._utc.of(now_ns))
            if refused is not None:
                return refused
        if ticket.nonce not in self._valid(now_ns // NONCE_NS):
            return "too_old"
        if ticket.number <= self._last:
            return "already_obeyed"
        if ticket.number > self._last + MOST_AHEAD:
            return "numbered_too_high"
        is_start = isinstance(command, Command) and command.action is Action.START
        if is_start and abs(self._utc.of(now_ns) - command.stamp_ns) > START_AGE_NS:
            return "too_old"
        return None

    def use_up(self, command: Order) -> None:
        """No command with this one's number, or a lower one, is carried out any more."""
        self._last = command.to[self._drone].number

    def note(self, command: Order) -> None:
        """A command has been carried out."""
        self.use_up(command)
        if self._tells_obeyed:
            order = str(command.action) if isinstance(command, Command) else "upload"
            self.obeyed = Obeyed(order, command.station, command.stamp_ns, self._last)

    def _valid(self, present: int) -> list[str]:
        """Nonces that were published within the last ``MAX_ORDER_AGE_NS``."""
        return [self._nonce(present - age) for age in range(MAX_ORDER_AGE_NS // NONCE_NS)]

    def _nonce(self, period: int) -> str:
        return blake2b(str(period).encode(), key=self._nonce_key, digest_size=8).hexdigest()
