"""Recording and replay of one drone's agents in a random mission: the replay must give equal results, bit for bit."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import cast

from radron.agent.computing import ALONE, Computing
from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.errors import RadronError
from radron.agent.flight.header import FlightHeader
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.flight.replay import Difference, replay
from radron.agent.localization.ownpose import Whereabouts
from radron.agent.mission.memory import Memory
from radron.agent.navigation.reckoning import Reckoning
from radron.agent.pilot import Pilot
from radron.protocol.signing import Trust
from radron.protocol.texts import CodedText

_LIMIT_MB = 1000  # far beyond a random mission


class _Through:
    """A sink that hides the recorder, so that its waiting records do not count as memory of the pilot."""

    def __init__(self, recorder: FlightRecorder) -> None:
        self.write = recorder.write


class _Recorded(RecordedPilot):
    """A recorded pilot in the place of a pilot in lockstep."""

    def __init__(self, pilot: Pilot, recorder: FlightRecorder) -> None:
        super().__init__(pilot, _Through(recorder))
        self.fusion, self.listeners = pilot.fusion, pilot.listeners

    @property
    def whereabouts(self) -> Whereabouts | None:
        """Forward to ``Pilot``."""
        return self._pilot.whereabouts

    @property
    def reckoning(self) -> Reckoning | None:
        """Forward to ``Pilot``."""
        return self._pilot.reckoning

    @property
    def backlog_s(self) -> float:
        """Forward to ``Pilot``."""
        return self._pilot.backlog_s

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Forward to ``Pilot``."""
        return self._pilot.problems


class Recording:
    """Makes the pilots (decision part of the agents) of a flight, and records the pilots of one drone.

    It is passed to ``radron.sim.lockstep.flight.watched(make=...)``.
    """

    def __init__(self, drone: str, folder: Path) -> None:
        """``drone``: id of the recorded drone. ``folder``: for the records; one subfolder for each start of the agent."""
        self._drone, self._folder = drone, folder
        self._recorders: dict[Path, FlightRecorder] = {}

    def make(
        self,
        mission: MissionConfig,
        drone: DroneConfig,
        boot: str,
        listeners: Sequence[str] = (),
        memory: Memory | None = None,
        trust: Trust | None = None,
        *,
        nonce_key: bytes,
        computing: Computing = ALONE,
    ) -> Pilot:
        """Make a pilot, with the arguments of ``Pilot``.

        The recorded pilot shares computations with the other drones; the replay computes on its own.
        """
        pilot = Pilot(mission, drone, boot, listeners, memory, trust, nonce_key=nonce_key, computing=computing)
        if drone.id != self._drone:
            return pilot
        folder = self._folder / boot
        if folder in self._recorders:  # of a late agent: its placeholder pilot was never flown
            self._recorders.pop(folder).close()
            shutil.rmtree(folder)
        recorder = FlightRecorder(folder, _LIMIT_MB, FlightHeader.of(mission, drone, boot, 0, memory, trust, nonce_key=nonce_key))
        self._recorders[folder] = recorder
        return cast(Pilot, _Recorded(pilot, recorder))

    def differences(self) -> list[str]:
        """Replay all records; return the differences from the flight, one per line."""
        found = []
        for folder, recorder in self._recorders.items():
            recorder.close()
            try:
                report = replay(folder)
            except RadronError as error:
                found.append(f"cannot be replayed: {error}")
                continue
            if not report.identical:
                found.append(_told(report.first, report.flaw))
        return found


def _told(first: Difference | None, flaw: str | None) -> str:
    if first is None:
        return f"the record is flawed: {flaw}"
    return f"{first.topic} after {first.time_s:.2f} s of wall time: {first.recorded[:60]} flown, {first.replayed[:60]} replayed"
