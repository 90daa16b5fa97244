"""Clock offsets between the drones, from the delays of their status messages. Stamps of log entries are never corrected by them.

**Offset.** The apparent delay of a message is the receiver's clock at the arrival minus the stamp. Each drone publishes the
delays that it measures, so two drones with a two-way link know the delays of both directions. Half their difference is the clock
offset, as in NTP (RFC 5905, section 8); its error is half the difference of the true delays. Of each direction the smallest delay
of the last seconds counts, because queueing only makes messages later.

**Clock steps.** The two delays add up to the round trip time, which cannot be negative. If the sum is, one of the clocks has been
set in these seconds, and the larger delay is from before that. The drone that measured it finds that its newest delay fits, and
forgets the older ones. So after a clock step the offset is known again after one exchange of statuses, however long delays are
kept. A forged delay alone changes nothing.

**Changing delays.** When delays change, the smallest delays of the two directions may belong to different times for some seconds.
Then half their difference is wrong by half of the change. As long as the former offset is consistent with both delays, it is kept
for these seconds.

**Own time.** All times here are own time (``owntime``), which a step of the own clock does not move. So the known offsets of
other clocks from it stay. But until the others have received a status with a new stamp, they report a delay by the former clock.

**Common time** is the time by the majority of the clocks. If most clocks are set back, the common time steps back, too. A clock
that was right before, and was not set back, has stamped measurements at times that the common time has not reached again yet,
while the drones were at other places. Until it has reached them, all new measurements count as wrong by the step. Without such a
clock all stamps of the former time are void (``sensing.numbering``), and the source estimate follows the common time back.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from math import hypot, sqrt
from statistics import median_high, median_low
from typing import TypeVar

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.owntime import Utc
from radron.protocol.codes import Code
from radron.protocol.messages import Plan, Pose, Status
from radron.protocol.texts import CodedText

N = TypeVar("N", bound=Pose | Plan | Status)

WINDOW_NS = 10_000_000_000
HEARD_NS = 3_000_000_000  # three periods of the statuses; delays of a drone that is silent for longer are not published
LIMIT_S = 0.05  # a drone whose clock is off by more reports it, and adds the offset to its position uncertainty
MOST_LATENCY_NS = 2_000_000_000  # two delays with a larger mean are not used
MOST_SIGMA_M = 1_000.0  # limit of the position uncertainty by a clock error
_LEAST_TRIP_NS = -50_000_000  # least sum of both delays: clocks drift, and a status reports delays of a second ago
# A former offset that is still consistent with both delays is kept for this long against a new value. Statuses come once a
# second, so the smallest delays of the two directions are at most a second apart; one status may be lost, and the next one late.
_HELD_NS = 5_000_000_000
_SET_BACK_NS = 1_000_000_000  # least backward step of the common time; its estimates differ by less
_AGAIN_NS = 2_000_000_000  # a backward step is over when the common time is so far beyond the last agreement with other clocks
_MOST_DELAY_NS = 2**62  # the limit of the message's field


class _Held(Struct, frozen=True):
    """Lead of own time over another clock, and the stamp since which the delays have given another value; None: they agree."""

    ahead_ns: int
    doubted_ns: int | None = None


class Clocks:
    """Clocks of the other drones, relative to this one's.

    utc: conversion of own time to the own clock.
    offset_s: lead of the own clock over the median of all known clocks, its own included. If the clocks split into halves, as
        those of two drones, no half is known to be right; then it is the lead over the other half, on both sides.
    """

    def __init__(self, drone: str, others: Iterable[str]) -> None:
        self._drone, self.utc = drone, Utc()
        self._heard: dict[str, deque[tuple[int, int]]] = {name: deque() for name in others}  # arrival and delay of statuses
        self._returned: dict[str, tuple[int, int]] = {}  # arrival of a report, and the delay of this drone's statuses in it
        self._held: dict[str, _Held] = {}
        self._ahead_ns: dict[str, int] = {}  # lead of each other clock over the own one, where beyond the limit
        self._known: dict[str, int] = {}  # lead of own time over each other clock, by the last statuses
        self._since_ns: dict[str, int] = {}  # step of the own clock, by drone that may report a delay by the former clock
        self._stepped_ns = 0  # stamp of the last such step
        self._outvoted_s = 0.0  # lead of the own clock over the common time; 0 unless the own clock is known to be wrong
        self._agreed_ns: dict[str, int] = {}  # the common time at which each clock last agreed with it
        self._back_s = 0.0  # backward step of the common time, while a clock has stamped later measurements
        self._followed_ns = 0
        self.offset_s = 0.0

    def hear(self, status: Status, now_ns: int) -> bool:
        """Process a status that arrived at ``now_ns`` (own time). Duplicates and late statuses do no harm.

        Return whether it shows a step of one of the clocks: then the other drone waits for the new delay.
        """
        name, delay_ns = status.drone, now_ns - status.stamp_ns
        heard = self._heard.get(name)
        if heard is None or abs(delay_ns) > _MOST_DELAY_NS:
            return False
        while heard and heard[-1][1] >= delay_ns:  # these can never be the smallest any more
            heard.pop()
        heard.append((now_ns, delay_ns))
        set_anew = False
        if self._drone in status.delays_ns:
            returned_ns = self._by_own_time(name, status.delays_ns[self._drone], delay_ns, now_ns)
            self._returned[name] = now_ns, returned_ns
            set_anew = heard[0][1] + returned_ns < _LEAST_TRIP_NS <= delay_ns + returned_ns
            if set_anew:
                heard.clear()
                heard.append((now_ns, delay_ns))
        self._hold(now_ns)
        self._known = self._leads_ns(now_ns)
        self._vote()
        self._watch_common(now_ns)
        return set_anew

    def _by_own_time(self, name: str, told_ns: int, delay_ns: int, now_ns: int) -> int:
        """Return the delay of this drone's statuses, as the drone ``name`` reports it (``told_ns``), converted to own time.

        After a step of the own clock the report may still be by the former clock. Of both readings, that with a possible round
        trip counts. If both are possible: that which agrees with the known offset, or else the smaller one. ``delay_ns``: of the
        status with the report.
        """
        held = self._held.get(name)
        if now_ns - self._stepped_ns > WINDOW_NS + MOST_LATENCY_NS:
            self._since_ns.clear()
        returned_ns = told_ns + self.utc.ahead_ns
        by_former_ns = returned_ns - self._since_ns.get(name, 0)
        possible = [one_ns for one_ns in (returned_ns, by_former_ns) if one_ns + delay_ns >= _LEAST_TRIP_NS]
        found_ns = min(
            possible,
            key=lambda one_ns: (held is None or abs(delay_ns - one_ns - 2 * held.ahead_ns) > 2e9 * LIMIT_S, one_ns),
            default=returned_ns,
        )
        if found_ns == returned_ns:
            self._since_ns.pop(name, None)
        return found_ns

    def set_own(self, ahead_ns: int, now_ns: int) -> int:
        """Set the lead of the own clock over own time, and return its step (ns) since the last one."""
        by_ns, self.utc.ahead_ns = ahead_ns - self.utc.ahead_ns, ahead_ns
        if abs(by_ns) > 1e9 * LIMIT_S:  # less is drift
            self._since_ns = {name: self._since_ns.get(name, 0) + by_ns for name in self._heard}
            self._stepped_ns = now_ns
        before_s = self._outvoted_s
        self._vote()
        step_s = by_ns * 1e-9 - (self._outvoted_s - before_s)  # of the common time
        if self._known and step_s < -1e-9 * _SET_BACK_NS:
            self._back_s = max(self._back_s, -step_s)
        return by_ns

    def _vote(self) -> None:
        known = self._by_utc_s(self._known)
        self._ahead_ns = {name: round(-1e9 * offset_s) for name, offset_s in known.items() if abs(offset_s) > LIMIT_S}
        offsets_s = (0.0, *known.values())
        self.offset_s = max(median_low(offsets_s), median_high(offsets_s), key=abs)
        set_s = self.utc.ahead_ns * 1e-9  # a single other clock counts only if this explains the difference
        if len(known) == 1:
            outvoted_s = self.offset_s if abs(self.offset_s - set_s) <= LIMIT_S else 0.0
        else:  # the half that is behind, on both sides: else the halves would swap their times
            outvoted_s = median_high(offsets_s)
        self._outvoted_s = outvoted_s if abs(outvoted_s) > LIMIT_S else 0.0

    def _watch_common(self, now_ns: int) -> None:
        """Note a backward step of the common time, and its end, as far as the other clocks show it."""
        common_ns = self.common_ns(now_ns)
        offsets_s = {self._drone: 0.0, **self._by_utc_s(self._known)}
        right = {name for name, offset_s in offsets_s.items() if abs(offset_s - self._outvoted_s) <= LIMIT_S}
        if len(right) > 1:  # the own clock alone, as in the first second after a step, is no evidence of the common time
            self._agreed_ns |= dict.fromkeys(right, common_ns)
        back_ns = max((at_ns - common_ns for name, at_ns in self._agreed_ns.items() if name not in right), default=-_AGAIN_NS)
        if back_ns <= -_AGAIN_NS:
            self._back_s = 0.0
        elif back_ns > _SET_BACK_NS:
            self._back_s = max(self._back_s, 1e-9 * back_ns)

    def delays_ns(self, now_ns: int) -> dict[str, int]:
        """Return the smallest delay of each drone heard in the last 3 s, by the own clock, as this drone publishes it; by id."""
        delays = self._delays_ns(now_ns)
        return {
            name: delay_ns + self.utc.ahead_ns
            for name, delay_ns in delays.items()
            if now_ns - self._heard[name][-1][0] < HEARD_NS
        }

    def offsets_s(self, now_ns: int) -> dict[str, float]:
        """Return the lead (s) of the own clock over each drone's, by id, where the delays of both directions are known and
        consistent.
        """
        return self._by_utc_s(self._leads_ns(now_ns))

    def _leads_ns(self, now_ns: int) -> dict[str, int]:
        """Return the lead of own time over each drone's clock, where known."""
        return {name: self._held[name].ahead_ns for name in self._both_ns(now_ns) if name in self._held}

    def _by_utc_s(self, leads_ns: dict[str, int]) -> dict[str, float]:
        """Convert leads (ns) of own time over other clocks to leads (s) of the own clock over them."""
        return {name: 1e-9 * (lead_ns + self.utc.ahead_ns) for name, lead_ns in leads_ns.items()}

    def _hold(self, now_ns: int) -> None:
        """Update the offsets by the delays, or keep the former ones for a while (``_held``)."""
        both = self._both_ns(now_ns)
        self._held |= {name: _held(self._held.get(name), *delays_ns, now_ns) for name, delays_ns in both.items()}

    def _both_ns(self, now_ns: int) -> dict[str, tuple[int, int]]:
        """Return, for each drone, the smallest delay of its statuses here, and of this drone's statuses there, where both are
        known and consistent.
        """
        returned = {name: delay_ns for name, (at_ns, delay_ns) in self._returned.items() if now_ns - at_ns <= WINDOW_NS}
        both = {name: (delay_ns, returned[name]) for name, delay_ns in self._delays_ns(now_ns).items() if name in returned}
        return {name: delays for name, delays in both.items() if _LEAST_TRIP_NS <= sum(delays) <= 2 * MOST_LATENCY_NS}

    def _delays_ns(self, now_ns: int) -> dict[str, int]:
        """Return the smallest delay in the last 10 s of each drone with statuses in that time."""
        found = {}
        for name, heard in self._heard.items():
            while heard and now_ns - heard[0][0] > WINDOW_NS:
                heard.popleft()
            if heard:
                found[name] = heard[0][1]
        return found

    def own_stamp_ns(self, drone: str, stamp_ns: int) -> int:
        """Convert a stamp of another drone to own time; by its clock's offset, if that is known to exceed 50 ms."""
        return max(0, self.utc.own_ns(stamp_ns) - self._ahead_ns.get(drone, 0))

    def in_own_time(self, message: N) -> N:
        """Return another drone's message with its stamp in own time (``own_stamp_ns``).

        With a known offset, the position uncertainty of a pose is that of the drone's localisation alone, whichever of the two
        clocks is wrong.
        """
        stamp_ns = self.own_stamp_ns(message.drone, message.stamp_ns)
        if isinstance(message, Pose) and (message.clock_sigma_m > 0.0 or self.is_doubted):
            return replace(message, stamp_ns=stamp_ns, position_sigma_m=self._sigma_m_of(message))
        return message if stamp_ns == message.stamp_ns else replace(message, stamp_ns=stamp_ns)

    def _sigma_m_of(self, pose: Pose) -> float:
        """Return the 1 sigma (m) of another drone's position at its stamp in own time. With an unknown or doubtful offset it
        includes the errors of both clocks.
        """
        held = self._held.get(pose.drone)
        if pose.drone in self._known and (held is None or held.doubted_ns is None):
            return sqrt(max(0.0, pose.position_sigma_m**2 - pose.clock_sigma_m**2))
        return hypot(pose.position_sigma_m, self.sigma_m(hypot(*pose.velocity_mps)))

    def common_ns(self, now_ns: int) -> int:
        """Return the common time now (UTC, ns): by the clocks of the others if the own clock is known to be wrong, else by it.

        If the clocks split into halves, all drones take the time of the half that is behind. So their source estimates stay
        comparable, and no log entry is late by the offset.
        """
        return self.utc.of(now_ns) - round(1e9 * self._outvoted_s)

    def own_ns_of_common(self, common_ns: int) -> int:
        """Convert a stamp of the source estimate, which is common time, to own time."""
        return common_ns - self.common_ns(0)

    def followed_ns(self, now_ns: int) -> int:
        """Return the common time as the source estimate uses it. It follows a backward step only if no drone has stamped later
        measurements; otherwise, and after a small step, it stands still until the common time has reached it again.
        """
        common_ns = self.common_ns(now_ns)
        back_ns = self._followed_ns - common_ns
        if back_ns < 0 or (back_ns > _SET_BACK_NS and self._back_s == 0.0):
            self._followed_ns = common_ns
        return self._followed_ns

    @property
    def is_doubted(self) -> bool:
        """Whether stamps by the own clock may be wrong by more than 50 ms."""
        return max(abs(self.offset_s), self._back_s) > LIMIT_S

    def problem(self, now_ns: int) -> CodedText | None:
        """Return the problem for the operator that the own clock differs from the others; None while it is right."""
        if abs(self.offset_s) <= LIMIT_S:
            return None
        ahead = self.offset_s > 0.0
        far = [name for name, offset_s in self.offsets_s(now_ns).items() if (offset_s > 0.0) is ahead and abs(offset_s) > LIMIT_S]
        direction = "ahead of" if ahead else "behind"
        text = f"its clock is {abs(self.offset_s):.2f} s {direction} {', '.join(far) or 'the others'}: check chrony"
        return CodedText(Code.CLOCK_OFF, text)

    def sigma_m(self, speed_mps: float) -> float:
        """Return the 1 sigma (m) that the own clock's offset, or a step of the common time, adds to a position at this speed; 0
        within 50 ms.
        """
        error_s = max(abs(self.offset_s), self._back_s)
        return min(speed_mps * error_s, MOST_SIGMA_M) if self.is_doubted else 0.0


def _held(before: _Held | None, own_ns: int, returned_ns: int, now_ns: int) -> _Held:
    """Return the offset by these two delays, or the former one (``before``) for 5 s if it is consistent with both.

    No message takes a negative time. So the lead of own time is at most ``own_ns``, the smallest delay here, and at least
    -``returned_ns``, the smallest delay there.
    """
    told = _Held((own_ns - returned_ns) // 2)
    if before is None or abs(told.ahead_ns - before.ahead_ns) <= 1e9 * LIMIT_S:
        return told
    slack_ns = -_LEAST_TRIP_NS // 2
    if not -returned_ns - slack_ns <= before.ahead_ns <= own_ns + slack_ns:
        return told
    since_ns = now_ns if before.doubted_ns is None else before.doubted_ns
    return told if now_ns - since_ns >= _HELD_NS else replace(before, doubted_ns=since_ns)
