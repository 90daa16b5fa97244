"""Readiness from the sensors' bits, and the autopilot's own messages."""

import msgspec
import pytest

from radron.agent.vehicle.events import number_of
from radron.agent.vehicle.health import TEXT_AGE_S, StatusMessages, not_ready
from radron.agent.vehicle.interface import FlightMode
from radron.agent.vehicle.mavlink.messages import DECODERS, Event, StatusText, SystemStatus

GPS, BATTERY = 0x20, 0x0200_0000
PRESENT, ENABLED = 0x0300_402F, 0x0301_402F  # as from a real PX4; the prearm check is never among them
READY, NOT_READY = 0x1320_C83F, 0x0320_C83F


def status(present: int, enabled: int, health: int) -> SystemStatus:
    return SystemStatus(present, enabled, health, 90)


def test_the_autopilots_own_prearm_check_decides() -> None:
    assert not_ready(status(PRESENT, ENABLED, READY)) is None
    assert not_ready(status(PRESENT, ENABLED, READY & ~GPS)) is None  # can be armed all the same
    assert not_ready(status(PRESENT, ENABLED, NOT_READY)) == "prearm check"
    assert not_ready(status(PRESENT, ENABLED, NOT_READY & ~GPS & ~BATTERY)) == "GPS, battery"


def test_an_autopilot_that_has_only_just_started_is_not_ready() -> None:
    assert not_ready(status(0, 0, 0x0321_C83F)) == "prearm check"


def test_long_texts_are_joined_and_notices_left_out() -> None:
    texts = StatusMessages()
    texts.receive(StatusText(6, "Takeoff detected"), 0.0)
    texts.receive(StatusText(2, "a" * 50, id=7, chunk_seq=0), 0.0)
    assert texts.recent(0.0) == ()
    texts.receive(StatusText(2, "b", id=7, chunk_seq=1), 0.0)
    texts.receive(StatusText(3, "Arming denied"), 1.0)
    texts.receive(StatusText(3, "Arming denied"), 2.0)
    assert texts.recent(2.0) == ("Arming denied", "a" * 50 + "b")
    assert texts.recent(1.9 + TEXT_AGE_S) == ("Arming denied",)
    assert texts.recent(2.1 + TEXT_AGE_S) == ()


def test_a_text_whose_first_chunk_was_lost_is_given_as_far_as_it_came() -> None:
    texts = StatusMessages()
    texts.receive(StatusText(2, "the rest", id=9, chunk_seq=1), 0.0)
    assert texts.recent(0.0) == ("the rest",)


def test_parts_of_a_text_that_have_no_number_are_joined_when_they_follow_at_once() -> None:
    told = StatusMessages()
    told.receive(StatusText(2, "Arming denied: Resolve system health failures firs"), 0.0)
    told.receive(StatusText(2, "t"), 0.0)
    told.receive(StatusText(2, "Preflight Fail: heading estimate not stable"), 0.05)
    assert told.recent(0.1) == (
        "Preflight Fail: heading estimate not stable",
        "Arming denied: Resolve system health failures first",
    )


def event(name: str, levels: int, sequence: int, arguments: str = "") -> Event:
    return Event(number_of(name), levels, tuple(bytes.fromhex(arguments)), sequence)


@pytest.mark.parametrize("argument", [-1, 256])
def test_an_event_or_a_version_with_numbers_that_are_no_bytes_is_malformed(argument: int) -> None:
    for kind, fields in (
        ("EVENT", {"id": 1, "log_levels": 0, "arguments": [0, 0, 0, argument]}),
        ("AUTOPILOT_VERSION", {"flight_sw_version": 0, "flight_custom_version": [argument]}),
    ):
        with pytest.raises(msgspec.ValidationError):
            DECODERS[kind].decode(msgspec.json.encode(fields))


def test_events_say_what_a_link_without_a_ground_station_gets_no_text_of() -> None:
    told = StatusMessages()
    told.receive(event("commander_armed_by", 0x66, 1, "04"), 0.0)  # a notice
    told.receive(event("commander_failsafe_enter_autopilot_disengaged", 0x42, 2, "0000060008"), 1.0)
    told.receive(event("commander_failsafe_enter_hold", 0x42, 3, "0000060006050004"), 2.0)
    told.receive(event("commander_failsafe_enter_hold", 0x42, 3, "0000060006050004"), 2.1)  # requested again
    assert told.recent(2.0) == ("Failsafe: battery critically low: return in 5 s", "Failsafe: descend")


def test_the_last_report_says_what_keeps_it_from_being_armed_in_which_mode() -> None:
    told = StatusMessages()
    begin = [event("commander_arming_check_summary", 0x88, 1), event("check_estimator_heading_not_stable", 0x33, 2, "7ed17e0011")]
    begin += [
        event("check_modes_offboard_signal", 0x33, 3, "0040000014"),
        event("check_modes_manual_control", 0x44, 4, "ffffffff07"),
    ]
    for one in begin:
        told.receive(one, 0.0)
    assert told.failed_checks(FlightMode.HOLD) == ()  # the report is not complete
    told.receive(event("commander_health_summary", 0x88, 5), 0.0)
    assert told.failed_checks(FlightMode.HOLD) == ("Heading estimate not stable",)
    assert told.failed_checks(FlightMode.OFFBOARD) == ("Heading estimate not stable", "No offboard signal")
    assert told.recent(0.0) == ()
    told.receive(event("commander_arming_check_summary", 0x88, 6), 1.0)
    told.receive(event("check_of_tomorrow", 0x33, 7, "10000000"), 1.0)
    told.receive(event("commander_health_summary", 0x88, 8), 1.0)
    (unknown,) = told.failed_checks(FlightMode.HOLD)
    assert f"{number_of('check_of_tomorrow'):#x}" in unknown


def test_a_text_that_is_an_event_too_is_told_once() -> None:
    told = StatusMessages()
    told.receive(StatusText(2, "Failsafe activated\t"), 0.0)
    assert told.recent(0.0) == ("Failsafe activated",)  # of an autopilot without events
    told = StatusMessages()
    told.receive(event("commander_failsafe_enter_generic", 0x42, 2, "0000060006"), 0.0)
    told.receive(StatusText(2, "Failsafe activated\t"), 0.0)
    told.receive(StatusText(3, "MAG #0 failed:  TIMEOUT!"), 0.0)
    assert told.recent(0.0) == ("MAG #0 failed:  TIMEOUT!", "Failsafe: return")


def test_numbers_of_events_are_those_that_a_real_one_sends() -> None:
    assert number_of("commander_arm_denied_resolve_failures") == 0x0102089D
    assert number_of("check_estimator_heading_not_stable") == 0x01FDF2ED
