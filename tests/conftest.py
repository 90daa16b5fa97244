"""What all tests start from."""

import signal


def pytest_configure() -> None:
    """Take interrupts whatever the tests were started with: a shell's background job ignores them, and so would all processes
    that tests start and interrupt."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
