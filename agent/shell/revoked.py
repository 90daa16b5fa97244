"""Revocations that survive a restart, and the session opened anew without the revoked members."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from radron.agent.outputs import write_durably
from radron.protocol.codec import decode, encode
from radron.protocol.codes import Code
from radron.protocol.errors import MeshError, ProtocolError
from radron.protocol.revocations import Revocation, Revoked
from radron.protocol.texts import CodedText

LOOK_S = 0.2
TURN_S, TURNS_S = 0.7, 7.0  # between two drones, and for all: in turn, so that most of the swarm stays linked


class RevokedFile:
    """The file with the revocations (withdrawn rights of members) known to one drone, ``{folder}/{drone}.revoked``.

    Without a folder nothing is stored. The file holds the revocations as signed: every reader verifies the signatures again.
    """

    def __init__(self, folder: str | None, drone: str) -> None:
        self.path = Path(folder) / f"{drone}.revoked" if folder is not None else None
        self._drone = drone
        self._saved: tuple[Revocation, ...] = ()
        self._saving: asyncio.Task[None] | None = None
        self.problem: CodedText | None = None

    def load(self) -> tuple[Revocation, ...]:
        """Return the revocations of the file; none, and a ``problem``, if the file cannot be read."""
        if self.path is None:
            return ()
        try:
            found = decode(self.path.read_bytes())
        except FileNotFoundError:
            return ()
        except (OSError, ProtocolError) as error:
            return self._unreadable(error)
        if not isinstance(found, Revoked):
            return self._unreadable("it holds something else")
        self._saved = found.held
        return found.held

    def passed_on(self, now_ns: int) -> tuple[Revoked, ...]:
        """Return the revocations of the file as a ``Revoked`` message of this drone; empty without revocations."""
        held = self.load()
        return (Revoked(stamp_ns=now_ns, drone=self._drone, held=held),) if held else ()

    def save(self, held: tuple[Revocation, ...]) -> None:
        """Write changed revocations in the background.

        While a write is running, newer revocations wait for the next call. Without known revocations, as when the file's
        signatures can no longer be verified, the file stays unchanged.
        """
        if self.path is not None and held and held != self._saved and (self._saving is None or self._saving.done()):
            self._saved = held
            content = encode(Revoked(stamp_ns=max(one.stamp_ns for one in held), drone=self._drone, held=held))
            self._saving = asyncio.create_task(self._write(self.path, content))

    def _unreadable(self, reason: object) -> tuple[Revocation, ...]:
        text = "whom the swarm has revoked in an earlier flight is not known; move it away, and revoke them again"
        self.problem = CodedText(Code.REVOCATIONS_UNREADABLE, f"{self.path} is not readable ({reason}): {text}")
        self.path = None  # an unreadable file is never overwritten
        return ()

    async def _write(self, path: Path, content: bytes) -> None:
        try:
            await asyncio.to_thread(write_durably, path, content)
            self.problem = None
        except OSError as error:
            self._saved = ()
            text = f"revocations not saved ({error.strerror}): after a restart this drone would not know them"
            self.problem = CodedText(Code.REVOCATIONS_NOT_SAVED, text)


def turn_s(index: int, count: int) -> float:
    """Return the wait (s) of the drone with this index before its turn, among ``count`` drones.

    Drones reopen their links one after the other, so that most of the swarm stays linked.
    """
    return index * min(TURN_S, TURNS_S / count)


async def exclude(
    revoked: Callable[[], frozenset[str]],
    excluded: frozenset[str],
    reopen: Callable[[frozenset[str]], Awaitable[None]],
    wait_s: float,
) -> None:
    """Open the network session again after each change of the revoked members, until cancelled. A failed attempt is repeated.

    Args:
        revoked: names of the revoked members.
        excluded: members excluded from the present session.
        reopen: opens the session without the given members.
        wait_s: for this drone's turn.
    """
    while True:
        await asyncio.sleep(LOOK_S)
        if revoked() == excluded:
            continue
        await asyncio.sleep(wait_s)
        names = revoked()
        while excluded != names:
            try:
                await reopen(names)
                excluded = names
            except MeshError:
                await asyncio.sleep(LOOK_S)
