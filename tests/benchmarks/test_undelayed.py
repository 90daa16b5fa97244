"""What late entries cost the estimate, by the records of a flight in which hardly any was late."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

import pytest

from agent.flight.reader import FlightRecord, RecordedFlight
from agent.flight.topics import MESSAGE
from benchmarks.packet_loss import lateness

LATE_NS = 2_000_000_000


class LateFlight(RecordedFlight):
    """One whose agent heard everything later."""

    def records(self, topics: Collection[str] | None = None) -> Iterator[FlightRecord]:
        for record in super().records(topics):
            yield record._replace(log_ns=record.log_ns + LATE_NS) if record.topic == MESSAGE else record


@pytest.mark.slow
def test_entries_that_come_late_are_told_and_move_the_hypothesis(flights: list[Path]) -> None:
    found = {flight.header.drone.id: flight for flight in map(RecordedFlight, flights)}
    prompt = lateness(found)
    assert prompt.missing == 0
    assert prompt.delays_s[0] < 0.2
    assert prompt.moved_m[0] == 0.0
    late = lateness(found | {name: LateFlight(flight.files[0]) for name, flight in found.items()})
    assert late.delays_s[0] == pytest.approx(prompt.delays_s[0] + 1e-9 * LATE_NS)
    assert late.moved_m[1] > prompt.moved_m[1]
