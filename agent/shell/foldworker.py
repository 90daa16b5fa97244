"""``python -m radron.agent.shell.foldworker PARENT``: the process that computes a slow estimator for an agent.

The process reads pickles of the order, then of one task after the other, from its standard input, and answers each through its
standard output, all preceded by their lengths. The agent's end is also the end of this process.
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

from radron.agent.shell.heartbeat import die_with

if TYPE_CHECKING:
    from radron.agent.config.mission import MissionConfig
    from radron.agent.fusion.deferred import Task, Told

LENGTH = struct.Struct("<I")  # of the pickle that follows
MOST_BYTES = 1_500_000_000  # of memory
_NICENESS = 5  # the flight goes first
_OUT_OF_MEMORY = "900"  # the kernel ends this process first if memory runs out


Order = tuple[str, "MissionConfig"]  # the estimator's name and mission
Answer = tuple[frozenset[int], "Told | None"]  # numbers of the states held for later tasks; result of a question's last task


def packed(content: Order | Task | Answer) -> bytes:
    """Return the bytes of a message between the agent and the process that computes its estimator: length, and pickled
    content.
    """
    data = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)
    return LENGTH.pack(len(data)) + data


def serve(received: BinaryIO, sent: BinaryIO) -> None:
    """Compute tasks of the estimator and send the answers, until the input ends; errors of the estimator are raised."""
    from radron.agent.fusion.deferred import Folder  # noqa: PLC0415  the agent needs the types of this module alone
    from radron.agent.fusion.registry import estimator_named  # noqa: PLC0415

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
    """Return the next order or task; None at the end of the input."""
    head = received.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    return pickle.loads(received.read(*LENGTH.unpack(head)))


def _behind_the_flight() -> None:
    """Leave processor and memory to the flight, as far as the system's rights allow."""
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
    os.dup2(2, 1)  # prints of libraries must not mix with the answers
    _behind_the_flight()
    serve(sys.stdin.buffer, answers)
