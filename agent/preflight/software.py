"""Whether this computer runs the release that it was last given."""

from __future__ import annotations

from pathlib import Path

from agent.update.records import Records
from agent.vehicle.interface import Finding

NAME = "software"


def software_finding(folder: str | None) -> Finding | None:
    """The finding; None where this computer has no updater. ``folder``: the updater's.

    A drone that has fallen back can fly, as long as all drones speak the same protocol: a start is not refused for it.
    """
    if folder is None:
        return None
    records = Records(Path(folder))
    trial, outcome = records.trial, records.outcome
    if trial is not None:
        return Finding(NAME, "not yet", f"{trial.release} is on trial in slot {trial.slot}")
    if outcome is None:
        return Finding(NAME, "ok", "as flashed: no update so far")
    return Finding(NAME, "ok" if outcome.kind == "good" else "failed", outcome.text)
