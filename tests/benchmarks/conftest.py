"""Fixtures of the benchmarks' tests."""

from support.flights.recorded_flights import flights  # noqa: F401 - a fixture
