"""The boot loader's variables: changed in place, as RAUC asks, and as GRUB reads them."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from radron.agent.update.errors import UpdateError
from support.computers.onboard import OnboardFiles


@pytest.fixture
def computer(tmp_path: Path) -> OnboardFiles:
    made = OnboardFiles(tmp_path)
    assert made.boot() == "A"
    return made


def test_an_installed_slot_comes_first_with_all_its_attempts(computer: OnboardFiles) -> None:
    slots = computer.slots
    assert (slots.booted, slots.answer("get-primary"), slots.attempts("A")) == ("A", "A", 1)
    slots.answer("set-state", "B", "bad")
    assert slots.answer("get-state", "B") == "bad"
    assert slots.primary == "A"
    slots.answer("set-primary", "B")
    assert (slots.answer("get-primary"), slots.answer("get-state", "B"), slots.attempts("B")) == ("B", "good", 0)
    assert [computer.boot() for _ in range(5)] == ["B", "B", "B", "A", "A"]
    slots.mark_good("B")
    assert computer.boot() == "B"


def test_every_change_is_within_the_sector_that_a_disk_writes_as_a_whole(computer: OnboardFiles) -> None:
    inode = computer.grubenv.stat().st_ino
    for change in (computer.slots.put_first, computer.slots.mark_bad, computer.slots.mark_good):
        change("B")
        block = computer.grubenv.read_bytes()
        assert len(block) == 1024
        assert set(block[512:]) == set(b"#")
    assert computer.grubenv.stat().st_ino == inode  # not replaced: GRUB finds it by its place on the disk


@pytest.mark.skipif(shutil.which("grub-editenv") is None, reason="grub-editenv is not installed (grub-common)")
def test_grubs_own_tool_reads_what_we_write(computer: OnboardFiles) -> None:
    computer.slots.put_first("B")
    listed = subprocess.run(["grub-editenv", str(computer.grubenv), "list"], capture_output=True, text=True, check=True).stdout
    assert listed.splitlines() == ["ORDER=B A", "A_OK=1", "A_TRY=1", "B_OK=1", "B_TRY=0"]


def test_damaged_variables_and_unknown_requests_are_refused_in_one_line(computer: OnboardFiles) -> None:
    with pytest.raises(UpdateError, match="unknown request 'set-state C good'"):
        computer.slots.answer("set-state", "C", "good")
    computer.grubenv.write_bytes(b"")
    with pytest.raises(UpdateError, match=r"grubenv: is damaged; flash this computer's disk"):
        computer.slots.mark_good("A")
    computer.cmdline.write_text("root=/dev/sda1")
    with pytest.raises(UpdateError, match="not started from one of radron's slots"):
        _ = computer.slots.booted
