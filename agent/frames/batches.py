"""When entries that come late by seconds are taken: in batches, at fixed times, the same for all agents."""

from __future__ import annotations

LATE_NS = 5_000_000_000  # an entry that changes what was computed longer ago than this waits for others of its kind
_EVERY_NS = 2_000_000_000  # mostly longer than a batch takes to be computed
_AFTER_NS = 500_000_000  # keyframes become due with full seconds, and take some calls: the borders lie behind them
_MOST_CALLS = 40  # where time stands still, as after the flight


class Batches:
    """Tells when the next batch of late entries is due.

    What such an entry changes takes many calls to compute again, so that where they keep coming there is hardly a moment at which
    none is missing. But at a border all that came before it are taken, and all agents have the borders at the same times: what
    they compute follows from the same entries, but for one that is on its way at the border. Who is not free at a border takes
    them as soon as it is. The next batch rests for as many calls as the last one took, so that late entries never cost more than
    half of the time.
    """

    def __init__(self) -> None:
        self._border = 0
        self._calls = 0  # since the last border
        self._rest = 0  # calls
        self._is_due = False

    @property
    def is_resting(self) -> bool:
        """Whether the next call takes no batch yet, because the last one took long."""
        return self._rest > 1

    def are_due(self, now_ns: int, *, free: bool) -> bool:
        """Whether a batch is to be taken now, asked in each call; ``free``: whether one can be."""
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
        """The last batch has been computed, in so many calls."""
        self._rest = calls
