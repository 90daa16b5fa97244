"""The agent's report to its own computer, once a second: ``report.json`` in systemd's ``RUNTIME_DIRECTORY``, if it is set.

``radron-update`` judges an update by the report, and ``radron-deploy`` checks in it whether a vehicle is armed. The file is in
memory, not on a disk that could delay the agent. Also here: the messages of the computer's updater for the operator.
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

from radron.agent.update.records import Records
from radron.protocol.codes import Code
from radron.protocol.messages import Stage
from radron.protocol.onboard import REPORT_FILE, Report
from radron.protocol.stages import ON_GROUND
from radron.protocol.texts import CodedText

if TYPE_CHECKING:
    from radron.agent.flight.recorded import RecordedPilot
    from radron.agent.pilot import Pilot
    from radron.agent.vehicle.px4 import Px4Vehicle
    from radron.protocol.mesh.session import Mesh

PERIOD_S = 1.0
CAMERA_S = 10.0  # between two readouts of a camera that works


def runtime_folder(environment: Mapping[str, str] = os.environ) -> Path | None:
    """Return the folder in which the agent reports to its own computer, as named by the service manager (systemd); None without
    one.
    """
    folder = environment.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return Path(folder) if folder else None


class SelfReport:
    """Writes a report on the agent's state for other programs of its computer, once a second."""

    def __init__(self, folder: Path | None, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Set up the reports. ``folder``: for the report file; None: no reports."""
        self._file = folder / REPORT_FILE if folder is not None else None
        self._clock_s = clock_s
        self._readout_s = float("-inf")

    @classmethod
    def here(cls, environment: Mapping[str, str] = os.environ) -> SelfReport:
        """Return a reporter that writes into the folder named by the service manager (systemd)."""
        return cls(runtime_folder(environment))

    def readout(self) -> None:
        """Note that the camera has delivered a readout (pixel hits of one interval)."""
        self._readout_s = self._clock_s()

    async def run(self, present: Callable[[], Report]) -> None:
        """Write reports until cancelled. ``present``: makes the report; time, version and camera are filled in here."""
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
        """Replace the file atomically: readers see the last report or the new report."""
        fresh = file.with_suffix(".new")
        with suppress(OSError):
            fresh.write_bytes(content)
            fresh.replace(file)


def report_of(boot: str, pilot: Pilot | RecordedPilot, mesh: Mesh, vehicle: Px4Vehicle) -> Report:
    """Return the report on one run of the agent, without time, version and camera (``SelfReport``). ``boot``: the run's id."""
    differing = (
        text.about for text in mesh.differing if text.about is not None
    )  # drones of another protocol version are heard, too
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
        problems=tuple(map(str, vehicle.problems)),
    )


class Updates:
    """Messages of this computer's updater for the operator, read on the ground only, so that no disk delays a flight."""

    def __init__(self, folder: str | None) -> None:
        """Set up the messages. ``folder``: of the updater; None: no updater on this computer."""
        self._records = Records(Path(folder)) if folder is not None else None
        self.notice: CodedText | None = None  # a failed update, and the release that runs instead
        self.problem: CodedText | None = None  # an update on trial: this computer may start anew at any moment

    def look(self, stage: Stage) -> None:
        """Read the updater's records for messages to the operator; in flight nothing changes."""
        if self._records is None or stage not in ON_GROUND:
            return
        outcome, trial = self._records.outcome, self._records.trial
        self.notice = self.problem = None
        if outcome is not None and outcome.kind != "good":
            self.notice = CodedText(Code.UPDATE_FAILED, f"software: {outcome.text}")
        if trial is not None:
            text = f"software: {trial.release} is on trial in slot {trial.slot}: wait until it is confirmed"
            self.problem = CodedText(Code.UPDATE_ON_TRIAL, text)
