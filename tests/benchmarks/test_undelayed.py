"""What late entries cost the estimate, by the records of a flight in which hardly any was late."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

import pytest
from packet_loss import _ratio, _worst, lateness

from radron.agent.flight.reader import FlightRecord, RecordedFlight
from radron.agent.flight.topics import MESSAGE, PUBLICATION

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
    assert prompt.delays_s is not None
    assert prompt.moved_m is not None
    assert prompt.delays_s[0] < 0.2
    assert prompt.moved_m[0] == 0.0
    late = lateness(found | {name: LateFlight(flight.files[0]) for name, flight in found.items()})
    assert late.delays_s is not None
    assert late.moved_m is not None
    assert late.delays_s[0] == pytest.approx(prompt.delays_s[0] + 1e-9 * LATE_NS)
    assert late.moved_m[1] > prompt.moved_m[1]


class BrokenOff(RecordedFlight):
    """One whose agent ended before it published anything."""

    def records(self, topics: Collection[str] | None = None) -> Iterator[FlightRecord]:
        return (record for record in super().records(topics) if record.topic != PUBLICATION)


@pytest.mark.slow
def test_a_flight_whose_agent_ended_early_is_told_without_what_it_moved(flights: list[Path]) -> None:
    found = {flight.header.drone.id: flight for flight in map(RecordedFlight, flights)}
    first = next(iter(found))
    told = lateness(found | {first: BrokenOff(found[first].files[0])})
    assert told.delays_s is not None
    assert told.moved_m is None
    assert lateness({name: BrokenOff(flight.files[0]) for name, flight in found.items()}).moved_m is None


def test_flights_without_a_number_are_left_out_of_the_table() -> None:
    assert _worst([None, (1.0, 4.0), (2.0, 3.0)]) == "2.000 / 4.000"
    assert _worst([None]) == "-"
    assert _ratio([(2.0, 1.0), (None, 1.0), (1.0, None)]).startswith("2.00 ")
    assert _ratio([(None, None)]) == "-"
