"""Unannounced jumps of a vehicle's localisation."""

import pytest
from msgspec.structs import replace
from one_pilot import SECOND, START_NS, TICK_NS, state

from agent.localization.jumps import JumpDetector


def flight(detector, steps, start=(0.0, 0.0, 3.0), velocity=(8.0, 0.0, 0.0), **values):
    """The epochs under which a flight at constant velocity appears."""
    found = []
    for step in steps:
        place = tuple(part + rate * step * 0.05 for part, rate in zip(start, velocity, strict=True))
        told = state(START_NS + step * TICK_NS, position=place, velocity_mps=velocity, **values)
        found.append(detector.take(told).epoch)
    return found


def test_a_flight_has_one_epoch_gaps_and_noise_included():
    detector = JumpDetector(8.0)
    assert set(flight(detector, (0, 1, 2, 40, 41))) == {0}
    assert flight(detector, (42,), start=(0.8, 0.5, 3.3)) == [0]
    assert detector.problem(START_NS + 3 * SECOND) is None


def test_an_unannounced_jump_begins_an_epoch_and_is_reported():
    detector = JumpDetector(8.0)
    flight(detector, range(5))
    assert flight(detector, (5, 6), start=(15.0, 0.0, 3.0)) == [1, 1]
    assert detector.jumps == 1
    assert detector.problem(START_NS + SECOND) == "its localisation jumped by 15 m without announcing it"
    assert detector.problem(START_NS + 120 * SECOND) is None


def test_a_jump_within_the_stated_error_begins_no_epoch():
    detector = JumpDetector(8.0)
    flight(detector, range(5), position_sigma_m=6.0)
    assert flight(detector, (5,), start=(15.0, 0.0, 3.0), position_sigma_m=6.0) == [0]


def test_the_vehicles_own_epochs_count_once():
    detector = JumpDetector(8.0)
    flight(detector, range(5))
    assert flight(detector, (5, 6), start=(15.0, 0.0, 3.0), epoch=1) == [1, 1]
    assert flight(detector, (7,), start=(40.0, 0.0, 3.0), epoch=1) == [2]
    assert flight(detector, (8,), start=(90.0, 0.0, 3.0), epoch=2) == [3]


@pytest.mark.parametrize("offset", [0, 4])
def test_epochs_only_grow_when_the_autopilot_counts_from_the_beginning_again(offset):
    detector = JumpDetector(8.0, offset)
    assert flight(detector, (0,), epoch=5) == [5 + offset]
    assert flight(detector, (1,), epoch=0) == [6 + offset]
    assert flight(detector, (2,), epoch=1) == [7 + offset]


def test_telemetry_without_a_jump_is_passed_on_unchanged():
    told = replace(state(START_NS), epoch=3)
    assert JumpDetector(8.0).take(told) is told
