"""What an onboard computer tells of itself, as JSON: the agent to its computer's updater, and that to ``radron-deploy``."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Literal

from msgspec import Struct

from protocol.messages import Stage
from protocol.stages import ON_GROUND

COMPATIBLE = "radron-nuc"  # which computers a bundle is for
REPORT_FILE = "report.json"  # in the agent's RUNTIME_DIRECTORY
MOST_ATTEMPTS = 3  # boots of a slot before the boot loader takes the other one (grub.cfg counts to the same number)


class Release(Struct, frozen=True, kw_only=True):
    """A release of the onboard system. ``build``: date and commit of its source, ``20261123T021500Z-1a2b3c4d5e6f``."""

    version: str
    build: str = ""

    def __str__(self) -> str:
        """For people: version and commit."""
        commit = self.build.partition("-")[2]
        return f"{self.version} ({commit})" if commit else self.version

    def is_older_than(self, other: Release) -> bool:
        """By version, as semantic versioning has it; by the date of the source where the versions are equal."""
        return self._order < other._order

    @property
    def made_ns(self) -> int | None:
        """The date of its source, UTC in nanoseconds; None: it is not known."""
        try:
            made = datetime.strptime(self.build.partition("-")[0], "%Y%m%dT%H%M%SZ")
        except ValueError:
            return None
        return int(made.replace(tzinfo=UTC).timestamp()) * 1_000_000_000

    @property
    def _order(self) -> tuple[list[int], bool, str, str]:
        numbers, rest = re.findall(r"\d+", self.version)[:3], re.sub(r"^[\d.]*", "", self.version).partition("+")[0]
        return [int(number) for number in numbers], not rest, rest, self.build.partition("-")[0]


class Report(Struct, frozen=True, kw_only=True):
    """What the agent tells its computer once a second. ``uptime_s``: when, by the computer's monotonic clock.

    ``mesh``: its session is open; ``alive``: the drones that it hears; ``autopilot``, ``camera``: they answer.
    """

    uptime_s: float
    boot: str
    version: str
    stage: Stage
    armed: bool = False
    mesh: bool = True
    alive: tuple[str, ...] = ()
    autopilot: bool = False
    camera: bool = False
    px4: str | None = None
    parameters: dict[str, float] = {}
    problems: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()

    @property
    def flies(self) -> bool:
        """Whether its vehicle is armed, or a flight is under way."""
        return self.armed or self.stage not in ON_GROUND


class Needs(Struct, frozen=True, kw_only=True):
    """What answered before an update, and must answer after it. ``alive``: at least one of these drones."""

    alive: tuple[str, ...] = ()
    autopilot: bool = False
    camera: bool = False

    @classmethod
    def of(cls, report: Report | None) -> Needs:
        """What an agent has at present; nothing of one that does not report."""
        return cls() if report is None else cls(alive=report.alive, autopilot=report.autopilot, camera=report.camera)


class Trial(Struct, frozen=True, kw_only=True):
    """A slot that is to be booted, and to show that it works. ``lacking``: what it lacked at its last attempt."""

    slot: str
    release: Release
    before: Release
    needs: Needs
    begun_ns: int
    lacking: tuple[str, ...] = ()


class Outcome(Struct, frozen=True, kw_only=True):
    """How the last update went. ``release``: the one to be installed; ``text``: for people; ``begun_ns``: of the trial."""

    kind: Literal["good", "fell back", "interrupted"]
    slot: str
    release: Release
    text: str
    stamp_ns: int
    begun_ns: int | None = None


class Computer(Struct, frozen=True, kw_only=True):
    """One onboard computer, as ``radron-update status`` tells it.

    ``slot``: it runs from; empty: it has none, as the agent was installed on another system. ``slots``: releases in them, as far
    as known; ``attempts``: boots of the present slot since it was last confirmed; ``busy``: an update is being installed;
    ``clock_ns``: UTC; ``clock_offset_s``: from its time servers, None: none is reached;
    ``certificate_ns``: end of the drone's certificate.
    """

    name: str
    release: Release
    slot: str
    slots: dict[str, Release]
    attempts: int
    trial: Trial | None
    busy: bool = False
    outcome: Outcome | None
    report: Report | None
    agent: str
    disk_free_mb: int
    disk_mb: int
    clock_ns: int
    clock_offset_s: float | None
    certificate_ns: int | None
