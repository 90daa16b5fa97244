"""The state file of a running agent: written where the state has changed, beside the steps."""

from __future__ import annotations

import asyncio

import msgspec

from agent.logs import Logger
from agent.statefile import State, StateFile


class Keeper:
    """Keeps what must survive a restart in flight; without a folder for it, nothing."""

    def __init__(self, folder: str | None, drone: str, log: Logger) -> None:
        self._file = None if folder is None else StateFile(folder, drone)
        self._log = log
        self._saved: State | None = None  # what is in the file; None: not known, so that the next state is written in any case
        self._saving: asyncio.Task[None] | None = None
        self.problem: str | None = None

    def load(self) -> State:
        """The state of the agent that ran before; an empty one where there is none, or none that can be read."""
        if self._file is not None:
            try:
                return self._file.load()
            except (OSError, msgspec.MsgspecError) as error:
                self._log.error("state file not readable: a flight that was on is not taken up again", error=str(error))
        return State()

    def keep(self, state: State) -> None:
        """Have a state written, unless it is written already. A write that is under way is waited for by the next call."""
        if self._file is not None and state != self._saved and (self._saving is None or self._saving.done()):
            self._saved = state
            self._saving = asyncio.create_task(self._save(self._file, state))

    async def _save(self, file: StateFile, state: State) -> None:
        try:
            await asyncio.to_thread(file.save, state)
            self.problem = None
        except OSError as error:
            self._saved = None
            self.problem = f"state not saved ({error.strerror}): an agent that is restarted in flight stays out of it"
