"""The vehicle's gains from an emulated PX4's parameters."""

import struct

import pytest

from radron.sim.vehicle.multirotor import MultirotorTruth
from radron.sim.vehicle.px4.gains import equipped
from radron.sim.vehicle.px4.parameters import Parameters


def test_defaults_leave_the_vehicle_as_it_is():
    vehicle = MultirotorTruth(position_gain_ps=1.2, drag_ps=0.3)
    assert equipped(vehicle, Parameters(1, {})) is vehicle


def test_what_is_set_counts():
    parameters = Parameters(1, {"MPC_XY_VEL_P_ACC": 3.0, "SIH_KDV": 0.3, "MC_YAWRATE_MAX": 90.0})
    vehicle = equipped(MultirotorTruth(position_gain_ps=1.2), parameters)
    assert (vehicle.velocity_gain_ps, vehicle.drag_ps, vehicle.position_gain_ps) == (3.0, 0.3, 1.2)
    assert vehicle.maximum_yaw_rate_rps == pytest.approx(1.5708, abs=1e-4)
    before = parameters.changes
    parameters.set("MPC_XY_P", struct.unpack("<f", struct.pack("<f", 1.4))[0])
    assert parameters.changes == before + 1
    assert equipped(MultirotorTruth(), parameters).position_gain_ps == pytest.approx(1.4)


def test_a_gain_of_nothing_is_none_that_breaks_the_model():
    vehicle = equipped(MultirotorTruth(), Parameters(1, {"MPC_XY_VEL_P_ACC": 0.0, "MPC_XY_P": -1.0}))
    assert vehicle.velocity_gain_ps > 0.0
    assert vehicle.position_gain_ps > 0.0
