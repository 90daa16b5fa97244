"""State that survives a restart of the agent: kept in one file, written beside the steps when it has changed."""

from __future__ import annotations

import asyncio
import hashlib
import time
from pathlib import Path

import msgspec
from msgspec import Raw, Struct
from msgspec.structs import replace

from radron.agent.mission.memory import Memory
from radron.agent.outputs import write_durably
from radron.agent.shell.logs import Logger
from radron.agent.vehicle.interface import LaunchPlace
from radron.protocol import versions
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

SLOW_S = 5.0  # longer writes are reported
PROBE_S = 30.0  # interval of writes without a change, as on the ground: a full disk shows before a start


class State(Struct, frozen=True, kw_only=True):
    """The state from which an agent continues that is restarted in flight: the pilot's state, and the launch place."""

    memory: Memory | None = None
    launch: LaunchPlace | None = None

    def launch_in(self, mission: str) -> LaunchPlace | None:
        """Return the launch place for this mission; for another mission it is measured again once the vehicle stands."""
        if self.launch is None or self.launch.mission == mission:
            return self.launch
        return replace(self.launch, flown=False)


class _Written(Struct, frozen=True, kw_only=True):
    """The same in the file's encoding."""

    memory: Raw
    launch: Raw


class _Kept(_Written, frozen=True, kw_only=True):
    """The file's content: the state and its hash, because a flipped bit would send a drone somewhere else.

    The hash is of the bytes written: an agent of a newer release, with more fields in its state, still reads the file.
    """

    check: str
    version: int = 1  # as of files without one


def encode_state(state: State) -> bytes:
    """Return the content of a state file, from which a restarted agent continues."""
    memory, launch = Raw(msgspec.json.encode(state.memory)), Raw(msgspec.json.encode(state.launch))
    return msgspec.json.encode(
        _Kept(memory=memory, launch=launch, check=_check(msgspec.json.encode(state)), version=versions.STATE)
    )


def decode_state(content: bytes) -> State:
    """Decode the content of a state file; raises msgspec.MsgspecError if it is damaged, or not a state."""
    try:
        kept = msgspec.json.decode(content, type=_Kept)
        if kept.version > versions.STATE:
            raise msgspec.ValidationError(f"version {kept.version} of the state, and this release reads up to {versions.STATE}")
        written = msgspec.json.encode(_Written(memory=kept.memory, launch=kept.launch))
        state = msgspec.json.decode(written, type=State)
    except (UnicodeDecodeError, RecursionError) as error:
        raise msgspec.DecodeError(str(error)) from None
    if kept.check != _check(written):
        raise msgspec.ValidationError("its content does not match its check")
    return state


class StateFile:
    """The file with the state of one drone for a restarted agent, ``{folder}/{drone}.json``."""

    def __init__(self, folder: str, drone: str) -> None:
        self.path = Path(folder) / f"{drone}.json"

    def load(self) -> State:
        """Return the state that the previous agent stored; an empty state without a file.

        Raises:
            OSError: the file exists and cannot be read.
            msgspec.MsgspecError: not a state file, or damaged.
        """
        try:
            return decode_state(self.path.read_bytes())
        except FileNotFoundError:
            return State()

    def save(self, state: State) -> None:
        """Write the state to the file: after a power cut the file has the old or the new state, never a part. Raises OSError."""
        write_durably(self.path, encode_state(state))


def _check(written: bytes) -> str:
    return hashlib.blake2b(written, digest_size=8).hexdigest()


def unreadable(file: StateFile, error: Exception) -> CodedText:
    """Return the message to the operator about a state file that cannot be read."""
    reason = error.strerror if isinstance(error, OSError) else error
    text = f"{file.path} is not a readable state file ({reason}): a flight could not be resumed after a restart; move it away"
    return CodedText(Code.STATE_UNREADABLE, text)


def not_saved(reason: str | None) -> CodedText:
    """Return the message to the operator about a state that could not be written."""
    return CodedText(Code.STATE_NOT_SAVED, f"state not saved ({reason}): an agent that is restarted in flight will not rejoin it")


class StateStore:
    """Loads the state of the previous agent, and saves the present state in the background; without a folder nothing is saved."""

    def __init__(self, folder: str | None, drone: str, log: Logger) -> None:
        self._file = None if folder is None else StateFile(folder, drone)
        self._log = log
        self._saved: State | None = None  # content of the file; None: unknown, so that the next state is written in any case
        self._saving: asyncio.Task[None] | None = None
        self._saving_s = 0.0  # start of the last write (monotonic clock)
        self._failure: CodedText | None = None

    @property
    def problem(self) -> CodedText | None:
        """The reason why the state could not be saved, or a line if the disk does not respond; None without a problem."""
        if self._saving is not None and not self._saving.done() and time.monotonic() - self._saving_s > SLOW_S:
            return not_saved("the disk is too slow")
        return self._failure

    def load(self) -> State:
        """Return the state of the previous agent; an empty state without a file, or with an unreadable file."""
        if self._file is not None:
            try:
                return self._file.load()
            except (OSError, msgspec.MsgspecError) as error:
                self._log.error("state file not readable: a flight in progress is not resumed", error=str(error))
                self._failure = unreadable(self._file, error)
                self._file = None  # an unreadable file is never overwritten
        return State()

    def save(self, state: State) -> None:
        """Write a changed state in the background, and an unchanged state every ``PROBE_S``.

        While a write is running, a newer state waits for the next call.
        """
        is_due = state != self._saved or time.monotonic() - self._saving_s > PROBE_S
        if self._file is not None and is_due and (self._saving is None or self._saving.done()):
            self._saved = state
            self._saving_s = time.monotonic()
            self._saving = asyncio.create_task(self._write(self._file, state))

    async def _write(self, file: StateFile, state: State) -> None:
        try:
            await asyncio.to_thread(file.save, state)
            self._failure = None
        except OSError as error:
            self._saved = None
            self._failure = not_saved(error.strerror)
