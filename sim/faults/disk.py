"""Disk of a simulated drone with the saved state of its agent, and what a restarted agent finds there.

Flight records are not written in lockstep; their faults are played live only.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from radron.agent.errors import ConfigError
from radron.agent.mission.memory import Memory
from radron.agent.shell.statestore import State, decode_state, encode_state
from radron.protocol.codes import Code
from radron.protocol.revocations import Revocation
from radron.protocol.texts import CodedText
from radron.sim.faults.agents import Disk
from radron.sim.faults.base import Fault
from radron.sim.faults.kinds import LIVE_ONLY, kind_of
from radron.sim.faults.schedule import Active

SLOW_WRITE_NS = 10_000_000_000  # until a file is written on a slow disk
_FLIPPED_BITS = 3

Struck = Sequence[tuple[Disk, Active]]


class StateDisk:
    """The saved files of one agent on a simulated disk, which may be full, slow or damaged.

    ``problem``: why its state could not be written or read; None without a problem. ``revoked``: the known revocations, in a
    file of their own, written at the shell's next look (``process.LOOK_NS``), also on a slow disk.
    """

    def __init__(self) -> None:
        self.problem: CodedText | None = None
        self.revoked: tuple[Revocation, ...] = ()
        self._content = b""
        self._writing: tuple[int, bytes] | None = None  # time of completion, content
        self._readable = True

    def keep(self, memory: Memory | None, struck: Struck, now_ns: int) -> None:
        """Write a changed state to the disk, as the agent's shell does; a newer state waits until the present write is done.

        ``struck``: active faults of this disk.
        """
        hows = {fault.how for fault, _ in struck}
        if self._writing is not None and now_ns >= self._writing[0]:
            self._content, self._writing = self._writing[1], None
        content = encode_state(State(memory=memory))
        if not self._readable or self._writing is not None or content == self._content:
            return
        if "full" in hows:
            self.problem = CodedText(Code.STATE_NOT_SAVED, "state not saved (No space left on device)")
            return
        self.problem = None
        if "slow" in hows:
            self._writing = now_ns + SLOW_WRITE_NS, content
        else:
            self._content = content

    def keep_revoked(self, held: tuple[Revocation, ...], struck: Struck) -> None:
        """Write the known revocations to the disk, unless it is full."""
        if all(fault.how != "full" for fault, _ in struck):
            self.revoked = held

    def load(self, struck: Struck) -> Memory | None:
        """Return the state that a restarted agent finds on the disk; an unreadable file is left as it is."""
        self._writing, self.problem, self._readable = None, None, True
        content = self._content
        for fault, active in struck:
            if fault.how == "state-torn":
                content = content[: len(content) // 2]
            elif fault.how == "state-flipped" and content:
                bits = active.rng.integers(8 * len(content), size=_FLIPPED_BITS).tolist()
                whole = int.from_bytes(content) ^ sum(1 << bit for bit in set(bits))
                content = whole.to_bytes(len(content))
        try:
            return decode_state(content).memory if content else None
        except msgspec.MsgspecError as error:
            self._readable = False
            self.problem = CodedText(Code.STATE_UNREADABLE, f"no readable state file ({error})")
            return None


def check_playable(faults: Sequence[Fault], where: str) -> None:
    """Raise ConfigError for faults that only live flights can play."""
    for number, fault in enumerate(faults):
        if isinstance(fault, LIVE_ONLY):
            raise ConfigError(
                f"{where}: fault[{number}] ({kind_of(fault)}): only live flights play it: use radron-sim live, or remove it"
            )
        if isinstance(fault, Disk) and fault.how.startswith("record-"):
            raise ConfigError(
                f"{where}: fault[{number}] ({kind_of(fault)}): how: {fault.how!r} needs a flight record, which only live flights "
                "write: fly it with radron-sim live, or remove it"
            )
