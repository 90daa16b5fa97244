"""Records of updates on the data partition: the update on trial, the outcome of the last update, the releases in the slots."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import msgspec

from radron.agent.outputs import write_durably
from radron.agent.update.errors import UpdateError
from radron.protocol.onboard import Outcome, Release, Report, Trial

FOLDER = Path("/var/lib/radron-update")
REPORT = Path("/run/radron-agent/report.json")
OS_RELEASE = Path("/usr/lib/os-release")
STALE_S = 5.0  # the agent reports once a second
_T = TypeVar("_T")


class Records:
    """The records of software updates on an onboard computer: running trial, last outcome, and the releases on its disk.

    An update is written to the other of two system partitions (slots), and is on trial until it works after a reboot. Unreadable
    records count as missing: a computer must work without them.
    """

    def __init__(self, folder: Path = FOLDER) -> None:
        self.folder = folder

    @property
    def trial(self) -> Trial | None:
        """The software update on trial, not confirmed yet; None without one."""
        return _decoded(self.folder / "trial.json", Trial)

    @property
    def outcome(self) -> Outcome | None:
        """The outcome of the last software update; None without one."""
        return _decoded(self.folder / "outcome.json", Outcome)

    @property
    def slots(self) -> dict[str, Release]:
        """The releases in the two system partitions (slots), as far as known."""
        return _decoded(self.folder / "slots.json", dict[str, Release]) or {}

    @property
    def busy(self) -> bool:
        """Whether a software update is being installed now."""
        try:
            with self.changing():
                return False
        except UpdateError:
            return True

    @contextmanager
    def changing(self) -> Iterator[None]:
        """Hold the lock on changes of the next boot, for one process at a time, during the ``with`` block.

        Raises:
            UpdateError: another process holds the lock.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(self.folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
        except BlockingIOError:
            raise UpdateError("another update is being installed: wait for its end") from None
        finally:
            os.close(descriptor)

    def begin(self, trial: Trial) -> None:
        """Record that a system partition (slot) is on trial.

        The file ``trying`` says so for a shell script, should the Python of the new release not work.
        """
        write_durably(self.folder / "trying", f"{trial.slot}\n".encode())
        self._write("trial.json", trial)

    def tell(self, outcome: Outcome) -> None:
        """Record the outcome of a software update."""
        self._write("outcome.json", outcome)

    def end(self) -> None:
        """Record that no software update is on trial."""
        for name in ("trial.json", "trying"):
            (self.folder / name).unlink(missing_ok=True)

    def put_slot(self, slot: str, release: Release | None) -> None:
        """Record the release in a system partition (slot); None: unknown."""
        slots = {name: known for name, known in self.slots.items() if name != slot}
        changed = slots if release is None else slots | {slot: release}
        if changed != self.slots:
            self._write("slots.json", changed)

    def _write(self, name: str, content: object) -> None:
        write_durably(self.folder / name, msgspec.json.encode(content))


def read_report(file: Path, uptime_s: float) -> Report | None:
    """Return the agent's report on its state; None if there is none within ``STALE_S``. ``uptime_s``: now, by the monotonic
    clock.
    """
    report = _decoded(file, Report)
    return report if report is not None and 0.0 <= uptime_s - report.uptime_s < STALE_S else None


def own_release(file: Path = OS_RELEASE) -> Release:
    """Return the release of this system; version 0 without a date on a system that is not a radron image."""
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    values = {name: value.strip('"') for name, _, value in (line.partition("=") for line in lines)}
    return Release(version=values.get("IMAGE_VERSION", "0"), build=values.get("BUILD_ID", ""))


def _decoded(file: Path, kind: type[_T]) -> _T | None:
    try:
        return msgspec.json.decode(file.read_bytes(), type=kind)
    except (OSError, msgspec.MsgspecError):
        return None
