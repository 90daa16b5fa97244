"""The page: readable without colours, and its exit code."""

from __future__ import annotations

import io
from typing import get_args

import pytest
from rich.console import Console

from radron.agent.doctor.examination import folded
from radron.agent.doctor.report import Check, Report, Setting, Verdict, page


def report(*verdicts: Verdict, written: tuple[Setting, ...] = ()) -> Report:
    checks = tuple(Check("computer", f"thing {number}", verdict, "[text]") for number, verdict in enumerate(verdicts))
    return Report(drone="d1", version="0.1.0", mission="yard 0", stamp_ns=0, checks=checks, written=written)


def printed(what: Report) -> str:
    out = io.StringIO()
    Console(file=out, width=120, color_system=None).print(page(what, "10.7.1.11"))
    return out.getvalue()


@pytest.mark.parametrize(
    ("verdicts", "code", "word"),
    [
        (("ok", "ok"), 0, "+ ready"),
        (("ok", "not yet"), 3, "~ not all is ready: thing 1"),
        (("check",), 3, "~ not all is ready: thing 0"),
        (("failed", "not yet"), 1, "X NOT READY: thing 0, thing 1"),
    ],
)
def test_the_exit_code_and_the_last_line(verdicts: tuple[Verdict, ...], code: int, word: str) -> None:
    assert report(*verdicts).code == code
    assert printed(report(*verdicts)).rstrip().endswith(word)


def test_the_verdicts_differ_without_colours() -> None:
    every: tuple[Verdict, ...] = get_args(Verdict)
    lines = [line.split("│")[3].strip() for line in printed(report(*every)).splitlines() if "thing" in line and "│" in line]
    assert len(set(lines)) == len(every)
    assert len({line[0] for line in lines}) == len(every)  # shown by the sign alone


def test_what_was_set_shows_before_and_after() -> None:
    told = printed(report("ok", written=(Setting("GF_ACTION", 1.0, 3.0, True), Setting("NAV_RCL_ACT", 0.0, None, False))))
    assert "parameter GF_ACTION: 1 before, 3 now\n" in told
    assert "parameter NAV_RCL_ACT: 0 before, no answer now: NOT TAKEN" in told


def test_parameters_that_are_right_take_one_line() -> None:
    bad = Check("autopilot", "GF_ACTION", "failed", "is 0")
    good = [Check("autopilot", name, "ok", "3") for name in ("NAV_RCL_ACT", "COM_OBL_RC_ACT")]
    peer = Check("swarm", "D2", "ok", "landed")
    assert folded([bad, *good, peer]) == [bad, peer, Check("autopilot", "parameters", "ok", "NAV_RCL_ACT 3, COM_OBL_RC_ACT 3")]
