"""An autopilot that does nothing but tell the time by MAVLink."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

from pymavlink.dialects.v20 import common as mavlink


@contextmanager
def telling(port: int, utc_ns: Callable[[], int], period_s: float = 0.02) -> Iterator[None]:
    """While it is entered, the time is sent to this port of the own computer again and again."""
    over, sender = Event(), mavlink.MAVLink(None, 1, 1)

    def work() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            while not over.wait(period_s):
                link.sendto(mavlink.MAVLink_system_time_message(utc_ns() // 1000, 7340).pack(sender), ("127.0.0.1", port))

    thread = Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
