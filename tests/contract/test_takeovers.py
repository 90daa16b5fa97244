"""Pilot, driver and emulated PX4 together, in simulated time: a pilot's takeover while the agent hears nothing."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from radron.agent.vehicle.interface import FlightMode
from radron.agent.vehicle.requests import BLIND_S
from radron.protocol.messages import Action, Stage
from radron.sim.vehicle.px4.modes import Mode
from support.flights.one_pilot import MISSION
from support.px4.linked import Solo

HIGH = replace(MISSION, survey=replace(MISSION.survey, height_m=8.0))
SEEDS = range(3)  # each with other phases of all streams of telemetry


def surveying(seed: int) -> Solo:
    """Three seconds into the survey."""
    solo = Solo(seed)
    solo.ready()
    solo.order(Action.START)
    solo.until(lambda: solo.pilot.stage is Stage.SURVEY and solo.states[-1].mode is FlightMode.OFFBOARD, 40.0)
    solo.run(3.0)
    return solo


def flies_by_hand(solo: Solo, seconds: float) -> bool:
    """Whether the human pilot keeps the vehicle for so long."""
    end_s = solo.time_s + seconds
    while solo.time_s < end_s and solo.face.commander.mode is Mode.POSITION:
        solo.run(0.1)
    return solo.face.commander.mode is Mode.POSITION


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("after_s", [0.1, 0.4, 0.8])
def test_a_human_pilot_who_takes_over_after_a_gap_in_telemetry_keeps_the_vehicle(seed: int, after_s: float) -> None:
    solo = surveying(seed)
    solo.deaf = True
    solo.run(1.2)
    solo.deaf = False
    solo.run(after_s)
    solo.face.commander.take_over()
    assert flies_by_hand(solo, 10.0)
    assert any("human pilot" in problem for problem in solo.told)
    solo.order(Action.RESUME)
    solo.until(lambda: solo.states[-1].mode is FlightMode.OFFBOARD, 3.0)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("low", [False, True])
def test_a_human_pilot_who_takes_over_while_the_link_is_down_keeps_the_vehicle(seed: int, low: bool) -> None:
    """Near the ground as well, where an agent that comes back lands what its failsafe has brought down."""
    solo = surveying(seed)
    solo.face.cut_links(10.0)
    solo.run(3.0)
    solo.face.commander.take_over()
    assert flies_by_hand(solo, 6.9)
    for _ in range(40 if low else 0):
        solo.motion.position_m[0, 2] = 0.7
        solo.run(0.01)
    assert flies_by_hand(solo, 10.0)
    assert any("human pilot" in problem for problem in solo.told)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_human_pilot_keeps_a_vehicle_that_its_agent_does_not_hear(seed: int) -> None:
    solo = surveying(seed)
    solo.deaf = True
    solo.run(1.0 + BLIND_S + 0.5)  # on hold by then: no failsafe is needed
    assert solo.face.commander.mode is Mode.HOLD
    solo.face.commander.take_over()
    assert flies_by_hand(solo, 30.0)
    solo.deaf = False
    assert flies_by_hand(solo, 8.0)
    assert any("human pilot" in problem for problem in solo.told)


@pytest.mark.parametrize("up_m", [1.0, 2.5, 5.0])
def test_hold_that_a_human_pilot_chooses_in_a_takeoff_keeps_the_vehicle(up_m: float) -> None:
    """PX4 ends its own takeoff in hold, too, and only the height distinguishes the two."""
    solo = Solo(int(up_m), HIGH)
    solo.ready()
    solo.order(Action.START)
    solo.until(lambda: solo.true_height_m > up_m, 40.0)
    solo.face.commander.set_mode(Mode.HOLD)
    solo.run(10.0)
    assert solo.face.commander.mode is Mode.HOLD
    assert any("human pilot" in problem for problem in solo.told)
    solo.order(Action.RESUME)
    solo.until(lambda: solo.states[-1].mode is FlightMode.OFFBOARD, 10.0)
