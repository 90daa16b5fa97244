"""Orders of all operators, as a station knows them: signer, action, and the drones that have obeyed.

Stations have no links to each other, so another operator's order is known from the drones' reports: a status names the last order
that its drone has obeyed. Older drones report only a number above the number of the last order. Uploads are answered. A drone's
refusal of an order is only in the drone's record.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from msgspec import UNSET
from msgspec.structs import replace

from radron.protocol.messages import Command, Obeyed, Order, Status, Upload
from radron.protocol.signing import Member, Verifier

OBEYED, UNSURE, TAKEN = "obeyed", "obeyed, or overtaken by another order", "taken over"
OVERTAKEN = "overtaken by another order"
ANOTHER = "another station"
MAX_REPORT_DELAY_NS = 5_000_000_000  # largest delay of an order after the status of a drone that has carried it out
GATHER_NS = 1_500_000_000  # within this time all drones that have obeyed an order report it
OPEN_NS = 30_000_000_000  # this long after its last copy an order is obeyed no more: its nonces have lapsed
MAX_ORDERS = 1000
MAX_REFUSED_ORDERS = 100
MAX_OBEYED_OF_DRONE = 100  # reported by one drone alone, whether true or not

Key = tuple[object, ...]


@dataclass(slots=True)
class Heard:
    """An operator's order, such as a command to land, as a station knows it.

    ``first_ns``, ``last_ns``: arrival of the first and the last copy, as an order is repeated. ``signer``: the member that has
    signed; None: no member of this swarm, or unknown. ``told``: known only from reports of drones that have obeyed. ``refused``:
    why no drone obeys, by the name of the drones' counter. ``numbers``: by drone, the number in the last copy; ``results``: by
    drone, what it did, if known.
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
    told: bool = False


class Orders:
    """Collects the orders of all stations, in the order of their arrival at this station.

    ``own``: name of this station; its own orders are not reported as new.
    """

    def __init__(self, verifier: Verifier | None) -> None:
        """``verifier``: checks the orders' signatures; None: in a swarm without certificates, where every station may command."""
        self.own = ""
        self._verifier = verifier
        self._heard: dict[Key, Heard] = {}
        self._uploads: dict[int, Heard] = {}  # by stamp
        self._last: dict[str, int] = {}  # by drone: number of the last order carried out
        self._obeyed: dict[str, Obeyed] = {}  # by drone: the last order as reported, without its signature
        self._unheard: dict[str, tuple[int, int, str]] = {}  # by drone: number of an order not received here, time, stage
        self._refused = 0
        self._told: Counter[str] = Counter()
        self._news: list[Heard] = []

    @property
    def heard(self) -> tuple[Heard, ...]:
        """All orders collected so far."""
        return tuple(self._heard.values())

    def news(self, now_ns: int) -> list[Heard]:
        """Return the orders that are new since the last call.

        An order that only drones have reported comes after ``GATHER_NS``, when all drones that have obeyed have reported it.
        """
        news, self._news = self._news, []
        ready: list[Heard] = []
        for one in news:
            (self._news if one.told and abs(now_ns - one.last_ns) < GATHER_NS else ready).append(one)
        return ready

    def take(self, order: Order, now_ns: int) -> None:
        """Record an order that has arrived.

        Refused orders are recorded once for each station and reason, and in limited number.
        """
        refused = self._verifier.refusal(order, now_ns) if self._verifier is not None else None
        key = (order.station, refused) if refused else (order.station, order.stamp_ns, _name(order))
        known = self._heard.get(key)
        if known is None:
            if refused and self._refused >= MAX_REFUSED_ORDERS:
                return
            self._refused += refused is not None
            known = Heard(now_ns, now_ns, order.station, "", None, refused or "")
            self._add(key, known)
        if known.copies == 0:
            name = _name(order)
            known.action = name if isinstance(order, Command) else f"{name} {order.mission}"
            known.signer = self._verifier.signer(order) if self._verifier is not None else None
            known.told = False
        known.last_ns, known.copies = now_ns, known.copies + 1
        for drone, ticket in order.to.items():
            if drone not in known.results:
                known.numbers[drone] = ticket.number
                if ticket.number <= self._last.get(drone, 0) and not refused:  # an old order, or the drone's status was faster
                    known.results[drone] = self._before(drone, ticket.number)
        if isinstance(order, Upload) and not refused:
            self._uploads[order.stamp_ns] = known

    def hear(self, status: Status, now_ns: int) -> None:
        """Record what a drone's status says about the orders addressed to this drone."""
        if status.ticket is not None:
            self._hear(status, status.ticket.number - 1, now_ns)
        drone, answer = status.drone, status.upload
        if answer is not None and (asked := self._uploads.get(answer.stamp_ns)) is not None and drone in asked.numbers:
            asked.results[drone] = f"refused: {answer.refused}" if answer.refused else TAKEN

    def _hear(self, status: Status, last: int, now_ns: int) -> None:
        """Update the orders' results by number and name of the ``last`` order obeyed."""
        drone = status.drone
        before = self._last.get(drone)
        self._last[drone] = last
        done = [one for one in self._open(drone, now_ns) if one.numbers[drone] <= last]
        named = self._named(status, last, before is None, now_ns)
        certain = [named] if named is not None else [one for one in done if one.numbers[drone] == last]
        for one in done:
            if one is not named:
                is_other = named is not None and one.numbers[drone] == last
                one.results[drone] = OVERTAKEN if is_other else OBEYED if certain == [one] else UNSURE
        if before is not None and last > before and not certain:
            self._unheard[drone] = last, now_ns, str(status.stage)
        self._tell_unheard(drone, now_ns)

    def _named(self, status: Status, last: int, is_first: bool, now_ns: int) -> Heard | None:
        """Return the last order obeyed by name of a status; None if the status names no order, or the same order as before.

        ``is_first``: the drone's first status here, so that it may have obeyed long ago.
        """
        drone, obeyed = status.drone, status.obeyed
        if obeyed is UNSET or obeyed.number != last:
            self._obeyed.pop(drone, None)
            return None
        bare = replace(obeyed, signature=b"")
        if self._obeyed.get(drone) == bare or (self._verifier is not None and not self._verifier.accepts_obeyed(status)):
            return None
        self._obeyed[drone] = bare
        key = (obeyed.station, obeyed.stamp_ns, obeyed.order)
        known = self._heard.get(key)
        if known is None:
            if self._told[drone] >= MAX_OBEYED_OF_DRONE:
                return None
            self._told[drone] += 1
            at_ns = min(now_ns, obeyed.stamp_ns) if is_first else now_ns
            known = Heard(at_ns, now_ns, obeyed.station, obeyed.order, None, told=True)
            self._add(key, known)
        known.numbers[drone], known.results[drone] = last, OBEYED
        if obeyed.order == "upload":
            self._uploads[obeyed.stamp_ns] = known  # the mission is fetched, and may be refused, only later
        return known

    def _before(self, drone: str, number: int) -> str:
        """Return the result of an order received after a drone's status with this order's number or a higher number."""
        if drone in self._obeyed and self._obeyed[drone].number == number:
            return OVERTAKEN
        unheard, _, _ = self._unheard.get(drone, (-1, 0, ""))
        if number != unheard:
            return UNSURE
        del self._unheard[drone]
        return OBEYED

    def _tell_unheard(self, drone: str, now_ns: int) -> None:
        """Note an order of another station known from its effect alone."""
        number, since_ns, stage = self._unheard.get(drone, (0, now_ns, ""))
        if now_ns - since_ns < MAX_REPORT_DELAY_NS:
            return
        del self._unheard[drone]
        if self._told[drone] < MAX_OBEYED_OF_DRONE:
            self._told[drone] += 1
            action, results = f"an order, then {stage}", {drone: OBEYED}
            known = Heard(since_ns, since_ns, ANOTHER, action, None, "", {drone: number}, results, 1)
            self._add((ANOTHER, drone, number, since_ns), known)

    def _open(self, drone: str, now_ns: int) -> list[Heard]:
        """Return the orders to a drone without a known result."""
        return [
            one
            for one in self._heard.values()
            if now_ns - one.last_ns < OPEN_NS and not one.refused and drone in one.numbers and drone not in one.results
        ]

    def _add(self, key: Key, known: Heard) -> None:
        """Add a new order; above ``MAX_ORDERS`` the oldest is forgotten."""
        self._heard[key] = known
        self._news += [known] if known.station != self.own else []
        for old in list(self._heard)[: len(self._heard) - MAX_ORDERS]:
            gone = self._heard.pop(old)
            self._refused -= bool(gone.refused)
            self._uploads = {stamp: one for stamp, one in self._uploads.items() if one is not gone}


def _name(order: Order) -> str:
    """Return an order's name as in a status."""
    return str(order.action) if isinstance(order, Command) else "upload"
