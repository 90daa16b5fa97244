"""The onboard computer itself: disk, temperature, memory, and how long it took to boot."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import msgspec

from radron.agent.doctor.report import Check, Verdict

HOT_C, TOO_HOT_C = 80.0, 95.0  # an Intel NUC slows down from about 95 degrees on
BOOT_S = 90.0
LEAST_FREE, LOW_FREE = 0.03, 0.10  # of the disk
LEAST_MEMORY_MB = 300
WORN = 90  # percent of an SSD's rated endurance
_PATIENCE_S = 5.0
_REALLOCATED, _PENDING = 5, 197  # ATA attributes: sectors replaced, and waiting for it


def computer(folder: Path, smart: Path | None, root: Path = Path("/")) -> list[Check]:
    """Check the onboard computer: disk, temperature, memory, and time to boot.

    Args:
        folder: where the drone's data are.
        smart: output of ``smartctl --json`` about the disk; None: there is none.
        root: where /sys and /proc are.
    """
    return [space(folder), disk_health(smart, root), temperature(root), memory(root), boot_time(root)]


def space(folder: Path) -> Check:
    """Check the free space on the disk that holds the drone's data."""
    place = next(each for each in (folder, *folder.parents) if each.exists())
    usage = shutil.disk_usage(place)
    free = usage.free / usage.total
    text = f"{usage.free / 1e9:.1f} GB of {usage.total / 1e9:.1f} GB free at {place}"
    if free < LEAST_FREE:
        return _check("disk space", "failed", f"{text}: remove flight records, after a copy")
    if free < LOW_FREE:
        return _check("disk space", "check", f"{text}: copy flight records and remove them soon")
    return _check("disk space", "ok", text)


def disk_health(smart: Path | None, root: Path = Path("/")) -> Check:
    """Check the disk's health by its own report, and by errors that its file systems have met.

    smart: file with the output of ``smartctl --json``; None: there is none. root: of the file system.
    """
    errors = sum(_number(file) or 0 for file in root.glob("sys/fs/ext4/*/errors_count"))
    if errors:
        return _check("disk health", "failed", f"the file systems have met {errors:.0f} errors (journalctl -k): replace the disk")
    report: dict[str, Any] = {}
    if smart is not None and smart.is_file():
        try:
            report = msgspec.json.decode(smart.read_bytes(), type=dict[str, Any])
        except msgspec.MsgspecError:
            report = {}
    passed = _inner(report, "smart_status", "passed")
    if passed is None:
        return _check("disk health", "ok", "no errors met; the disk tells nothing of itself (smartmontools missing, or no SMART)")
    return _judged_disk(report, passed is True)


def _judged_disk(report: dict[str, Any], passed: bool) -> Check:
    used = _inner(report, "nvme_smart_health_information_log", "percentage_used")
    media = _inner(report, "nvme_smart_health_information_log", "media_errors") or 0
    table = _inner(report, "ata_smart_attributes", "table") or []
    bad = sum(_inner(row, "raw", "value") or 0 for row in table if row.get("id") in (_REALLOCATED, _PENDING)) + media
    text = f"{report.get('model_name', 'disk')}: SMART {'passed' if passed else 'FAILED'}"
    text += "" if used is None else f", {used} % worn"
    text += f", {bad} bad sectors" if bad else ""
    if not passed:
        return _check("disk health", "failed", f"{text}: replace the disk")
    return _check("disk health", "check" if bad or (used or 0) >= WORN else "ok", text)


def temperature(root: Path = Path("/")) -> Check:
    """Check the temperature of the computer's hottest sensor."""
    sensors = [*root.glob("sys/class/thermal/thermal_zone*/temp"), *root.glob("sys/class/hwmon/hwmon*/temp*_input")]
    values = [value / 1000.0 for value in map(_number, sensors) if value is not None and value > 0.0]
    if not values:
        return _check("temperature", "ok", "no sensor")
    hottest = max(values)
    text = f"{hottest:.0f} degrees C at the hottest of {len(values)} sensors"
    if hottest >= TOO_HOT_C:
        return _check("temperature", "failed", f"{text}: it slows down; clean its fan, give it air")
    return _check("temperature", "check", f"{text}: give it air") if hottest >= HOT_C else _check("temperature", "ok", text)


def memory(root: Path = Path("/")) -> Check:
    """Check the memory that is still available to programs."""
    lines = (line.split() for line in (root / "proc/meminfo").read_text().splitlines())
    free_mb = next((int(words[1]) // 1024 for words in lines if words[0] == "MemAvailable:"), 0)
    text = f"{free_mb} MB free"
    return (
        _check("memory", "ok", text) if free_mb >= LEAST_MEMORY_MB else _check("memory", "failed", f"{text}: end other programs")
    )


def boot_time(root: Path = Path("/")) -> Check:
    """Check the time from power-on until the agent could be started, measured by systemd."""
    if (root / "run/systemd/container").exists():
        return _check("time to boot", "ok", "not measured: this is a container")
    firmware = _microseconds(["systemctl", "show", "--property=FirmwareTimestampMonotonic", "--value"])
    ready = _microseconds(["systemctl", "show", "--property=ActiveEnterTimestampMonotonic", "--value", "basic.target"])
    if not ready:
        return _check("time to boot", "ok", "not measured: this computer was not booted by systemd")
    total_s = (ready + (firmware or 0)) * 1e-6
    text = f"{total_s:.0f} s from switching on, {(firmware or 0) * 1e-6:.0f} s of it firmware and boot loader"
    return _check("time to boot", "ok" if total_s <= BOOT_S else "check", text)


def _microseconds(command: list[str]) -> int | None:
    try:
        said = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=False).stdout.strip()
    except (OSError, subprocess.TimeoutExpired):
        return None
    return int(said) if said.isdecimal() else None


def _inner(report: dict[str, Any], outer: str, name: str) -> Any:
    inside = report.get(outer)
    return inside.get(name) if isinstance(inside, dict) else None


def _number(file: Path) -> float | None:
    try:
        return float(file.read_text())
    except (OSError, ValueError):
        return None


def _check(name: str, verdict: Verdict, text: str) -> Check:
    return Check("computer", name, verdict, text)
