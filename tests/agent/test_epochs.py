"""Jumps of a vehicle's localisation that it does not tell."""

import pytest
from msgspec.structs import replace
from one_pilot import SECOND, START_NS, TICK_NS, state

from agent.epochs import EpochWatch


def flight(watch, steps, start=(0.0, 0.0, 3.0), velocity=(8.0, 0.0, 0.0), **values):
    """The epochs under which a flight at constant velocity appears."""
    found = []
    for step in steps:
        place = tuple(part + rate * step * 0.05 for part, rate in zip(start, velocity, strict=True))
        told = state(START_NS + step * TICK_NS, position=place, velocity_mps=velocity, **values)
        found.append(watch.take(told).epoch)
    return found


def test_a_flight_has_one_epoch_gaps_and_noise_included():
    watch = EpochWatch(8.0)
    assert set(flight(watch, (0, 1, 2, 40, 41))) == {0}
    assert flight(watch, (42,), start=(0.8, 0.5, 3.3)) == [0]
    assert watch.problem(START_NS + 3 * SECOND) is None


def test_a_jump_that_is_not_told_begins_an_epoch_and_is_told():
    watch = EpochWatch(8.0)
    flight(watch, range(5))
    assert flight(watch, (5, 6), start=(15.0, 0.0, 3.0)) == [1, 1]
    assert watch.jumps == 1
    assert watch.problem(START_NS + SECOND) == "its localisation has jumped by 15 m without saying so"
    assert watch.problem(START_NS + 120 * SECOND) is None


def test_a_jump_within_what_the_vehicle_says_of_its_error_is_none():
    watch = EpochWatch(8.0)
    flight(watch, range(5), position_sigma_m=6.0)
    assert flight(watch, (5,), start=(15.0, 0.0, 3.0), position_sigma_m=6.0) == [0]


def test_the_vehicles_own_epochs_count_once():
    watch = EpochWatch(8.0)
    flight(watch, range(5))
    assert flight(watch, (5, 6), start=(15.0, 0.0, 3.0), epoch=1) == [1, 1]
    assert flight(watch, (7,), start=(40.0, 0.0, 3.0), epoch=1) == [2]
    assert flight(watch, (8,), start=(90.0, 0.0, 3.0), epoch=2) == [3]


@pytest.mark.parametrize("offset", [0, 4])
def test_epochs_only_grow_when_the_autopilot_counts_from_the_beginning_again(offset):
    watch = EpochWatch(8.0, offset)
    assert flight(watch, (0,), epoch=5) == [5 + offset]
    assert flight(watch, (1,), epoch=0) == [6 + offset]
    assert flight(watch, (2,), epoch=1) == [7 + offset]


def test_what_is_told_of_the_vehicle_stays():
    told = replace(state(START_NS), epoch=3)
    assert EpochWatch(8.0).take(told) is told
