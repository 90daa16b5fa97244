"""A recorded flight that several tests read."""

from recorded_flights import flights  # noqa: F401 - a fixture
