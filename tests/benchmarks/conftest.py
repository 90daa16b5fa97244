"""Fixtures of the benchmarks' tests."""

from recorded_flights import flights  # noqa: F401 - a fixture
