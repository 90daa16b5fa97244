"""The table of flight authority: a takeover ends on the ground or by a command, and no state is a dead end."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from radron.agent.mission.authority import ROWS, TABLE, TAKEOVER_NS, Authority, Event, State, View
from radron.agent.mission.flight import Flight
from radron.agent.mission.positionloss import PositionLoss
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Stage
from support.flights.situations import SECOND, VEHICLE

PAGE = Path(__file__).parents[3] / "docs/design/authority.md"


def reachable(begin: State) -> set[State]:
    found, open_ = {begin}, [begin]
    while open_:
        state = open_.pop()
        after = {TABLE[state, event] for event in Event if (state, event) in TABLE} - found
        found |= after
        open_ += after
    return found


def test_every_state_is_reached_and_left() -> None:
    for state in State:
        assert reachable(state) == set(State)


@given(st.lists(st.sampled_from(Event)))
def test_a_takeover_ends_by_a_command_or_on_the_ground_alone(events: list[Event]) -> None:
    authority = Authority()
    for tick, event in enumerate(events):
        after = authority.after(event, tick)
        if authority.is_released and not after.is_released:
            assert event in (Event.COMMANDED, Event.GROUNDED)
            assert after.foreign_since_ns is None
        if after.is_released and not authority.is_released:
            assert event is Event.OVERRULED
        authority = after


@given(
    st.lists(st.sampled_from(Event)),
    st.sampled_from([Stage.TAKEOFF, Stage.SURVEY, Stage.HOLD, Stage.RETURN, Stage.LANDING, Stage.ABORT]),
    st.booleans(),
    st.booleans(),
)
def test_a_pilot_at_the_sticks_takes_over_in_every_state(events: list[Event], stage: Stage, healthy: bool, stays: bool) -> None:
    authority = Authority()
    for event in events:
        authority = authority.after(event, 0)
    vehicle = replace(VEHICLE, mode=FlightMode.MANUAL, healthy=healthy)
    flight = Flight(stage=stage, since_ns=SECOND, position_loss=PositionLoss(stays=stays))
    for now_ns in (10 * SECOND, 10 * SECOND + TAKEOVER_NS + 1):
        authority = authority.judged(View(vehicle, now_ns, flight))
    assert authority.is_released


def test_the_page_shows_the_table() -> None:
    rows = [f"| {', '.join(states)} | {event} | {after} |" for states, event, after in ROWS]
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    begin = lines.index("| from | event | to |") + 2
    assert lines[begin : begin + len(rows)] == rows
    assert not lines[begin + len(rows)].startswith("|")
