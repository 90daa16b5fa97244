"""The self-report of a computer with an installed agent, without the image's slots."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

from radron.agent.update.computer import look
from radron.agent.update.records import Records
from radron.agent.update.slots import Slots
from radron.protocol.onboard import Release


def test_a_computer_without_slots_tells_all_else_and_gets_nothing_new(tmp_path: Path) -> None:
    (tmp_path / "cmdline").write_text("BOOT_IMAGE=/vmlinuz root=/dev/sda1 ro quiet")
    told = look(Slots(tmp_path / "grubenv", tmp_path / "cmdline"), Records(tmp_path / "radron-update"))
    assert (told.release, told.slot, told.slots, told.attempts) == (Release(version=version("radron")), "", {}, 0)
    assert (told.trial, told.outcome, told.busy) == (None, None, False)
    assert 0 < told.disk_free_mb < told.disk_mb
    assert [path.name for path in tmp_path.iterdir()] == ["cmdline"]
