"""PX4's numbers for modes and landed states, as measured on a real one."""

import pytest

from agent.vehicle.interface import FlightMode
from agent.vehicle.modes import flight_mode, is_in_air


@pytest.mark.parametrize(
    ("custom_mode", "mode"),
    [
        (0x3040000, FlightMode.HOLD),
        (0x2040000, FlightMode.TAKEOFF),
        (0x5040000, FlightMode.RETURN),
        (0x6040000, FlightMode.LAND),
        (0x60000, FlightMode.OFFBOARD),
        (0x30000, FlightMode.MANUAL),  # position
        (0x10000, FlightMode.MANUAL),
        (0x4040000, FlightMode.MANUAL),  # a mission: somebody else's
        (0, FlightMode.MANUAL),
    ],
)
def test_modes(custom_mode: int, mode: FlightMode) -> None:
    assert flight_mode(custom_mode) is mode


@pytest.mark.parametrize(
    ("landed_state", "mode", "in_air"),
    [
        (0, FlightMode.HOLD, False),
        (1, FlightMode.HOLD, False),
        (2, FlightMode.OFFBOARD, True),
        (3, FlightMode.TAKEOFF, False),
        (3, FlightMode.HOLD, True),  # the takeoff is over
        (4, FlightMode.LAND, True),
    ],
)
def test_in_the_air(landed_state: int, mode: FlightMode, in_air: bool) -> None:
    assert is_in_air(landed_state, mode) is in_air
