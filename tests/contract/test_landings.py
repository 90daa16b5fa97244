"""Pilot, driver and emulated PX4 together, in simulated time: reports and actions once a vehicle is down."""

from __future__ import annotations

import pytest

from radron.agent.mission.standing import STANDS_NS
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Action, Stage
from support.px4.linked import Solo


def landing(seed: int, disarms_s: float | None = None) -> Solo:
    """Commanded to land two seconds into the survey, and on the ground by PX4's own report. ``disarms_s``: COM_DISARM_LAND,
    changed in flight.
    """
    solo = Solo(seed)
    solo.ready()
    solo.order(Action.START)
    solo.until(lambda: solo.pilot.stage is Stage.SURVEY and solo.states[-1].mode is FlightMode.OFFBOARD, 40.0)
    solo.run(2.0)
    if disarms_s is not None:
        solo.face.parameters.set("COM_DISARM_LAND", disarms_s)
    solo.order(Action.LAND)
    solo.until(lambda: solo.face.commander.landed, 60.0)
    return solo


@pytest.mark.parametrize("disarms_s", [0.0, -1.0])
def test_vehicle_that_its_autopilot_does_not_disarm_is_told_and_can_be_disarmed(disarms_s: float) -> None:
    solo = landing(1, disarms_s)
    landed_s = solo.time_s
    solo.until(lambda: any("still armed" in text for text in solo.told), 20.0)
    assert solo.time_s - landed_s == pytest.approx(STANDS_NS * 1e-9, abs=4.0)  # once it is believed that it is down
    assert solo.pilot.stage is Stage.LANDING
    assert solo.face.commander.armed
    solo.order(Action.LAND)
    solo.until(lambda: solo.pilot.stage is Stage.LANDED, 10.0)
    assert not solo.face.commander.armed
    solo.run(3.0)
    assert not any("still armed" in text for text in solo.told)


@pytest.mark.parametrize("seed", [1, 2])
def test_landing_without_a_failsafe_tells_of_none(seed: int) -> None:
    solo = landing(seed)
    solo.until(lambda: solo.pilot.stage is Stage.LANDED, 20.0)
    solo.run(3.0)
    assert not [text for status in solo.statuses for text in status.problems if text == "the autopilot is in a failsafe"]
