"""What operators have ordered, as a station hears it: who, what, and which drones have obeyed.

A drone does not answer a command: its statuses tell a number above that of the last one that it has carried out. Uploads it
answers. What a drone made of an order that it refused, only its record tells. Stations have no links to each other, so that
another operator's order may be heard of only by these numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from protocol.messages import Command, Order, Status, Upload
from protocol.signing import Member, Verifier

OBEYED, UNSURE, TAKEN = "obeyed", "obeyed, or overtaken by another order", "taken over"
ANOTHER = "another station"
LATE_NS = 5_000_000_000  # for so long an order may come later than the status of a drone that has carried it out
OPEN_NS = 30_000_000_000  # after its last copy an order is obeyed no more: the nonces in it have lapsed
MOST_ORDERS = 1000
MOST_REFUSED = 100


@dataclass(slots=True)
class Heard:
    """An order and its copies.

    ``first_ns``, ``last_ns``: when they came. ``signer``: whose certificate they carry; None: nobody's of this swarm.
    ``refused``: why no drone obeys it, as their counters name it. By drone: ``numbers``, of the last copy; ``results``, if known.
    """

    first_ns: int
    last_ns: int
    station: str
    action: str
    signer: Member | None
    refused: str = ""
    numbers: dict[str, int] = field(default_factory=dict)
    results: dict[str, str] = field(default_factory=dict)
    copies: int = 0


class Orders:
    """Those of all stations that are heard, in the order of their arrival. ``own``: this station, whose orders are no news."""

    def __init__(self, verifier: Verifier | None) -> None:
        """``verifier``: of their signatures; None: in a swarm without certificates, where anybody commands."""
        self.own = ""
        self._verifier = verifier
        self._heard: dict[tuple[object, ...], Heard] = {}
        self._uploads: dict[int, Heard] = {}  # by stamp
        self._last: dict[str, int] = {}  # number of the last order that a drone has carried out
        self._unheard: dict[str, tuple[int, int, str]] = {}  # by drone: number of an order that was not heard, since when, stage
        self._refused = 0
        self._news: list[Heard] = []

    @property
    def heard(self) -> tuple[Heard, ...]:
        """All of them."""
        return tuple(self._heard.values())

    def news(self) -> list[Heard]:
        """Those that have come since the last call."""
        news, self._news = self._news, []
        return news

    def take(self, order: Order, now_ns: int) -> None:
        """Note an order. Of those that nobody obeys, one is noted for each station and reason, and a bounded number in all."""
        refused = self._verifier.refusal(order, now_ns) if self._verifier is not None else None
        action = order.action if isinstance(order, Command) else f"upload {order.mission}"
        key = (order.station, refused) if refused else (order.station, order.certificate, order.stamp_ns, action)
        known = self._heard.get(key)
        if known is None:
            if refused and self._refused >= MOST_REFUSED:
                return
            self._refused += refused is not None
            signer = self._verifier.signer(order) if self._verifier is not None else None
            known = self._heard[key] = Heard(now_ns, now_ns, order.station, str(action), signer, refused or "")
            self._news += [known] if order.station != self.own else []
            self._forget()
        known.last_ns, known.copies = now_ns, known.copies + 1
        for drone, ticket in order.to.items():
            if drone not in known.results:
                known.numbers[drone] = ticket.number
                if ticket.number <= self._last.get(drone, 0) and not refused:  # an old one, or its drone was faster
                    number, _, _ = self._unheard.get(drone, (-1, 0, ""))
                    known.results[drone] = OBEYED if ticket.number == number else UNSURE
                    if ticket.number == number:
                        del self._unheard[drone]
        if isinstance(order, Upload) and not refused:
            self._uploads[order.stamp_ns] = known

    def hear(self, status: Status, now_ns: int) -> None:
        """Note what a drone tells of the orders to it."""
        drone, answer = status.drone, status.upload
        if answer is not None and (asked := self._uploads.get(answer.stamp_ns)) is not None and drone in asked.numbers:
            asked.results[drone] = f"refused: {answer.refused}" if answer.refused else TAKEN
        if status.ticket is None:
            return
        before, last = self._last.get(drone), status.ticket.number - 1
        self._last[drone] = last
        done = [one for one in self._open(drone, now_ns) if one.numbers[drone] <= last]
        certain = [one for one in done if one.numbers[drone] == last]
        for one in done:
            one.results[drone] = OBEYED if certain == [one] else UNSURE
        if before is not None and last > before and not certain:
            self._unheard[drone] = last, now_ns, str(status.stage)
        self._tell_unheard(drone, now_ns)

    def _tell_unheard(self, drone: str, now_ns: int) -> None:
        """Note an order of another station, of which nothing but its effect is heard."""
        number, since_ns, stage = self._unheard.get(drone, (0, now_ns, ""))
        if now_ns - since_ns < LATE_NS:
            return
        del self._unheard[drone]
        known = Heard(since_ns, since_ns, ANOTHER, f"an order, then {stage}", None, "", {drone: number}, {drone: OBEYED}, 1)
        self._heard[ANOTHER, drone, number, since_ns] = known
        self._news.append(known)
        self._forget()

    def _open(self, drone: str, now_ns: int) -> list[Heard]:
        """Those to a drone of which it is not known what became of them."""
        return [
            one
            for one in self._heard.values()
            if now_ns - one.last_ns < OPEN_NS and not one.refused and drone in one.numbers and drone not in one.results
        ]

    def _forget(self) -> None:
        """The oldest, where there are too many."""
        for key in list(self._heard)[: len(self._heard) - MOST_ORDERS]:
            gone = self._heard.pop(key)
            self._refused -= bool(gone.refused)
            self._uploads = {stamp: one for stamp, one in self._uploads.items() if one is not gone}
