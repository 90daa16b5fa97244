"""``python -m agent.shell.foldworker PARENT``: the process that computes a slow estimator for an agent.

It gets pickles of the order, then of one task after the other, through its standard input, and answers each through its standard
output, all preceded by their lengths. It ends with the agent.
"""

from __future__ import annotations

import os
import pickle
import resource
import signal
import struct
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from agent.shell.heartbeat import die_with

if TYPE_CHECKING:
    from agent.config.mission import MissionConfig
    from agent.fusion.deferred import Task, Told

LENGTH = struct.Struct("<I")  # of the pickle that follows
MOST_BYTES = 1_500_000_000  # of memory
_NICENESS = 5  # the flight goes first
_OUT_OF_MEMORY = "900"  # and if memory runs out, the kernel ends this process first


Order = tuple[str, "MissionConfig"]  # what is to be computed: the estimator's name, and its mission
Answer = tuple[frozenset[int], "Told | None"]  # numbers of the states to go on from; after a question's last task, what is told


def packed(content: Order | Task | Answer) -> bytes:
    """As it is sent to the other process."""
    data = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)
    return LENGTH.pack(len(data)) + data


def serve(received: BinaryIO, sent: BinaryIO) -> None:
    """Compute until there is nothing more to come; errors of the estimator end it."""
    from agent.fusion.deferred import Folder  # noqa: PLC0415  the agent needs the types of this module alone
    from agent.fusion.registry import estimator_named  # noqa: PLC0415

    order = _read(received)
    if order is None:
        return
    folder = Folder(estimator_named(*order))
    answer: Answer = frozenset(), None
    while True:
        sent.write(packed(answer))
        sent.flush()
        task = _read(received)
        if task is None:
            return
        told = folder.fold(task)
        answer = folder.held, told


def _read(received: BinaryIO):  # type: ignore[no-untyped-def]  # what the agent has packed
    """The next thing; None at the end."""
    head = received.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    return pickle.loads(received.read(*LENGTH.unpack(head)))


def _behind_the_flight() -> None:
    """Leave processor and memory to the flight, as far as that is allowed here."""
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES))
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(_OUT_OF_MEMORY)
    with suppress(OSError):
        os.nice(_NICENESS)


if __name__ == "__main__":
    die_with(int(sys.argv[1]))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C also reaches the supervisor, which ends the agent
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library may print is no answer
    _behind_the_flight()
    serve(sys.stdin.buffer, answers)
