"""An uploaded mission on board: fetched from the station, checked and kept, all beside the steps."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Sequence

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.errors import RadronError
from radron.agent.mission.uploads import Origin
from radron.agent.shell.logs import Logger
from radron.agent.shell.missionstore import keep
from radron.protocol.messages import Upload

Fetch = Callable[[str, Sequence[bytes]], Awaitable[bytes | None]]  # from a station, the content with parts of these hashes
TAKE_S = 60.0  # timeout of an upload, then reported to the operator


class UploadedMission:
    """Fetches, checks and stores a mission that an operator has uploaded, one at a time, without delaying the flight loop.

    ``is_kept``: a new mission is stored, and the agent must be restarted with it.
    """

    def __init__(self, drone: DroneConfig, filed: MissionConfig, log: Logger) -> None:
        """Set up the uploads. ``filed``: the mission in the drone's mission file."""
        self._drone, self._filed, self._log = drone, filed, log
        self._taking: asyncio.Task[str | None] | None = None
        self.is_kept = False

    def look(self, upload: Upload | None, fetch: Fetch, decline: Callable[[str], None]) -> None:
        """Begin to fetch ``upload``, or note the result of the fetch; call it regularly. ``decline``: called with the reason of a
        failure.
        """
        if self._taking is None:
            if upload is not None:
                self._taking = asyncio.create_task(self._take(upload, fetch), name="uploaded mission")
        elif self._taking.done():
            reason, self._taking = self._taking.result(), None
            if reason is None:
                self.is_kept = True
            else:
                self._log.warning("uploaded mission not taken", reason=reason)
                decline(reason)

    async def close(self) -> None:
        """Cancel the fetching of an uploaded mission, if it is in progress."""
        if self._taking is not None:
            self._taking.cancel()
            await asyncio.gather(self._taking, return_exceptions=True)

    async def _take(self, upload: Upload, fetch: Fetch) -> str | None:
        """Fetch, check and keep a mission. Returns why it was not taken, in one line; None: the mission is kept."""
        try:
            async with asyncio.timeout(TAKE_S):
                content = await fetch(upload.station, upload.parts)
            if content is None:
                return f"its content could not be fetched from {upload.station}: check that this drone reaches that computer"
            origin = Origin(
                station=upload.station,
                certificate=upload.certificate,
                taken_ns=time.time_ns(),
                instead_of=self._filed.mission_id,
            )
            await asyncio.to_thread(keep, content, upload.mission, self._drone, self._filed.swarm, origin)
        except TimeoutError:
            return f"its content did not come from {upload.station} within {TAKE_S:g} s"
        except RadronError as error:
            return str(error)
        except OSError as error:
            return f"it cannot be kept: {error.filename}: {error.strerror}"
        self._log.info("mission uploaded: beginning anew with it", mission=upload.mission, station=upload.station)
        return None
