"""The fate of a slot after a boot: confirmed by the agent's report, or given up after three attempts; with power cuts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from radron.agent.update.records import Records, read_report
from radron.agent.update.settle import Surroundings, lacking, settle
from radron.protocol.messages import Stage
from radron.protocol.onboard import Needs, Report, Trial
from support.computers.onboard import NEW, OLD, OnboardFiles, well

DEADLINE_S = 300.0
NEEDS = Needs(alive=("d2", "d3"), autopilot=True, camera=True)


class PowerCutError(Exception):
    """The plug was pulled."""


class Booted:
    """A boot of a computer, by a clock of its own. ``report``: of the agent, by the seconds since the boot."""

    def __init__(self, report: Callable[[float], Report | None]) -> None:
        self.now_s = 0.0
        self.reboots = 0
        self.said: list[str] = []
        self._report = report

    @property
    def around(self) -> Surroundings:
        return Surroundings(
            report=lambda: self._report(self.now_s),
            excuse=lambda: "activating, waiting: no autopilot",
            reboot=self._reboot,
            say=self.said.append,
            uptime_s=lambda: self.now_s,
            sleep=self._sleep,
            now_ns=lambda: 7,
        )

    def _reboot(self) -> None:
        self.reboots += 1

    def _sleep(self, duration_s: float) -> None:
        self.now_s += duration_s
        assert self.now_s < 3600.0


def always(report: Report | None) -> Callable[[float], Report | None]:
    return lambda _: report


@pytest.fixture
def updated(tmp_path: Path) -> OnboardFiles:
    """A computer with an old release in service, and a new release first in the boot order."""
    computer = OnboardFiles(tmp_path)
    computer.boot()
    settle(computer.slots, computer.records, OLD, Booted(always(None)).around)
    computer.records.begin(Trial(slot="B", release=NEW, before=OLD, needs=NEEDS, begun_ns=1))
    computer.content["B"] = NEW
    computer.slots.put_first("B")
    return computer


def run(computer: OnboardFiles, report: Callable[[float], Report | None]) -> Booted:
    """Switch on, and let the updater decide."""
    computer.boot()
    booted = Booted(report)
    settle(computer.slots, computer.records, computer.release, booted.around, DEADLINE_S)
    return booted


def test_a_slot_in_service_is_confirmed_at_once_whatever_the_agent_does(tmp_path: Path) -> None:
    computer = OnboardFiles(tmp_path)
    for _ in range(5):
        assert run(computer, always(None)).now_s == 0.0
        assert (computer.slots.booted, computer.slots.attempts("A")) == ("A", 0)
    assert computer.records.outcome is None


def test_a_new_slot_is_confirmed_once_the_agent_has_been_well_for_a_while(updated: OnboardFiles) -> None:
    booted = run(updated, lambda now_s: well(now_s) if now_s > 40.0 else None)
    assert 45.0 <= booted.now_s <= 48.0
    assert (updated.slots.booted, updated.slots.primary, updated.slots.attempts("B")) == ("B", "B", 0)
    outcome = updated.records.outcome
    assert outcome is not None
    assert (outcome.kind, outcome.release) == ("good", NEW)
    assert outcome.text == "updated from 0.1.0 (aaaaaaaaaaaa) to 0.2.0 (bbbbbbbbbbbb), slot B"
    assert updated.records.trial is None
    assert [updated.boot() for _ in range(3)] == ["B"] * 3


def test_a_release_whose_agent_never_gets_well_falls_back_unaided_and_tells_why(updated: OnboardFiles) -> None:
    blind = msgspec.structs.replace(well(), autopilot=False)
    for attempt in (1, 2, 3):
        booted = run(updated, always(blind))
        assert booted.said[0].endswith(f"is on trial, attempt {attempt} of 3")
        assert booted.reboots == 1
        assert DEADLINE_S < booted.now_s < DEADLINE_S + 5.0
    booted = run(updated, always(well()))
    assert (updated.slots.booted, updated.slots.primary, updated.slots.is_good("B")) == ("A", "A", False)
    outcome = updated.records.outcome
    assert outcome is not None
    assert outcome.kind == "fell back"
    assert outcome.text == (
        "the update to 0.2.0 (bbbbbbbbbbbb) failed after 3 attempts (autopilot: does not answer): slot A runs again, "
        "0.1.0 (aaaaaaaaaaaa)"
    )
    assert booted.said == [outcome.text]
    assert [updated.boot() for _ in range(5)] == ["A"] * 5


@pytest.mark.parametrize("cuts", [1, 2])
@pytest.mark.parametrize("early", [True, False])
def test_power_cuts_before_the_agent_is_well_do_not_end_in_the_old_slot(updated: OnboardFiles, cuts: int, early: bool) -> None:
    for _ in range(cuts):
        updated.boot()
        if not early:  # the updater was at work already
            with pytest.raises(PowerCutError):
                settle(updated.slots, updated.records, NEW, replace(Booted(always(None)).around, sleep=pull_the_plug))
    run(updated, always(well()))
    assert (updated.slots.booted, updated.slots.attempts("B")) == ("B", 0)
    assert updated.records.outcome is not None
    assert updated.records.outcome.kind == "good"


def test_three_power_cuts_end_in_the_old_slot_but_not_silently(updated: OnboardFiles) -> None:
    assert [updated.boot() for _ in range(3)] == ["B"] * 3
    booted = run(updated, always(well()))
    assert updated.slots.booted == "A"
    assert booted.said[0].endswith("(it did not start, or lost its power): slot A runs again, 0.1.0 (aaaaaaaaaaaa)")


@pytest.mark.parametrize("writes", range(6))
@pytest.mark.parametrize("kind", ["good", "fell back"])
def test_a_power_cut_between_any_two_writes_changes_nothing_of_what_is_decided(
    updated: OnboardFiles, monkeypatch: pytest.MonkeyPatch, kind: str, writes: int
) -> None:
    report = always(well() if kind == "good" else None)
    while updated.boot() == "B" and kind == "fell back":
        settle(updated.slots, updated.records, NEW, Booted(report).around, DEADLINE_S)
    cut_after(monkeypatch, updated, writes)
    try:
        settle(updated.slots, updated.records, updated.release, Booted(report).around, DEADLINE_S)
    except PowerCutError:
        monkeypatch.undo()
        run(updated, report)
    assert updated.records.outcome is not None
    assert updated.records.outcome.kind == kind
    assert updated.slots.booted == updated.slots.primary == ("B" if kind == "good" else "A")
    assert updated.records.trial is None


def test_a_bundle_that_was_not_written_to_its_end_is_told_as_interrupted(updated: OnboardFiles) -> None:
    updated.slots.mark_bad("B")  # as RAUC before it writes
    run(updated, always(well()))
    outcome = updated.records.outcome
    assert outcome is not None
    assert outcome.kind == "interrupted"
    assert outcome.text.startswith(
        "the update to 0.2.0 (bbbbbbbbbbbb) was interrupted before slot B could be started: slot A runs on"
    )


def test_a_slot_in_service_that_fails_later_is_told_too(updated: OnboardFiles) -> None:
    run(updated, always(well()))
    assert [updated.boot() for _ in range(3)] == ["B"] * 3
    run(updated, always(well()))
    outcome = updated.records.outcome
    assert outcome is not None
    assert outcome.text.startswith("the release in service, 0.2.0 (bbbbbbbbbbbb) failed after 3 attempts")
    assert (updated.slots.booted, updated.slots.primary) == ("A", "A")


def test_a_computer_whose_vehicle_is_armed_does_not_start_anew(updated: OnboardFiles) -> None:
    armed = msgspec.structs.replace(well(), camera=False, armed=True)
    booted = run(updated, lambda now_s: armed if now_s < 1000.0 else msgspec.structs.replace(armed, armed=False))
    assert booted.reboots == 1
    assert booted.now_s >= 1000.0


def test_an_agent_that_starts_again_and_again_is_not_well(updated: OnboardFiles) -> None:
    run(updated, lambda now_s: well(boot=str(int(now_s // 3.0))) if now_s < 200.0 else None)
    assert updated.slots.attempts("B") == 1


def test_a_full_data_partition_does_not_decide_about_a_slot(updated: OnboardFiles, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Records, name: str, content: object) -> None:
        raise OSError(28, "No space left on device", name)

    monkeypatch.setattr(Records, "_write", full)
    booted = run(updated, always(well()))
    assert (updated.slots.primary, updated.slots.attempts("B")) == ("B", 0)
    assert updated.records.trial is None
    assert "outcome.json: cannot be written: No space left on device" in booted.said


@pytest.mark.parametrize("kind", ["good", "fell back"])
def test_a_data_partition_that_became_read_only_does_not_decide_about_a_slot(
    updated: OnboardFiles, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    def read_only(self: Records, *_: object) -> None:
        raise OSError(30, "Read-only file system", str(self.folder))

    if kind == "fell back":
        assert [updated.boot() for _ in range(3)] == ["B"] * 3
    monkeypatch.setattr(Records, "_write", read_only)
    monkeypatch.setattr(Records, "end", read_only)
    for _ in range(5):  # unchanged
        booted = run(updated, always(well()))
        slot = "B" if kind == "good" else "A"
        assert (updated.slots.booted, updated.slots.primary, updated.slots.attempts(slot)) == (slot, slot, 0)
        assert booted.reboots == 0
        assert any(said.endswith("cannot be written: Read-only file system") for said in booted.said)


def test_only_what_answered_before_must_answer() -> None:
    bare = Report(uptime_s=0.0, boot="1", version="0.2.0", stage=Stage.PREFLIGHT)
    assert lacking(bare, Needs()) == []
    assert lacking(bare, NEEDS) == [
        "mesh: no other drone is heard; before, d2, d3 were",
        "autopilot: does not answer",
        "camera: no readouts",
    ]
    assert lacking(msgspec.structs.replace(well(), alive=("d3",)), NEEDS) == []
    assert lacking(None, Needs(), lambda: "failed") == ["the agent does not report: failed"]
    assert Needs.of(well()) == NEEDS


def test_a_report_that_is_not_renewed_counts_as_none(tmp_path: Path) -> None:
    file = tmp_path / "report.json"
    file.write_bytes(msgspec.json.encode(well(uptime_s=100.0)))
    assert read_report(file, 103.0) is not None
    assert read_report(file, 106.0) is None  # a frozen agent
    assert read_report(file, 3.0) is None  # from before a restart of the computer
    file.write_bytes(b"{")
    assert read_report(file, 100.0) is None


def pull_the_plug(_: float) -> None:
    raise PowerCutError


def cut_after(monkeypatch: pytest.MonkeyPatch, computer: OnboardFiles, writes: int) -> None:
    """Cut the power after so many changes of the boot loader's variables and of the data partition."""
    left = [writes]

    def counted(name: str) -> None:
        for owner in (computer.slots, computer.records):
            work = getattr(owner, name, None)
            if work is not None:
                monkeypatch.setattr(owner, name, limited(work, left))

    for name in ("_change", "_write", "end"):
        counted(name)


def limited(work: Callable[..., None], left: list[int]) -> Callable[..., None]:
    def limited_work(*arguments: object, **named: object) -> None:
        if left[0] == 0:
            raise PowerCutError
        left[0] -= 1
        work(*arguments, **named)

    return limited_work
