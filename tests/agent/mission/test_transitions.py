"""The table of stages: each is reached and left; a flight begins by a command or under manual override, and ends disarmed."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from radron.agent.mission.flight import Flight
from radron.agent.mission.transitions import ROWS, TABLE, Event
from radron.protocol.messages import Action, Stage
from radron.protocol.stages import FLYING, ON_GROUND, STEERED
from support.flights.situations import VEHICLE

PAGE = Path(__file__).parents[3] / "docs/design/authority.md"
BY_OTHERS = (Event.FLOWN_HOME, Event.FLOWN_DOWN, Event.FLOWN_HELD, Event.TAKEN)
EVENTS = st.sampled_from([*Action, *Event])


def reachable(begin: Stage) -> set[Stage]:
    """The stages that a flight comes to from one stage, without it unless it comes back."""
    found, open_ = set(), [begin]
    while open_:
        stage = open_.pop()
        after = {one for (before, _), next_ in TABLE.items() if before is stage for one in ([next_] if next_ else STEERED)}
        open_ += after - found
        found |= after
    return found


def test_every_stage_but_the_first_is_reached_from_every_other_and_none_is_terminal() -> None:
    for stage in Stage:
        assert reachable(stage) == set(Stage) - {Stage.PREFLIGHT}


def test_no_row_says_what_another_says_too() -> None:
    assert len(TABLE) == sum(len(stages) for stages, _, _ in ROWS)
    assert {event for _, event, _ in ROWS} == {*Action, *Event}


@given(st.lists(st.tuples(EVENTS, st.booleans())))
def test_a_flight_begins_by_a_start_or_by_somebody_else_and_ends_disarmed(events: list[tuple[Action | Event, bool]]) -> None:
    flight = Flight()
    for tick, (event, released) in enumerate(events, 1):
        after = flight.after(event, tick, VEHICLE, released=released)
        if (flight.stage, event) not in TABLE:
            assert after is flight
        elif flight.stage in ON_GROUND:
            assert event is Action.START or event in BY_OTHERS
        elif after.stage in ON_GROUND:
            assert (event, after.stage) == (Event.GROUNDED, Stage.LANDED)
        assert after is flight or after.since_ns == tick
        assert after.resume in STEERED
        assert after.stage is Stage.TAKEOFF or not after.rises
        flight = after


@given(st.lists(EVENTS))
def test_a_pilot_takes_over_and_an_operator_lands_and_aborts_whatever_has_happened(events: list[Action | Event]) -> None:
    flight = Flight().after(Action.START, 0, VEHICLE)
    for event in events:
        flight = flight.after(event, 0, VEHICLE)
    if flight.stage not in FLYING:
        return
    for mode, stage in zip(BY_OTHERS[:3], (Stage.RETURN, Stage.LANDING, Stage.HOLD), strict=True):
        assert flight.after(mode, 1, VEHICLE, released=True).stage is stage
    for action, stage in ((Action.LAND, Stage.LANDING), (Action.ABORT, Stage.ABORT), (Action.RETURN, Stage.RETURN)):
        assert flight.after(action, 1, VEHICLE).stage is stage


def test_the_page_shows_the_table() -> None:
    rows = [f"| {', '.join(stages)} | {_told(event)} | {after or 'the interrupted stage'} |" for stages, event, after in ROWS]
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    begin = lines.index("| from | event | stage |") + 2
    assert lines[begin : begin + len(rows)] == rows
    assert not lines[begin + len(rows)].startswith("|")


def _told(event: Action | Event) -> str:
    return event if isinstance(event, Event) else f"`{event}` is commanded"
