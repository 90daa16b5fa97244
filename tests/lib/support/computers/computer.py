"""An onboard computer without hardware, in the place of ``radron-update``.

Run: python -m support.computers.computer FOLDER COMMAND...
The updater is the real one. Not real: RAUC, with a JSON file as its bundle here; and a restart, which boots the files in FOLDER.
``report.json`` is the agent's report; releases named in ``bad`` have an agent that never gets well.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from radron.agent.errors import RadronError
from radron.agent.update.install import Updater
from radron.agent.update.settle import Surroundings, settle
from radron.protocol.onboard import Computer, Report
from support.computers.onboard import OnboardFiles, well

DAY_NS = 86_400_000_000_000


class VirtualComputer:
    """The files of one computer; ``install`` and ``rollback`` as on board."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        made = folder.exists() and (folder / "cmdline").exists()
        kept = (folder / "grubenv").read_bytes() if made else None
        self.files = OnboardFiles(folder)
        if kept is not None:
            self.files.grubenv.write_bytes(kept)
        else:
            self.files.boot()
            self.files.slots.mark_good("A")
            self.files.records.put_slot("A", self.files.release)
        self.files.content |= self.files.records.slots

    @property
    def report(self) -> Report | None:
        """The agent's."""
        file = self.folder / "report.json"
        return msgspec.json.decode(file.read_bytes(), type=Report) if file.exists() else well()

    def status(self) -> Computer:
        """As in the output of ``radron-update status``."""
        slots, records = self.files.slots, self.files.records
        return Computer(
            name="radron-d1",
            release=self.files.content[slots.booted],
            slot=slots.booted,
            slots=records.slots,
            attempts=slots.attempts(slots.booted),
            trial=records.trial,
            busy=records.busy,
            outcome=records.outcome,
            report=self.report,
            agent="active",
            disk_free_mb=20_000,
            disk_mb=30_000,
            clock_ns=time.time_ns(),
            clock_offset_s=0.0002,
            certificate_ns=time.time_ns() + 20 * DAY_NS + 1_000_000_000,
        )

    @property
    def updater(self) -> Updater:
        """As on board."""
        files, release = self.files, self.files.content[self.files.slots.booted]
        return Updater(files.slots, files.records, release, lambda: self.report, self._restart, _say, time.time_ns, self._rauc)

    def _restart(self) -> None:
        self.files.content |= self.files.records.slots
        bad = (self.folder / "bad").read_text().split() if (self.folder / "bad").exists() else []
        again = True
        while again:
            again = False
            self.files.boot()
            running = self.files.release
            clock = iter(range(10_000))

            def reboot() -> None:
                nonlocal again
                again = True

            around = Surroundings(
                report=lambda running=running: None if running.version in bad else well(),  # type: ignore[misc]
                excuse=lambda: "failed",
                reboot=reboot,
                say=lambda text: None,
                uptime_s=lambda clock=clock: float(next(clock)),  # type: ignore[misc]
                sleep=lambda duration_s: None,
            )
            settle(self.files.slots, self.files.records, running, around)

    def _rauc(self, command: list[str], tell: Callable[[str], None]) -> tuple[int, list[str]]:
        bundle = json.loads(Path(command[-1]).read_bytes())
        if command[1] == "info":
            if bundle.get("foreign"):
                return 1, ["signature verification failed: Verify error: self-signed certificate"]
            return 0, [json.dumps({"compatible": "radron-nuc"} | bundle)]
        tell("100% Installing done.")
        self.files.slots.answer("set-state", self.files.slots.other(self.files.slots.booted), "bad")
        self.files.slots.answer("set-primary", self.files.slots.other(self.files.slots.booted))
        return 0, []


def _say(text: str) -> None:
    print(f"radron-update: {text}", flush=True)


def main() -> None:
    """Run one command."""
    computer = VirtualComputer(Path(sys.argv[1]))
    try:
        match sys.argv[2:]:
            case ["status"]:
                print(msgspec.json.encode(computer.status()).decode())
            case ["install", bundle, *options]:
                computer.updater.install(Path(bundle), "--older" in options)
            case ["rollback"]:
                computer.updater.roll_back()
    except RadronError as error:
        print(f"radron-update: {error}", file=sys.stderr)
        os._exit(2)


if __name__ == "__main__":
    main()
