"""`make image-test`: the power of a drone's computer is cut in each step of an update, four times each.

The computer always starts again, and never ends in the old slot without a report: the serial line and the boot loader's
variables are
judged. Each run begins at a kept moment of one update.
"""

from __future__ import annotations

import os

import pytest

from radron.deploy.image.layout import ROOT_B
from support.computers.cutbench import IN_MESH, ON_TRIAL, PROVISIONED, UPDATED, Bench
from support.computers.cutdisk import Moment
from support.computers.dronedisk import BOOT_S
from support.computers.machine import lacking

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif("IMAGE_TEST" not in os.environ, reason="builds and boots a disk image: `make image-test` runs it"),
    pytest.mark.skipif(lacking() is not None, reason=lacking() or ""),
]
INTERRUPTED = r"radron-update: the update to .* was interrupted before slot B could be started: slot A runs on.*; push again"
NOTHING = PROVISIONED  # nothing to report


@pytest.mark.parametrize("moment", ["copied 30 %", "copied 80 %"])
def test_a_cut_in_the_copy_leaves_the_old_release_in_service(bench: Bench, moment: str) -> None:
    run = bench.run(moment)
    run.cut()
    run.again()
    assert run.decides(NOTHING) == "A"


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_a_cut_while_the_slot_is_written_leaves_the_old_release_in_service(bench: Bench, share: float) -> None:
    run = bench.run("writing")
    begin = ROOT_B.start + int(share * bench.root_bytes)
    run.disk.watch(range(begin, begin + (1 << 20)), any, Moment.CACHED)
    run.cut_by_disk()
    run.again()
    assert run.decides(INTERRUPTED) == "A"


@pytest.mark.parametrize(
    ("begin", "variables", "moment", "slots"),
    [
        ("writing", b"ORDER=A B", Moment.CACHED, "A"),  # the slot that is going to be written is marked bad
        pytest.param("written", b"ORDER=B A", Moment.BEFORE, "A", marks=pytest.mark.smoke),  # it is to be booted
        ("written", b"ORDER=B A", Moment.CACHED, "AB"),
        ("written", b"ORDER=B A", Moment.FLUSHED, "B"),
    ],
)
def test_a_cut_at_the_write_of_the_boot_variables(bench: Bench, begin: str, variables: bytes, moment: Moment, slots: str) -> None:
    run = bench.run(begin)
    run.disk.watch(bench.variables, lambda said: variables in said, moment)
    run.cut_by_disk()
    run.again()
    assert run.decides(f"{UPDATED}|{INTERRUPTED}") in slots


@pytest.mark.parametrize(("first", "second"), [(Moment.BEFORE, "data mounted"), (Moment.CACHED, "provisioned")])
def test_two_cuts_in_the_first_boots_do_not_end_in_the_old_slot(bench: Bench, first: Moment, second: str) -> None:
    run = bench.run("to be booted")
    run.disk.watch(bench.variables, lambda said: b"B_TRY=1" in said, first)  # GRUB counts its attempt
    run.cut_by_disk()
    run.again()
    assert run.boots() == "B"
    if second == "provisioned":
        run.machine.wait_for(PROVISIONED, BOOT_S)
        run.cut()
    else:
        run.disk.watch(bench.data, any, Moment.CACHED)  # its journal is replayed
        run.cut_by_disk()
    run.again()
    assert run.decides(UPDATED) == "B"


@pytest.mark.parametrize("lines", [("", ON_TRIAL), (IN_MESH, "")])
def test_two_cuts_before_the_agent_is_well_do_not_end_in_the_old_slot(bench: Bench, lines: tuple[str, str]) -> None:
    run = bench.run("on trial")
    for line in lines:
        run.machine.wait_for(line, BOOT_S)  # "": at once
        run.cut()
        run.again()
        assert run.boots() == "B"
    assert run.decides(UPDATED) == "B"


@pytest.mark.parametrize("moment", [Moment.BEFORE, pytest.param(Moment.CACHED, marks=pytest.mark.smoke), Moment.FLUSHED, None])
def test_a_cut_as_the_slot_is_marked_good_changes_nothing_of_what_was_decided(bench: Bench, moment: Moment | None) -> None:
    run = bench.run("in the mesh")
    if moment is None:  # reported already
        run.machine.wait_for(UPDATED, BOOT_S)
        run.cut()
    else:
        run.disk.watch(bench.variables, lambda said: b"B_TRY=0" in said, moment)
        run.cut_by_disk()
    run.again()
    assert run.decides(NOTHING if moment is None else UPDATED) == "B"
