"""Common start of all tests."""

import signal

from hypothesis import HealthCheck, settings

# An example fails by its result, and not by its duration on this machine.
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


def pytest_configure() -> None:
    """Take interrupts whatever the tests were started with: a shell's background job ignores them, and so would all processes
    that tests start and interrupt."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
