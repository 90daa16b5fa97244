"""PX4's numbers for modes and landed states, as measured on a real one."""

import pytest

from radron.agent.vehicle.interface import FlightMode
from radron.agent.vehicle.modes import flight_mode, is_in_air


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
        (0x4040000, FlightMode.MANUAL),  # a mission of another controller
        (0, FlightMode.MANUAL),
    ],
)
def test_modes(custom_mode: int, mode: FlightMode) -> None:
    assert flight_mode(custom_mode) is mode


@pytest.mark.parametrize(("landed_state", "in_air"), [(0, False), (1, False), (2, True), (3, False), (4, True)])
def test_in_the_air_by_the_landed_state_alone(landed_state: int, in_air: bool) -> None:
    """TAKEOFF (3) may come before or after the heartbeat says so; its mode is then still the former one."""
    assert is_in_air(landed_state) is in_air
