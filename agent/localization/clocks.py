"""How far the drones' clocks differ, from the delays of their status messages. No time stamp is ever corrected by it.

Two drones that hear each other know both apparent delays: own clock at the arrival minus the stamp, on either side. Half their
difference is the clock offset, as in NTP (RFC 5905, section 8); its error is half the asymmetry of the two ways. The smallest
delay of the last seconds is used, because queueing only ever makes a message later.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from statistics import median_high, median_low

from protocol.messages import Status

WINDOW_NS = 10_000_000_000
HEARD_NS = 3_000_000_000  # three periods of the statuses: who is silent for longer is not heard any more
LIMIT_S = 0.05  # a drone with a larger offset reports it, and adds it to the uncertainty of its position
MOST_LATENCY_NS = 2_000_000_000  # of a status; two delays whose mean is further from 0 are not believed
MOST_SIGMA_M = 1_000.0  # whatever the clocks say, a drone can tell where it is
_MOST_DELAY_NS = 2**62  # the limit of the message's field


class Clocks:
    """What one drone has heard of the other drones' clocks."""

    def __init__(self, drone: str, others: Iterable[str]) -> None:
        self._drone = drone
        self._heard: dict[str, deque[tuple[int, int]]] = {name: deque() for name in others}  # arrival, delay
        self._returned: dict[str, tuple[int, int]] = {}  # arrival, and this drone's delay as each of them reports it
        self._behind_ns: dict[str, int] = {}  # how far the own clock is behind theirs, as last known
        # Offset of the own clock from the median of all known clocks, its own included. Where they split into halves (two drones)
        # nobody can tell which half is right: then the offset from the other half, on both sides.
        self.offset_s = 0.0

    def hear(self, status: Status, now_ns: int) -> None:
        """Take a status that arrived at ``now_ns``, own clock. Duplicates and late ones do no harm: the smallest delay counts."""
        heard, delay_ns = self._heard.get(status.drone), now_ns - status.stamp_ns
        if heard is None or abs(delay_ns) > _MOST_DELAY_NS:
            return
        if heard and now_ns < heard[-1][0]:  # the own clock was set back: earlier measurements are void
            heard.clear()
        while heard and heard[-1][1] >= delay_ns:  # they can never be the smallest again
            heard.pop()
        heard.append((now_ns, delay_ns))
        if self._drone in status.delays_ns:
            self._returned[status.drone] = now_ns, status.delays_ns[self._drone]
        known = self.offsets_s(now_ns)
        self._behind_ns = {name: max(0, round(-1e9 * offset_s)) for name, offset_s in known.items()}
        offsets_s = (0.0, *known.values())
        self.offset_s = max(median_low(offsets_s), median_high(offsets_s), key=abs)

    def delays_ns(self, now_ns: int) -> dict[str, int]:
        """The smallest delay of each drone that is heard, as this drone publishes it."""
        delays = self._delays_ns(now_ns)
        return {name: delay_ns for name, delay_ns in delays.items() if now_ns - self._heard[name][-1][0] < HEARD_NS}

    def offsets_s(self, now_ns: int) -> dict[str, float]:
        """How far the own clock is ahead of each drone's for which both delays are known, and can belong together."""
        returned = {name: delay_ns for name, (at_ns, delay_ns) in self._returned.items() if abs(now_ns - at_ns) <= WINDOW_NS}
        delays = self._delays_ns(now_ns)
        fitting = [name for name in delays if name in returned and abs(delays[name] + returned[name]) <= 2 * MOST_LATENCY_NS]
        return {name: 0.5e-9 * (delays[name] - returned[name]) for name in fitting}

    def _delays_ns(self, now_ns: int) -> dict[str, int]:
        """The smallest delay of each drone heard in the last seconds."""
        found = {}
        for name, heard in self._heard.items():
            while heard and abs(now_ns - heard[0][0]) > WINDOW_NS:
                heard.popleft()
            if heard:
                found[name] = heard[0][1]
        return found

    def behind_ns(self, drone: str) -> int:
        """How far the own clock is behind another drone's, as far as that is known; 0 where it is not."""
        return self._behind_ns.get(drone, 0)

    def problem(self, now_ns: int) -> str | None:
        """The problem of the own clock reported to the operator; None while it is right."""
        if abs(self.offset_s) <= LIMIT_S:
            return None
        ahead = self.offset_s > 0.0
        far = [name for name, offset_s in self.offsets_s(now_ns).items() if (offset_s > 0.0) is ahead and abs(offset_s) > LIMIT_S]
        direction = "ahead of" if ahead else "behind"
        return f"its clock is {abs(self.offset_s):.2f} s {direction} {', '.join(far) or 'the others'}: check chrony"

    def sigma_m(self, speed_mps: float) -> float:
        """1 sigma that the own clock's offset adds to a position at this speed; 0 within the limit."""
        return 0.0 if abs(self.offset_s) <= LIMIT_S else min(speed_mps * abs(self.offset_s), MOST_SIGMA_M)
