"""A recorded flight that several tests read."""

from support.flights.recorded_flights import flights  # noqa: F401 - a fixture
