"""What all tests start from."""

import signal

from hypothesis import HealthCheck, settings

# An example fails by what it shows, and not by how long this machine takes for it.
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


def pytest_configure() -> None:
    """Take interrupts whatever the tests were started with: a shell's background job ignores them, and so would all processes
    that tests start and interrupt."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
