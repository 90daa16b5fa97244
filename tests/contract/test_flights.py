"""Pilot, driver and emulated PX4 together, in simulated time: whole flights with a real PX4's behaviour."""

from __future__ import annotations

from functools import cache

import pytest
from msgspec.structs import replace

from radron.agent.vehicle.interface import FlightMode
from radron.agent.vehicle.mavlink.messages import ExtendedState, Heartbeat
from radron.protocol.messages import Action, Stage
from support.flights.one_pilot import MISSION
from support.px4.linked import Solo

SEEDS = range(30)  # each with other phases of all streams of telemetry
HIGH = replace(MISSION, survey=replace(MISSION.survey, height_m=8.0))
TAKEOFF_MODE, TAKING_OFF = 0x2040000, 3


def surveying(seed: int, mission=MISSION, **options) -> Solo:  # type: ignore[no-untyped-def]
    solo = Solo(seed, mission, **options)
    solo.ready()
    solo.order(Action.START)
    solo.until(lambda: solo.pilot.stage is Stage.SURVEY and solo.states[-1].mode is FlightMode.OFFBOARD, 40.0)
    return solo


@cache
def taken_off(seed: int) -> Solo:
    """Five seconds into the survey."""
    solo = surveying(seed)
    solo.run(5.0)
    return solo


@pytest.mark.parametrize("seed", SEEDS)
def test_every_takeoff_reaches_the_survey_whatever_comes_first(seed: int) -> None:
    solo = taken_off(seed)
    assert [stage for _, stage in solo.stages] == [Stage.PREFLIGHT, Stage.TAKEOFF, Stage.SURVEY]
    assert solo.states[-1].mode is FlightMode.OFFBOARD
    assert solo.told == ()
    assert not any("offboard" in problem for status in solo.statuses for problem in status.problems)


def test_among_these_takeoffs_are_those_whose_heartbeat_comes_last() -> None:
    """EXTENDED_SYS_STATE says TAKEOFF while the newest heartbeat still says hold."""
    late = []
    for seed in SEEDS:
        heard = taken_off(seed).heard
        lifts_s = next(at_s for at_s, one in heard if isinstance(one, ExtendedState) and one.landed_state == TAKING_OFF)
        beats = [(at_s, one) for at_s, one in heard if isinstance(one, Heartbeat) and at_s <= lifts_s]
        late.append(beats[-1][1].custom_mode != TAKEOFF_MODE)
    assert True in late


def test_a_drone_that_has_landed_flies_the_next_mission() -> None:
    solo = taken_off(3)
    first_ns = solo.statuses[-1].started_ns
    solo.order(Action.RETURN)
    solo.until(lambda: solo.pilot.stage is Stage.LANDED, 90.0)
    landed_s = solo.time_s
    solo.until(lambda: solo.told == (), 10.0)  # in hold, from which it can be armed
    assert solo.states[-1].mode is FlightMode.HOLD
    assert any(one.custom_mode == 0x60000 and not one.base_mode & 0x80 for at_s, one in solo.heard if isinstance(one, Heartbeat))
    solo.run(3.0)
    solo.order(Action.START)
    solo.until(lambda: solo.pilot.stage is Stage.SURVEY and solo.states[-1].mode is FlightMode.OFFBOARD, 40.0)
    solo.run(5.0)
    assert [stage for time_s, stage in solo.stages if time_s > landed_s] == [Stage.TAKEOFF, Stage.SURVEY]
    assert solo.told == ()
    second_ns = solo.statuses[-1].started_ns
    assert first_ns is not None
    assert second_ns is not None
    assert second_ns > first_ns + 20_000_000_000


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_satellites_gone_for_long_end_in_a_landing_that_stays_one(seed: int) -> None:
    """Whether PX4 notices the landing or not, and whatever it goes back to when its satellites return."""
    solo = surveying(seed)
    solo.run(3.0)
    lost_s = solo.time_s
    solo.face.lose_satellites(20.0)
    solo.run(2.0)
    assert any("no satellites" in problem for problem in solo.told)
    solo.run(18.0 + 15.0)
    assert solo.setpoints(lost_s + 1.5) == []
    assert solo.pilot.stage in (Stage.LANDING, Stage.LANDED)
    assert any("position could not be trusted" in problem for problem in solo.told)
    assert solo.true_height_m < 0.5
    solo.until(lambda: solo.pilot.stage is Stage.LANDED, 40.0)
    assert solo.true_height_m < 0.3


def test_satellites_gone_for_a_moment_high_in_the_air_interrupt_the_mission() -> None:
    solo = surveying(5, HIGH)
    solo.run(3.0)
    lost_s = solo.time_s
    solo.face.lose_satellites(4.5)
    solo.run(4.0)
    assert solo.setpoints(lost_s + 1.5) == []
    solo.until(lambda: solo.states[-1].position_trusted and solo.states[-1].mode is FlightMode.OFFBOARD, 20.0)
    solo.run(5.0)
    assert solo.pilot.stage is Stage.SURVEY
    assert solo.told == ()
    assert solo.true_height_m > 4.0
