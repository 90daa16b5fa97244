"""After a boot: confirm a slot on trial once it works, or give it up; confirm a slot in service at once.

A booted Linux is not enough. The agent must report that it is in the mesh, and that autopilot and camera answer, where they did
before the update. Without that report in time the slot is booted again, until the boot loader has counted three attempts and
takes the other slot. There the outcome is recorded.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from msgspec.structs import replace

from radron.agent.update.records import Records
from radron.agent.update.slots import Slots
from radron.protocol.onboard import MAX_BOOT_ATTEMPTS, Needs, Outcome, Release, Report, Trial

DEADLINE_S = 300.0  # from the start of this service until the agent is well
HOLD_S = 5.0  # time for which the agent must stay well
_LOOK_S = 1.0


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Access to the onboard computer while an update is confirmed: the agent's report, reboot, messages, and clocks.

    ``report``: returns the agent's report; ``excuse``: returns the agent's reason while it has no report.
    """

    report: Callable[[], Report | None]
    excuse: Callable[[], str]
    reboot: Callable[[], None]
    say: Callable[[str], None]
    uptime_s: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    now_ns: Callable[[], int] = time.time_ns


def settle(slots: Slots, records: Records, release: Release, around: Surroundings, deadline_s: float = DEADLINE_S) -> None:
    """Decide, after a boot, whether the running release works: confirm it, or return to the other one.

    Raises:
        UpdateError: the boot loader's variables cannot be read or written.
    """
    slot, trial = slots.booted, records.trial
    _keep(around, lambda: records.put_slot(slot, release))
    if trial is not None and trial.slot == slot:
        _try(slots, records, trial, around, deadline_s)
        return
    _look_back(slots, records, slot, trial, release, around)
    slots.mark_good(slot)


def lacking(report: Report | None, needs: Needs, excuse: Callable[[], str] = str) -> list[str]:
    """Return the parts (agent, network, autopilot, camera) that do not answer now, though they did before the update, as lines of
    text.
    """
    if report is None:
        said = excuse()
        return [f"the agent does not report{': ' if said else ''}{said}"]
    missing = [] if report.mesh else ["mesh: not open"]
    if needs.alive and not report.alive:
        missing.append(f"mesh: no other drone is heard; before, {', '.join(needs.alive)} {_was(len(needs.alive))}")
    missing += ["autopilot: does not answer"] if needs.autopilot and not report.autopilot else []
    return missing + (["camera: no readouts"] if needs.camera and not report.camera else [])


def _try(slots: Slots, records: Records, trial: Trial, around: Surroundings, deadline_s: float) -> None:
    attempt = slots.attempts(trial.slot)
    around.say(f"slot {trial.slot}, {trial.release}, is on trial, attempt {attempt} of {MAX_BOOT_ATTEMPTS}")
    begun_s = around.uptime_s()
    well: tuple[float, str] | None = None  # since when, and which run of the agent
    missing: list[str] = []
    while well is None or around.uptime_s() - well[0] < HOLD_S:
        report, before = around.report(), missing
        missing = lacking(report, trial.needs, around.excuse)
        if report is None or missing:
            well = None
        elif well is None or well[1] != report.boot:
            well = around.uptime_s(), report.boot
        if missing and missing != before:
            around.say(f"waiting: {'; '.join(missing)}")
        if missing and around.uptime_s() - begun_s > deadline_s and not (report is not None and report.flies):
            return _give_up(records, trial, missing, around, deadline_s)
        around.sleep(_LOOK_S)
    slots.mark_good(trial.slot)  # first: the boot loader's variables decide after a power cut
    text = f"updated from {trial.before} to {trial.release}, slot {trial.slot}"
    _tell(records, around, Outcome(kind="good", slot=trial.slot, release=trial.release, text=text, **_times(trial, around)))
    _keep(around, records.end)


def _give_up(records: Records, trial: Trial, missing: list[str], around: Surroundings, deadline_s: float) -> None:
    """Boot again; the boot loader counts."""
    _keep(around, lambda: records.begin(replace(trial, lacking=tuple(missing))))
    around.say(f"not well after {deadline_s:.0f} s ({'; '.join(missing)}): starting again")
    around.reboot()


def _look_back(slots: Slots, records: Records, slot: str, trial: Trial | None, release: Release, around: Surroundings) -> None:
    """Record the outcome for the other slot, if that slot should be running instead of this one."""
    other, told = slots.other(slot), records.outcome
    if slots.primary == other:
        tried = trial.release if trial is not None else records.slots.get(other, Release(version="unknown"))
        reason = "; ".join(trial.lacking) if trial is not None and trial.lacking else "it did not start, or lost its power"
        what = "the update to" if trial is not None else "the release in service,"
        text = f"{what} {tried} failed after {MAX_BOOT_ATTEMPTS} attempts ({reason}): slot {slot} runs again, {release}"
        _tell(records, around, Outcome(kind="fell back", slot=other, release=tried, text=text, **_times(trial, around)))
        slots.mark_bad(other)
    elif trial is not None and (told is None or told.begun_ns != trial.begun_ns):
        text = (
            f"the update to {trial.release} was interrupted before slot {other} could be started: slot {slot} runs on; push again"
        )
        _tell(records, around, Outcome(kind="interrupted", slot=other, release=trial.release, text=text, **_times(trial, around)))
    _keep(around, records.end)


def _tell(records: Records, around: Surroundings, outcome: Outcome) -> None:
    _keep(around, lambda: records.tell(outcome))
    around.say(outcome.text)


def _keep(around: Surroundings, write: Callable[[], None]) -> None:
    """Write to the data partition if possible: a full or damaged partition must not decide about a slot."""
    try:
        write()
    except OSError as error:
        around.say(f"{error.filename or 'data partition'}: cannot be written: {error.strerror}")


def _times(trial: Trial | None, around: Surroundings) -> dict[str, int]:
    return {"stamp_ns": around.now_ns()} | ({} if trial is None else {"begun_ns": trial.begun_ns})


def _was(count: int) -> str:
    return "was" if count == 1 else "were"
