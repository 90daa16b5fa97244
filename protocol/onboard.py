"""Reports of an onboard computer, as JSON: from the agent to the computer's updater, and from there to ``radron-deploy``."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Literal

from msgspec import Struct

from radron.protocol.messages import Stage
from radron.protocol.stages import ON_GROUND

COMPATIBLE = "radron-nuc"  # type of computer that accepts a bundle
REPORT_FILE = "report.json"  # in the agent's RUNTIME_DIRECTORY
MAX_BOOT_ATTEMPTS = 3  # boots of a slot before the boot loader takes the other slot (grub.cfg counts to the same number)


class Release(Struct, frozen=True, kw_only=True):
    """A release of the software of the onboard computer.

    ``version``: semantic version. ``build``: date and commit of the source, such as ``20261123T021500Z-1a2b3c4d5e6f``.
    """

    version: str
    build: str = ""

    def __str__(self) -> str:
        """Return version and commit, for display."""
        commit = self.build.partition("-")[2]
        return f"{self.version} ({commit})" if commit else self.version

    def is_older_than(self, other: Release) -> bool:
        """Return whether this release is older than the ``other`` one, by version (semantic versioning).

        If the versions are equal, the date of the source decides.
        """
        return self._order < other._order

    @property
    def made_ns(self) -> int | None:
        """Date of the release's source, in nanoseconds UTC; None: not known."""
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
    """What the agent (the flight software) reports once a second to the computer on which it runs.

    The computer's updater reads from it whether the drone is in flight, and whether a new release works. ``uptime_s``: time of
    the report by the computer's monotonic clock. ``mesh``: whether the network session with the other drones is open. ``alive``:
    drones present in this network. ``autopilot`` and ``camera``: whether these devices answer. ``px4`` and ``parameters``:
    version and parameters of the autopilot.
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
        """Whether the vehicle is armed or in flight."""
        return self.armed or self.stage not in ON_GROUND


class Needs(Struct, frozen=True, kw_only=True):
    """Devices and drones that answered before an update of the software and must answer after it; else the update is undone.

    ``alive``: at least one of these drones must be present in the network again.
    """

    alive: tuple[str, ...] = ()
    autopilot: bool = False
    camera: bool = False

    @classmethod
    def of(cls, report: Report | None) -> Needs:
        """Return the devices and drones that answer according to a report of the agent; none if there is no report."""
        return cls() if report is None else cls(alive=report.alive, autopilot=report.autopilot, camera=report.camera)


class Trial(Struct, frozen=True, kw_only=True):
    """A newly installed release that must still prove itself: it must boot, and all devices and drones must answer.

    ``slot``: the disk partition that holds the release; the former release stays in another slot. ``before``: the former release.
    ``needs``: devices and drones that must answer. ``lacking``: the needs that were not met at the last attempt. ``begun_ns``:
    start of the trial, nanoseconds UTC.
    """

    slot: str
    release: Release
    before: Release
    needs: Needs
    begun_ns: int
    lacking: tuple[str, ...] = ()


class Outcome(Struct, frozen=True, kw_only=True):
    """How the last update of an onboard computer ended: installed, undone or interrupted.

    ``slot``: the disk partition of the new release. ``release``: the release that was to be installed. ``text``: result for
    display. ``begun_ns``: start of the trial of the new release, nanoseconds UTC.
    """

    kind: Literal["good", "fell back", "interrupted"]
    slot: str
    release: Release
    text: str
    stamp_ns: int
    begun_ns: int | None = None


class Computer(Struct, frozen=True, kw_only=True):
    """State of one onboard computer as ``radron-update status`` reports it: release, disk, clock and the last update.

    Attributes:
        name: name of the computer.
        release: the running release.
        slot: the disk partition with the running release; empty: no such partitions, as the agent was installed on another
            system.
        slots: releases in the partitions, as far as known.
        attempts: boots of the present partition since its release was last confirmed to work.
        trial: a new release that must still prove itself.
        busy: an update is being installed.
        outcome: how the last update ended.
        report: the agent's last report.
        agent: state of the agent's service.
        clock_ns: the computer's time, nanoseconds UTC.
        clock_offset_s: offset from the time servers; None: no time server reached.
        certificate_ns: end of the validity of the drone's certificate, nanoseconds UTC.
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
