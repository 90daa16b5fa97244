"""What must survive a restart of the agent in flight, in a file."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec
from msgspec import Struct

from agent.memory import Memory
from agent.vehicle.interface import LaunchPlace


class State(Struct, frozen=True, kw_only=True):
    """What the pilot must know, and where the local frame lies in the autopilot's."""

    memory: Memory | None = None
    launch: LaunchPlace | None = None


class StateFile:
    """The state of one drone, as ``{folder}/{drone}.json``."""

    def __init__(self, folder: str, drone: str) -> None:
        self._path = Path(folder) / f"{drone}.json"

    def load(self) -> State:
        """The state of the agent that ran before; an empty one where there was none.

        Raises:
            OSError: the file is there and cannot be read.
            msgspec.MsgspecError: it is no such file.
        """
        try:
            return msgspec.json.decode(self._path.read_bytes(), type=State)
        except FileNotFoundError:
            return State()

    def save(self, state: State) -> None:
        """Replace the file at once and for good: a power cut leaves the older or the newer one. Raises OSError."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        fresh = self._path.with_suffix(".new")
        with fresh.open("wb") as file:
            file.write(msgspec.json.encode(state))
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(self._path)
