"""By how much the drones' clocks differ, from the delays of their statuses. No stamp is ever altered by it.

Two drones that hear each other know both delays: its own clock at the arrival less the stamp, on either side. Half their
difference is by how much the one clock is ahead, as in NTP (RFC 5905, section 8); half of what the two ways differ by remains
in it. The least delay of the last seconds is taken, because what waits in a queue only ever arrives later.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from statistics import median_high, median_low

from protocol.messages import Status

WINDOW_NS = 10_000_000_000
LIMIT_S = 0.05  # beyond, a drone says so and doubts its own places
_MOST_DELAY_NS = 2**62  # as of the message


class Clocks:
    """What one drone has heard of the other drones' clocks."""

    def __init__(self, drone: str, others: Iterable[str]) -> None:
        self._drone = drone
        self._heard: dict[str, deque[tuple[int, int]]] = {name: deque() for name in others}  # arrival, delay
        self._returned: dict[str, int] = {}  # what each says of this drone's delay
        # Of the own clock against the median of all that are known, the own included. Where they fall into halves (two drones),
        # nobody can tell which is right: then against the other half, on both sides.
        self.offset_s = 0.0

    def hear(self, status: Status, now_ns: int) -> None:
        """A status has arrived, ``now_ns`` by the own clock. Copies and late ones do no harm: only the least delay counts."""
        heard, delay_ns = self._heard.get(status.drone), now_ns - status.stamp_ns
        if heard is None or abs(delay_ns) > _MOST_DELAY_NS:
            return
        if heard and now_ns < heard[-1][0]:  # the own clock was set back: what was measured with it before is void
            heard.clear()
        while heard and heard[-1][1] >= delay_ns:  # they can never be the least again
            heard.pop()
        heard.append((now_ns, delay_ns))
        if self._drone in status.delays_ns:
            self._returned[status.drone] = status.delays_ns[self._drone]
        else:
            self._returned.pop(status.drone, None)
        offsets_s = (0.0, *self.offsets_s(now_ns).values())
        self.offset_s = max(median_low(offsets_s), median_high(offsets_s), key=abs)

    def delays_ns(self, now_ns: int) -> dict[str, int]:
        """The least delay of each drone heard in the last seconds: what this drone tells of them."""
        found = {}
        for name, heard in self._heard.items():
            while heard and abs(now_ns - heard[0][0]) > WINDOW_NS:
                heard.popleft()
            if heard:
                found[name] = heard[0][1]
        return found

    def offsets_s(self, now_ns: int) -> dict[str, float]:
        """By how much the own clock is ahead of each drone's from which both delays are known."""
        delays = self.delays_ns(now_ns)
        return {name: 0.5e-9 * (delays[name] - self._returned[name]) for name in delays if name in self._returned}

    def problem(self, now_ns: int) -> str | None:
        """What is to be said of the own clock, or None."""
        if abs(self.offset_s) <= LIMIT_S:
            return None
        ahead = self.offset_s > 0.0
        far = [name for name, offset_s in self.offsets_s(now_ns).items() if (offset_s > 0.0) is ahead and abs(offset_s) > LIMIT_S]
        direction = "ahead of" if ahead else "behind"
        return f"its clock is {abs(self.offset_s):.2f} s {direction} {', '.join(far) or 'the others'}: see chrony"

    def sigma_m(self, speed_mps: float) -> float:
        """By how much a place is doubted whose stamp is as wrong as the own clock, where that is beyond the limit."""
        return 0.0 if abs(self.offset_s) <= LIMIT_S else speed_mps * abs(self.offset_s)
