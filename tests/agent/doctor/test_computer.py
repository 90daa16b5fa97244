"""The checks of the onboard computer, on files as the kernel and smartctl write them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from radron.agent.doctor.computer import disk_health, memory, space, temperature


def write(root: Path, name: str, text: str) -> None:
    (root / name).parent.mkdir(parents=True, exist_ok=True)
    (root / name).write_text(text)


@pytest.mark.parametrize(("milli", "verdict"), [("45000", "ok"), ("83000", "check"), ("97000", "failed")])
def test_the_hottest_sensor_counts(tmp_path: Path, milli: str, verdict: str) -> None:
    write(tmp_path, "sys/class/thermal/thermal_zone0/temp", "31000\n")
    write(tmp_path, "sys/class/hwmon/hwmon2/temp1_input", f"{milli}\n")
    found = temperature(tmp_path)
    assert (found.verdict, found.text.startswith(f"{int(milli) // 1000} degrees C at the hottest of 2 sensors")) == (
        verdict,
        True,
    )


def test_a_computer_without_sensors_is_told(tmp_path: Path) -> None:
    assert temperature(tmp_path).text == "no sensor"


def test_errors_that_a_file_system_has_met_condemn_the_disk(tmp_path: Path) -> None:
    write(tmp_path, "sys/fs/ext4/nvme0n1p5/errors_count", "0\n")
    assert disk_health(None, tmp_path).verdict == "ok"
    write(tmp_path, "sys/fs/ext4/nvme0n1p5/errors_count", "3\n")
    assert disk_health(None, tmp_path).verdict == "failed"


NVME = {"model_name": "X", "smart_status": {"passed": True}}
USED = "nvme_smart_health_information_log"


@pytest.mark.parametrize(
    ("report", "verdict", "text"),
    [
        (NVME | {USED: {"percentage_used": 4, "media_errors": 0}}, "ok", "X: SMART passed, 4 % worn"),
        (NVME | {USED: {"percentage_used": 95, "media_errors": 0}}, "check", "X: SMART passed, 95 % worn"),
        (NVME | {USED: {"percentage_used": 4, "media_errors": 2}}, "check", "X: SMART passed, 4 % worn, 2 bad sectors"),
        (
            NVME | {"ata_smart_attributes": {"table": [{"id": 5, "raw": {"value": 8}}, {"id": 9, "raw": {"value": 700}}]}},
            "check",
            "X: SMART passed, 8 bad sectors",
        ),
        (NVME | {"smart_status": {"passed": False}}, "failed", "X: SMART FAILED: replace the disk"),
    ],
)
def test_what_the_disk_says_of_itself(tmp_path: Path, report: object, verdict: str, text: str) -> None:
    write(tmp_path, "smart.json", json.dumps(report))
    found = disk_health(tmp_path / "smart.json", tmp_path)
    assert (found.verdict, found.text) == (verdict, text)


@pytest.mark.parametrize("text", ["", "[1]", "{}", '{"smart_status": 3}'])
def test_a_report_of_the_disk_that_says_nothing_is_no_verdict(tmp_path: Path, text: str) -> None:
    write(tmp_path, "smart.json", text)
    assert "the disk tells nothing of itself" in disk_health(tmp_path / "smart.json", tmp_path).text


@pytest.mark.parametrize(("kilobytes", "verdict"), [(2_000_000, "ok"), (200_000, "failed")])
def test_memory(tmp_path: Path, kilobytes: int, verdict: str) -> None:
    write(tmp_path, "proc/meminfo", f"MemTotal: 8000000 kB\nMemAvailable: {kilobytes} kB\n")
    assert memory(tmp_path).verdict == verdict


def test_space_is_that_of_the_nearest_folder_that_exists(tmp_path: Path) -> None:
    assert space(tmp_path / "not/there").text.endswith(f"free at {tmp_path}" if space(tmp_path).verdict == "ok" else "soon")
