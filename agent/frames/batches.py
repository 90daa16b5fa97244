"""Schedule of entries that come late by seconds: in batches, by drone, at fixed times that are the same for all agents."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from radron.protocol.bucket import Bucket

LATE_NS = 5_000_000_000  # entries that change older results than this wait for a batch
_EVERY_NS = 2_000_000_000  # mostly longer than a batch takes to be computed
_AFTER_NS = 500_000_000  # keyframes become due with full seconds, and take some calls: the borders lie behind them
_MOST_CALLS = 40  # where time stands still, as after the flight
_CALL_NS = 20_000_000  # least duration of a call: no agent calls more often, and the quotas grow even while time stands still
# For each drone: seconds of the log that its late entries may have computed again at once, and per second. A batch counts as a
# minute at most. After a partition, or the start of an agent in flight, a drone's late entries are one batch or two.
_QUOTA_S, _QUOTA_RATE, _MAX_CHARGE_S = 120.0, 4.0, 60.0


class Batches:
    """Decides when log entries that arrive late are processed: in batches, at fixed times (borders) that all agents share.

    The results that such an entry changes take many calls to compute again, so that during a stream of late entries hardly a
    moment is complete. At a border, however, all earlier entries are taken, and all agents have the borders at the same times.
    Their results follow from the same entries, except for entries on their way at the border. A busy agent takes the batch as
    soon as it is free. The next batch rests for as many calls as the last one took, so that late entries never cost more than
    half of the time.

    A drone whose late entries have much of the log computed again and again has a quota. Beyond the quota its late entries, and
    no others, are put off for a quarter of the seconds that its last batch reached back. The quota decides when entries count,
    not whether.
    """

    def __init__(self) -> None:
        self._border = 0
        self._now_ns = self._elapsed_ns = 0
        self._quotas: dict[str, Bucket] = {}  # by drone; seconds of the log
        self._calls = 0  # since the last border
        self._rest = 0  # calls
        self._is_due = False

    @property
    def is_resting(self) -> bool:
        """Whether the next call does not process late log entries yet, because the last batch of them took long."""
        return self._rest > 1

    def are_due(self, now_ns: int, *, free: bool) -> bool:
        """Return whether a batch of late log entries must be processed now; called in each step. ``free``: whether the caller can
        do so.
        """
        self._elapsed_ns += max(now_ns - self._now_ns, _CALL_NS) if self._now_ns else 0
        self._now_ns = now_ns
        border = (now_ns - _AFTER_NS) // _EVERY_NS
        is_border = border != self._border or self._calls >= _MOST_CALLS
        self._border, self._calls = border, 0 if is_border else self._calls + 1
        self._rest = max(0, self._rest - 1)
        self._is_due = self._is_due or is_border
        if not self._is_due or not free or self._rest:
            return False
        self._is_due = False
        return True

    def took(self, calls: int) -> None:
        """Note that the last batch of late log entries took ``calls`` calls; the next batch waits for as many."""
        self._rest = calls

    def admitted(self, drones: Collection[str]) -> frozenset[str]:
        """Return those of the given drones that have quota left, so that their late log entries are processed."""
        return frozenset(drone for drone in drones if drone not in self._quotas or self._left_s(drone) > 0.0)

    def charge(self, reach_s: Mapping[str, float]) -> None:
        """Reduce the quotas of drones whose late log entries are processed. ``reach_s``: by drone, the seconds that they reach
        back.
        """
        for drone, back_s in reach_s.items():
            quota = self._quotas.setdefault(drone, Bucket(_QUOTA_RATE, _QUOTA_S, 1e-9 * self._elapsed_ns))
            quota.charge(min(max(back_s, 0.0), _MAX_CHARGE_S))

    def _left_s(self, drone: str) -> float:
        return self._quotas[drone].left(1e-9 * self._elapsed_ns)
