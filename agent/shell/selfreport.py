"""What this agent tells its computer once a second: ``report.json`` in systemd's ``RUNTIME_DIRECTORY``, if there is one.

``radron-update`` judges by it whether an update works, and ``radron-deploy`` whether a vehicle is armed. It is in memory, not on
a disk that could delay it. Also here: what the computer's updater has to tell through the agent.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agent.update.records import Records
from protocol.messages import Stage
from protocol.onboard import REPORT_FILE, Report
from protocol.stages import ON_GROUND

if TYPE_CHECKING:
    from agent.flight.recorded import RecordedPilot
    from agent.pilot import Pilot
    from agent.vehicle.px4 import Px4Vehicle
    from protocol.mesh.session import Mesh

SOFTWARE = "software: "  # how what it tells of updates begins
PERIOD_S = 1.0
CAMERA_S = 10.0  # between two readouts of a camera that works


def runtime_folder(environment: Mapping[str, str] = os.environ) -> Path | None:
    """Where this agent tells its computer something, as the service manager says; None: nowhere."""
    folder = environment.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return Path(folder) if folder else None


class SelfReport:
    """Writes the reports of one run of the agent."""

    def __init__(self, folder: Path | None, clock_s: Callable[[], float] = time.monotonic) -> None:
        """``folder``: None: there are no reports."""
        self._file = folder / REPORT_FILE if folder is not None else None
        self._clock_s = clock_s
        self._readout_s = float("-inf")

    @classmethod
    def here(cls, environment: Mapping[str, str] = os.environ) -> SelfReport:
        """Where the service manager says."""
        return cls(runtime_folder(environment))

    def readout(self) -> None:
        """The camera has answered."""
        self._readout_s = self._clock_s()

    async def run(self, present: Callable[[], Report]) -> None:
        """Report until cancelled. ``present``: the report, in which this fills in time, version and camera."""
        release = version("radron")
        try:
            while self._file is not None:
                now_s = self._clock_s()
                camera = now_s - self._readout_s < CAMERA_S
                report = msgspec.structs.replace(present(), uptime_s=now_s, version=release, camera=camera)
                self._write(self._file, msgspec.json.encode(report))
                await asyncio.sleep(PERIOD_S)
        finally:
            if self._file is not None:
                with suppress(OSError):
                    self._file.unlink()

    def _write(self, file: Path, content: bytes) -> None:
        """Readers see one report or the next."""
        fresh = file.with_suffix(".new")
        with suppress(OSError):
            fresh.write_bytes(content)
            fresh.replace(file)


def report_of(boot: str, pilot: Pilot | RecordedPilot, mesh: Mesh, vehicle: Px4Vehicle) -> Report:
    """What one run has to report, without what ``SelfReport`` fills in. ``boot``: its id."""
    differing = (text.partition(" ")[0] for text in mesh.differing)  # these are heard, too
    telemetry, px4 = vehicle.telemetry, vehicle.messages.version
    return Report(
        uptime_s=0.0,
        boot=boot,
        version="",
        stage=pilot.stage,
        armed=telemetry.seen is not None and telemetry.seen.armed,
        alive=tuple(sorted({*mesh.alive, *differing})),
        autopilot=not telemetry.is_lost(time.monotonic()),
        px4=None if px4 is None else px4.number,
        parameters=vehicle.parameters.values,
        problems=vehicle.problems,
    )


class Updates:
    """What this computer's updater has to tell, looked up on the ground only: no disk delays a flight."""

    def __init__(self, folder: str | None) -> None:
        """``folder``: of the updater; None: this computer has none."""
        self._records = Records(Path(folder)) if folder is not None else None
        self.notice: str | None = None  # an update that has failed, and what runs instead
        self.problem: str | None = None  # an update on trial: this computer may start anew at any moment

    def look(self, stage: Stage) -> None:
        """Read what there is."""
        if self._records is None or stage not in ON_GROUND:
            return
        outcome, trial = self._records.outcome, self._records.trial
        self.notice = f"{SOFTWARE}{outcome.text}" if outcome is not None and outcome.kind != "good" else None
        self.problem = None
        if trial is not None:
            self.problem = f"{SOFTWARE}{trial.release} is on trial in slot {trial.slot}: wait until it is confirmed"
