"""Check that this computer runs the release of its last update."""

from __future__ import annotations

from pathlib import Path

from radron.agent.update.records import Records
from radron.agent.vehicle.interface import Finding

NAME = "software"


def software_finding(folder: str | None) -> Finding | None:
    """Check that this computer runs the release of its last update; None on a computer without updater. ``folder``: the
    updater's.

    A drone on its previous release can fly, as long as all drones speak one version of the protocol: no start is refused for it.
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
