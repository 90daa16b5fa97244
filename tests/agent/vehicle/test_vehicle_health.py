"""Readiness from the sensors' bits, and the autopilot's own words."""

from agent.vehicle.health import TEXT_AGE_S, StatusTexts, not_ready
from agent.vehicle.messages import StatusText, SystemStatus

GYRO, ACCEL, MAG, GPS, PREARM, BATTERY = 1, 2, 4, 0x20, 0x1000_0000, 0x0200_0000
ALL = GYRO | ACCEL | MAG | GPS


def status(enabled: int, health: int) -> SystemStatus:
    return SystemStatus(enabled, enabled, health, 90)


def test_the_autopilots_own_prearm_check_decides_where_there_is_one() -> None:
    assert not_ready(status(ALL | PREARM, ALL | PREARM)) is None
    assert not_ready(status(ALL | PREARM | BATTERY, ALL | PREARM)) is None
    assert not_ready(status(ALL | PREARM, ALL)) == "prearm check"
    assert not_ready(status(ALL | PREARM, ALL & ~GPS)) == "GPS"


def test_without_a_prearm_check_the_sensors_decide() -> None:
    assert not_ready(status(ALL, ALL)) is None
    assert not_ready(status(ALL, ALL & ~MAG & ~GPS)) == "magnetometer, GPS"
    assert not_ready(status(ALL & ~MAG, ALL & ~MAG)) is None  # one that it does not have


def test_long_texts_are_joined_and_notices_left_out() -> None:
    texts = StatusTexts()
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
    texts = StatusTexts()
    texts.receive(StatusText(2, "the rest", id=9, chunk_seq=1), 0.0)
    assert texts.recent(0.0) == ("the rest",)
