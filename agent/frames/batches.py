"""When entries that come late by seconds are taken: in batches, at fixed times, the same for all agents."""

from __future__ import annotations

LATE_NS = 5_000_000_000  # an entry that changes what was computed longer ago than this waits for others of its kind
_EVERY_NS = 2_000_000_000  # mostly longer than a batch takes to be computed
_MOST_CALLS = 40  # where time stands still, as after the flight


class Batches:
    """Tells when the next batch of late entries is due.

    What such an entry changes takes many calls to compute again, so that where they keep coming there is hardly a moment at which
    none is missing. But at a border all that came before it are taken, and all agents have the borders at the same times: what
    they compute follows from the same entries, but for one that is on its way at the border. A border is left out while the next
    batch has to rest: for as many calls as the last one took, so that late entries never cost more than half of the time.
    """

    def __init__(self) -> None:
        self._border = 0
        self._calls = 0  # since the last border
        self._rest = 0  # calls

    def are_due(self, now_ns: int) -> bool:
        """Whether a batch may be taken; to be asked in each call."""
        border = now_ns // _EVERY_NS
        is_border = border != self._border or self._calls >= _MOST_CALLS
        self._border, self._calls = border, 0 if is_border else self._calls + 1
        self._rest = max(0, self._rest - 1)
        return is_border and not self._rest

    def took(self, calls: int) -> None:
        """The last batch has been computed, in so many calls."""
        self._rest = calls
