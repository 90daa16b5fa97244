"""A recorded flight that several tests read."""

import pytest
from recorded_flights import fly_recorded

DATUM = {"mission__datum": {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 488.0}}


@pytest.fixture(scope="session")
def flights_on_earth(tmp_path_factory):
    """Records of three drones that find the source and follow it for 5 s, on Earth."""
    return fly_recorded(tmp_path_factory.mktemp("flights"), mission__track__duration_s=5.0, **DATUM)
