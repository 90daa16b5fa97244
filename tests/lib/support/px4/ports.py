"""The fixed ports of PX4's instances on this machine: for one test at a time, also of tests that run in parallel."""

from __future__ import annotations

import fcntl
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def px4_ports() -> Iterator[None]:
    """Wait until the ports are free, and take them."""
    with (Path(tempfile.gettempdir()) / "radron-px4-ports").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
