"""Pilot, driver and emulated PX4 together, in simulated time: a failsafe that lasts until a mode is chosen."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import development as mavlink

from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Action, Stage
from support.px4.linked import Solo

LOST_S = 40.0  # after its last heartbeat; a takeoff takes half of that


@pytest.mark.parametrize(
    ("reactions", "mode", "action", "stage"),  # of PX4 to a lost station, and to setpoints that end
    [((1, 5), FlightMode.HOLD, Action.RESUME, Stage.SURVEY), ((2, 3), FlightMode.RETURN, Action.RETURN, Stage.RETURN)],
)
def test_an_operator_commands_a_vehicle_again_that_has_lost_its_ground_station(
    reactions: tuple[int, int], mode: FlightMode, action: Action, stage: Stage
) -> None:
    """The station stays away. Before, the drone obeyed, reported the stage of the command, and stayed in its failsafe."""
    parameters = {"NAV_DLL_ACT": reactions[0], "COM_OBL_RC_ACT": reactions[1], "COM_DL_LOSS_T": LOST_S}
    solo = Solo(1, parameters=parameters)
    station = mavlink.MAVLink(None, 255, 190)
    solo.run(5.0)  # it boots
    solo.face.links[0].hear(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(station), solo.now_ns)
    solo.ready()
    solo.order(Action.START)
    solo.until(lambda: solo.states[-1].mode is FlightMode.OFFBOARD, LOST_S)
    solo.until(lambda: solo.states[-1].mode is mode, 2.0 * LOST_S)
    solo.run(8.0)
    assert solo.states[-1].mode is mode  # its agent leaves it to the failsafe
    assert any("of its failsafe" in problem for problem in solo.told)
    solo.order(action)
    solo.until(lambda: solo.states[-1].mode is FlightMode.OFFBOARD, 3.0)
    assert solo.pilot.stage is stage
    solo.run(2.0)
    assert solo.states[-1].mode is FlightMode.OFFBOARD
