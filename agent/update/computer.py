"""Status for ``radron-update status``: releases, the last update, disk, clock, certificate, and the agent's report."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from radron.agent.update.records import REPORT, Records, own_release, read_report
from radron.agent.update.slots import Slots
from radron.protocol.onboard import Computer, Release

CERTIFICATE = Path("/run/credstore/certificate.pem")
_UNIT = "radron-agent"


def look(slots: Slots, records: Records) -> Computer:
    """Return the present state of this onboard computer for ``radron-update status``, also of one without system partitions
    (slots).

    Raises:
        UpdateError: the boot loader's variables cannot be read.
    """
    disk, slot = shutil.disk_usage(records.folder if records.folder.exists() else "/"), slots.found
    return Computer(
        name=os.uname().nodename,
        release=own_release() if slot is not None else Release(version=version("radron")),
        slot=slot or "",
        slots=records.slots,
        attempts=slots.attempts(slot) if slot is not None else 0,
        trial=records.trial,
        busy=slot is not None and records.busy,
        outcome=records.outcome,
        report=read_report(REPORT, time.monotonic()),
        agent=agent_state(),
        disk_free_mb=disk.free // 1_000_000,
        disk_mb=disk.total // 1_000_000,
        clock_ns=time.time_ns(),
        clock_offset_s=clock_offset_s(),
        certificate_ns=certificate_end_ns(CERTIFICATE),
    )


def agent_state() -> str:
    """Return the state of the agent's service in systemd, with its status text."""
    shown = dict(
        line.partition("=")[::2] for line in _said("systemctl", "show", _UNIT, "--property=ActiveState,StatusText").splitlines()
    )
    return ", ".join(text for text in (shown.get("ActiveState", "unknown"), shown.get("StatusText", "")) if text)


def clock_offset_s() -> float | None:
    """Return the difference (s) of this clock from its time servers, by chrony; None: no time servers, or not
    synchronised yet.
    """
    fields = _said("chronyc", "-c", "tracking").strip().split(",")
    if len(fields) < 14 or fields[-1] == "Not synchronised":
        return None
    with suppress(ValueError):
        return float(fields[4])
    return None


def certificate_end_ns(file: Path) -> int | None:
    """Return the time (UTC, ns) until which a certificate is valid; None if the file has no readable certificate."""
    from cryptography import x509  # noqa: PLC0415  at each boot the updater does without: half of its time to start

    try:
        end = x509.load_pem_x509_certificate(file.read_bytes()).not_valid_after_utc
    except (OSError, ValueError):
        return None
    return int(end.timestamp()) * 1_000_000_000


def _said(*command: str) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=10.0).stdout
    except (OSError, subprocess.TimeoutExpired):
        return ""
