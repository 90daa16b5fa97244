"""The state of the swarm for TAK: Cursor on Target events over UDP, TCP or TLS, by the library pytak.

A lost link is connected again.
"""

from __future__ import annotations

import asyncio
import logging
import os
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

from radron.agent.errors import RadronError
from radron.station.picture.frame import ConeCurve, Event, Frame, Raster
from radron.station.picture.picture import Picture
from radron.station.viewers.cot import CursorOnTarget

with warnings.catch_warnings():  # from the parts of pytak that need further packages
    warnings.simplefilter("ignore")
    import pytak
for _part in ("classes", "client_functions"):
    logging.getLogger(f"pytak.{_part}").setLevel(logging.CRITICAL)  # the page reports the state of the link

SCHEMES = ("udp", "tcp", "tls")
DRONES_MS, SOURCE_MS = 1000, 5000  # intervals
MAX_WAITING_EVENTS = 400  # events for a link that is too slow or lost: the oldest are dropped
RECONNECT_S = 5.0
SETTINGS = "PYTAK_"  # prefix of the environment variables with certificates and keys
NEEDED = ("PYTAK_TLS_CLIENT_CERT", "PYTAK_TLS_CLIENT_KEY")  # for TLS


class TakError(RadronError):
    """The state of the swarm cannot be sent to TAK as requested."""


class Tak:
    """Sends drones and sources to TAK at regular intervals, as Cursor on Target events."""

    def __init__(self, picture: Picture, url: str, tell: Callable[[str, bool], None]) -> None:
        """``url``: address of TAK. ``tell``: called with a line of text at each change of the link, and whether it is a warning.

        Raises:
            TakError: no address of TAK, or a mission without a datum.
        """
        if picture.mission.datum is None:
            raise TakError("--tak: the mission has no [datum], so nobody knows where its places are on Earth")
        self._cot = CursorOnTarget(picture.mission.datum, picture.about(replay=False))
        self._url, self._target, self._tell = url, _checked(url), tell
        self._queue: asyncio.Queue[bytes] = asyncio.Queue(MAX_WAITING_EVENTS)
        self._news: list[tuple[str, bool]] = []  # link changes that wait for the next frame, for its time
        self._trouble = ""  # the last reported reason
        self._drones_ms = self._source_ms = 0

    def show(self, frame: Frame, layers: list[Raster], cones: list[ConeCurve]) -> None:
        """Queue the events for a state of the swarm, if the interval since the last events has passed."""
        for line, warning in self._news:
            self._tell(line, warning)
        self._news.clear()
        for event in self._due(frame):
            if self._queue.full():
                self._queue.get_nowait()
            self._queue.put_nowait(event)

    @property
    def waiting(self) -> int:
        """Number of events that wait for the link."""
        return self._queue.qsize()

    def note(self, event: Event) -> None:
        """Ignore an event of the timeline, as TAK shows positions only."""

    async def run(self) -> None:
        """Keep the link to TAK connected, until cancelled."""
        while True:
            try:
                await self._keep()
            except (OSError, ValueError, SyntaxError, SystemError) as error:  # all that pytak raises
                reason = str(error.__cause__ or error) or type(error).__name__
                if reason != self._trouble:
                    self._trouble = reason
                    self._news.append((f"TAK {self._url}: {reason}; trying again", True))
            await asyncio.sleep(RECONNECT_S)

    async def _keep(self) -> None:
        """Send events over one connection until it is lost; data from a server is read and dropped."""
        config = {key: value for key, value in os.environ.items() if key.startswith(SETTINGS)}
        config["COT_URL"] = self._target
        reader, writer = await pytak.protocol_factory(config)
        self._news.append((f"TAK {self._url}: connected", False))
        self._trouble = ""
        tasks = [asyncio.create_task(pytak.TXWorker(self._queue, config, writer).run())]
        if reader is not None:
            tasks.append(asyncio.create_task(_drain(reader)))
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            writer.close()

    def _due(self, frame: Frame) -> Iterator[bytes]:
        if frame.at_ms - self._drones_ms >= DRONES_MS:
            self._drones_ms = frame.at_ms
            yield from self._cot.drones(frame)
        if frame.at_ms - self._source_ms >= SOURCE_MS and frame.source is not None:
            self._source_ms = frame.at_ms
            yield from self._cot.sources(frame)


async def _drain(reader: asyncio.StreamReader) -> None:
    while await reader.read(65_536):
        pass
    raise ConnectionError("closed by the server")


def _checked(url: str) -> str:
    """Return the address in pytak's form, write-only for UDP. Raises TakError."""
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        port = None
    if not port or parts.scheme not in SCHEMES or not parts.hostname or parts.path or parts.query:
        raise TakError(f"--tak {url}: give {', '.join(SCHEMES)}://HOST:PORT, such as udp://239.2.3.1:6969")
    if parts.scheme == "tls":
        for name in NEEDED:
            if not Path(os.environ.get(name, "")).is_file():
                raise TakError(f"--tak {url}: name a PEM file in the environment variable {name}")
    return url.replace("udp://", "udp+wo://", 1) if parts.scheme == "udp" else url
