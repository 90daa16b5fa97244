"""Problems of the process around the pilot: reported to the pilot at each change, logged at their begin and at their end."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.pilot import Pilot
from radron.agent.shell.logs import Logger
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

LATE_STEP_S = 0.2  # a step this late is reported; the autopilot's timeout is 1 s
LATE_S = 5.0  # a late step is reported for this long


class Problems:
    """Reports the problems of autopilot link, camera, network and computer to the pilot program, and logs their begin and end."""

    def __init__(self, pilot: Pilot | RecordedPilot, log: Logger) -> None:
        self._warnings = _Changes("warning", pilot.warn, log)
        self._faults = _Changes("problem", pilot.block, log)
        self._notices = _Changes("notice", pilot.notice, log)

    def tell(
        self, warnings: Iterable[CodedText | None], faults: Iterable[CodedText | None], notices: Iterable[CodedText | None]
    ) -> None:
        """Report all present problems; None is left out.

        ``warnings``: for the operator; ``faults``: prevent a start; ``notices``: are no problems of this flight.
        """
        for changes, found in ((self._warnings, warnings), (self._faults, faults), (self._notices, notices)):
            changes.tell(tuple(text for text in found if text is not None))


class _Changes:
    """Reports the problems of one kind at each change, and logs each problem once at its begin and once at its end."""

    def __init__(self, kind: str, to: Callable[[tuple[CodedText, ...]], None], log: Logger) -> None:
        self._kind, self._to, self._log = kind, to, log
        self._told: tuple[CodedText, ...] = ()

    def tell(self, problems: tuple[CodedText, ...]) -> None:
        """Report all present problems of this kind if they differ from the last call's."""
        before, self._told = self._told, problems
        if problems == before:
            return
        self._to(problems)
        for text in problems:
            if text not in before:
                self._log.warning(self._kind, text=text, code=text.code)
        for text in before:
            if text not in problems:
                self._log.info(f"{self._kind} is over", text=text, code=text.code)


class LateSteps:
    """Detects a computer that is too slow, by late steps of the flight loop in the last seconds."""

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._last_s = float("-inf")

    def note(self, behind_s: float) -> None:
        """Note how late (s) the next step of the flight loop is."""
        if behind_s > LATE_STEP_S:
            self._last_s = self._clock_s()

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """A line for the operator if steps of the flight loop were late recently; empty otherwise."""
        if self._clock_s() - self._last_s >= LATE_S:
            return ()
        text = f"the computer is too slow: setpoints were over {LATE_STEP_S:g} s late in the last {LATE_S:g} s"
        return (CodedText(Code.COMPUTER_SLOW, text),)


def no_contact(drone: DroneConfig, mission: MissionConfig, alive: Collection[str]) -> list[CodedText]:
    """Return a line for each other drone of the mission without a network contact, with the address that this drone connects to.

    alive: names of the drones in contact.
    """
    endpoints = drone.mesh.endpoints
    missing = (member.id for member in mission.drones if member.id != drone.id and member.id not in alive)
    text = "no contact with {} ({})"
    return [CodedText(Code.NO_CONTACT, text.format(name, endpoints.get(name, "no endpoint given")), name) for name in missing]
