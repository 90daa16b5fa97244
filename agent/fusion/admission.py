"""Quotas of log entries for each drone: entries beyond the quota are deferred, and arrive again by the log query.

A quota decides only the time of an entry's admission, never whether it counts: all agents come to hold the same. An honest drone
publishes about 30 a second in flight. It is deferred above the rate of three cameras. After an agent's first minutes it is also
deferred if more than a minute of its entries comes at once.
"""

from __future__ import annotations

from collections.abc import Iterator

from radron.protocol.bucket import Bucket
from radron.protocol.entries import Credential, Entry

RATE, RATE_BESIDE = 100.0, 20.0  # entries a second: of three cameras; and for each other drone in view
BURST_ENTRIES = 6_000.0  # a minute's; entries missed during a lost link come at once
FIRST, FIRST_NS = 40_000.0, 120_000_000_000  # after an agent's start: of an hour on the ground, and a flight that it joins late
BOOT_RATE, BOOT_BURST = 0.1, 20.0  # boots of an agent: each costs time at every access to a log
DEFERRAL_REPORTED_NS = 10_000_000_000  # duration of the report on a deferred drone


class Admission:
    """Quotas of log entries for each drone; they protect the agent's computing time from a drone that publishes too much.

    Entries beyond the quota are not taken now; they arrive again by the log query. Quotas are separate by signature: no drone can
    use up another drone's quota.
    """

    def __init__(self, drones: int) -> None:
        """Set the quotas for a mission of ``drones`` drones."""
        self._rate = RATE + RATE_BESIDE * (drones - 1)
        self._began_ns: int | None = None
        self._quotas: dict[tuple[str, str], Bucket] = {}  # by drone, and kind of quota
        self._put_off_ns: dict[str, int] = {}

    def admits(self, entry: Entry, now_ns: int) -> bool:
        """Return whether a log entry (signed measurement), not yet verified, may be taken now by the quota of the drone that it
        names.
        """
        if all(quota.left(1e-9 * now_ns) >= 1.0 for quota in self._of(entry, now_ns)):
            return True
        self._put_off_ns[entry.drone] = now_ns
        return False

    def charge(self, entry: Entry, now_ns: int) -> None:
        """Reduce the quota of the drone whose log entry has been taken."""
        for quota in self._of(entry, now_ns):
            quota.charge(1.0)

    def put_off(self, now_ns: int) -> frozenset[str]:
        """Return the drones whose log entries were recently put off, because their quota was used up."""
        return frozenset(drone for drone, at_ns in self._put_off_ns.items() if abs(now_ns - at_ns) < DEFERRAL_REPORTED_NS)

    def _of(self, entry: Entry, now_ns: int) -> Iterator[Bucket]:
        """Yield the quotas to which an entry is charged."""
        if self._began_ns is None:
            self._began_ns = now_ns
        begins = abs(now_ns - self._began_ns) < FIRST_NS
        yield self._quota(entry.drone, "first" if begins else "entries", self._rate, FIRST if begins else BURST_ENTRIES, now_ns)
        if isinstance(entry, Credential):
            yield self._quota(entry.drone, "boots", BOOT_RATE, BOOT_BURST, now_ns)

    def _quota(self, drone: str, what: str, rate: float, burst: float, now_ns: int) -> Bucket:
        if (drone, what) not in self._quotas:
            self._quotas[drone, what] = Bucket(rate, burst, 1e-9 * now_ns)
        return self._quotas[drone, what]
