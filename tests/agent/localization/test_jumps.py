"""Unannounced jumps of a vehicle's localisation."""

import math

import pytest
from msgspec.structs import replace

from radron.agent.localization.jumps import CONFIRM_NS, JumpDetector
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Status
from support.flights.one_pilot import SECOND, START_NS, TICK_NS, messages, started, state


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


def turning(detector, headings, **values):
    """The epochs under which a hover with these headings, 50 ms apart, appears."""
    found = []
    for step, yaw_rad in enumerate(headings):
        quaternion = (math.cos(0.5 * yaw_rad), 0.0, 0.0, math.sin(0.5 * yaw_rad))
        found.append(detector.take(state(START_NS + step * TICK_NS, quaternion=quaternion, **values)).epoch)
    return found


@pytest.mark.parametrize("rate_rps", [0.0, 1.0, 30.0], ids=["rest", "turn", "spin"])
def test_a_heading_that_jumps_unannounced_begins_an_epoch_and_is_reported(rate_rps):
    detector = JumpDetector(8.0)
    turned = [rate_rps * 0.05 * step for step in range(10)]
    assert turning(detector, [*turned[:6], *(yaw_rad + 0.67 for yaw_rad in turned[6:])]) == [0] * 6 + [1] * 4
    assert detector.problem(START_NS + SECOND) == "its localisation turned by 38 degrees without announcing it"


def test_a_heading_that_jumps_against_a_spin_shows_as_the_spin_goes_on():
    """In the step of the jump the vehicle may as well have hit the ground."""
    turned = [-30.0 * 0.05 * step for step in range(10)]
    assert turning(JumpDetector(8.0), [*turned[:6], *(yaw_rad + 0.67 for yaw_rad in turned[6:])]) == [0] * 7 + [1] * 3


def test_heading_jump_turns_no_frame_whose_axes_are_fixed():
    assert turning(JumpDetector(8.0), [0.0, 0.0, 0.67, 0.67]) == [0, 0, 1, 1]
    assert turning(JumpDetector(8.0), [0.0, 0.0, 0.67, 0.67], axes_fixed=True) == [0] * 4


@pytest.mark.parametrize("rate_rps", [6.0, -20.0])
@pytest.mark.parametrize("part", [0.0, 0.6], ids=["at a stamp", "between two"])
def test_a_spin_that_ends_on_the_ground_begins_no_epoch(rate_rps, part):
    detector = JumpDetector(8.0)
    turned = [rate_rps * 0.05 * min(step, 5 + part) for step in range(12)]
    assert set(turning(detector, turned)) == {0}
    assert detector.problem(START_NS + SECOND) is None


def test_a_vehicle_that_turns_as_hard_as_it_can_begins_no_epoch():
    harder = [0.5 * 6.0 * (0.05 * step) ** 2 for step in range(40)]
    assert set(turning(JumpDetector(8.0), [*harder, *(2.0 * harder[-1] - yaw_rad for yaw_rad in harder[-2::-1])])) == {0}
    assert set(turning(JumpDetector(8.0), [0.0, 0.0, 0.67, 0.67], yaw_sigma_rad=0.3)) == {0}  # as stated before


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


def test_of_an_exact_frame_only_jumps_since_the_launch_count():
    detector = JumpDetector(8.0, from_launch=True)
    flight(detector, range(3), armed=False, in_air=False)
    assert flight(detector, (3,), start=(30.0, 0.0, 3.0), armed=False, in_air=False) == [0]
    assert flight(detector, (4, 5), start=(30.0, 0.0, 3.0)) == [0, 0]
    assert flight(detector, (6,), start=(10.0, 0.0, 3.0)) == [1]


def test_a_localisation_that_jumps_again_and_again_is_not_trusted():
    detector = JumpDetector(8.0)
    flight(detector, range(3))

    def jump(step, away_m):
        return detector.take(state(START_NS + step * TICK_NS, position=(away_m, 0.0, 3.0)))

    assert jump(3, 20.0).position_trusted
    assert jump(10, 0.0).position_trusted
    distrusted = jump(20, 25.0)
    assert not distrusted.position_trusted
    assert distrusted.position_sigma_m == pytest.approx(25.0, abs=1.0)
    assert not jump(20 + CONFIRM_NS // TICK_NS - 1, 25.0).position_trusted
    assert jump(20 + CONFIRM_NS // TICK_NS, 25.0).position_trusted


def test_a_drone_with_an_exact_frame_tells_of_a_jump_and_stays_where_it_is():
    one = started()
    statuses, away_m = [], 0.0
    for tick in range(1, 60):
        now_ns, away_m = START_NS + tick * TICK_NS, 20.0 if tick > 30 else 0.0
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, position=(away_m, 0.0, 3.0)))
        step = one.step(now_ns)
        statuses += messages(step, Status)
        if tick > 31:
            assert step.command.setpoint.position_m[0] == pytest.approx(away_m, abs=3.0)  # not back over the jump
    assert any("its localisation jumped by 20 m" in text for text in statuses[-1].problems)
    (x, y, _), frame = one.frames.graph.mission_from_local("d1", 0).translation, one.frames.graph.mission_from_local("d1", 1)
    assert (x, y) == (5.0, 5.0)
    assert frame is None  # nothing has been measured in it
