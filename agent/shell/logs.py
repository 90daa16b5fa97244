"""Structured logs on the error stream: JSON lines, or readable text on a terminal."""

from __future__ import annotations

import io
import logging
import os
import select
import sys
from typing import cast

import structlog
from structlog.typing import FilteringBoundLogger as Logger

__all__ = ["Logger", "set_up_logs"]

_PIECE_BYTES = 4096  # maximum of a write to a writable pipe that does not block (PIPE_BUF)


class UnblockingStream(io.TextIOBase):
    """A text stream for logs that writes to a file descriptor without blocking; text that would block is dropped.

    A log reader that stops reading must not stop the flight.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._poll = select.poll()
        self._poll.register(fd, select.POLLOUT)

    def write(self, text: str) -> int:
        """Write a text of the log, or its beginning if more would block; always return the full length."""
        data = text.encode(errors="replace")
        for start in range(0, len(data), _PIECE_BYTES):
            if not any(event & select.POLLOUT for _, event in self._poll.poll(0)):
                break
            try:
                os.write(self._fd, data[start : start + _PIECE_BYTES])
            except OSError:
                break
        return len(text)


def set_up_logs(drone: str, verbose: bool = False) -> Logger:
    """Return the agent's logger: each line has time, level, event and the drone's id. ``verbose``: also debug lines."""
    terminal = sys.stderr.isatty()
    last: list[structlog.typing.Processor] = (
        [structlog.dev.ConsoleRenderer()]
        if terminal
        else [structlog.processors.format_exc_info, structlog.processors.JSONRenderer(default=str)]
    )
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=not terminal),
            *last,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.DEBUG if verbose else logging.INFO),
        logger_factory=structlog.WriteLoggerFactory(UnblockingStream(sys.stderr.fileno())),  # type: ignore[arg-type]
        cache_logger_on_first_use=True,
    )
    return cast(Logger, structlog.get_logger().bind(drone=drone))
