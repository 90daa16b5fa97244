"""Reports of an onboard computer, as JSON: from the agent to the computer's updater, and from there to ``radron-deploy``."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Literal

from msgspec import Struct

from protocol.messages import Stage
from protocol.stages import ON_GROUND

COMPATIBLE = "radron-nuc"  # type of computer that accepts a bundle
REPORT_FILE = "report.json"  # in the agent's RUNTIME_DIRECTORY
MOST_ATTEMPTS = 3  # boots of a slot before the boot loader takes the other slot (grub.cfg counts to the same number)


class Release(Struct, frozen=True, kw_only=True):
    """A release of the onboard system. ``build``: date and commit of its source, ``20261123T021500Z-1a2b3c4d5e6f``."""

    version: str
    build: str = ""

    def __str__(self) -> str:
        """Return version and commit, for display."""
        commit = self.build.partition("-")[2]
        return f"{self.version} ({commit})" if commit else self.version

    def is_older_than(self, other: Release) -> bool:
        """Compare by version (semantic versioning); by the date of the source if the versions are equal."""
        return self._order < other._order

    @property
    def made_ns(self) -> int | None:
        """The date of its source, UTC in nanoseconds; None: unknown."""
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
    """The agent's report to its computer, once a second. ``uptime_s``: time of the report by the computer's monotonic clock.

    ``mesh``: its session is open; ``alive``: drones present in the mesh; ``autopilot``, ``camera``: true if they answer.
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
        """Whether its vehicle is armed or in flight."""
        return self.armed or self.stage not in ON_GROUND


class Needs(Struct, frozen=True, kw_only=True):
    """Devices and drones that answered before an update and must answer after it. ``alive``: at least one of these drones."""

    alive: tuple[str, ...] = ()
    autopilot: bool = False
    camera: bool = False

    @classmethod
    def of(cls, report: Report | None) -> Needs:
        """Return the answering devices and drones of an agent's present report; none without a report."""
        return cls() if report is None else cls(alive=report.alive, autopilot=report.autopilot, camera=report.camera)


class Trial(Struct, frozen=True, kw_only=True):
    """A slot on trial: it must boot and show that it works. ``lacking``: unmet needs at its last attempt."""

    slot: str
    release: Release
    before: Release
    needs: Needs
    begun_ns: int
    lacking: tuple[str, ...] = ()


class Outcome(Struct, frozen=True, kw_only=True):
    """Outcome of the last update. ``release``: the release to install; ``text``: for display; ``begun_ns``: of the trial."""

    kind: Literal["good", "fell back", "interrupted"]
    slot: str
    release: Release
    text: str
    stamp_ns: int
    begun_ns: int | None = None


class Computer(Struct, frozen=True, kw_only=True):
    """Status of one onboard computer, from ``radron-update status``.

    ``slot``: the running slot; empty: no slots, as the agent was installed on another system. ``slots``: releases in the slots,
    as far as known; ``attempts``: boots of the present slot since its last confirmation; ``busy``: an update is being installed;
    ``clock_ns``: UTC; ``clock_offset_s``: from its time servers, None: no time server reached; ``certificate_ns``: end of the
    drone's certificate.
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
