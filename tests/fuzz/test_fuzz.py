"""A few seconds of every fuzz target, and the engine's treatment of a finding."""

from __future__ import annotations

import argparse
import time
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest

from radron.protocol.errors import ProtocolError
from radron.protocol.keys import parse_key
from radron.protocol.messages import KINDS
from support.flights.one_pilot import MISSION
from tests.fuzz import __main__ as command
from tests.fuzz.messages import Messages
from tests.fuzz.runner import Journal, Outcome, chunks, keep
from tests.fuzz.target import Probe, Target, TooSlowError, ViolationError, expect, run_case
from tests.fuzz.targets import TARGETS

SEED = 11  # not that of make fuzz


@pytest.mark.parametrize("name", TARGETS)
def test_nothing_is_found_in_a_moment(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = TARGETS[name](tmp_path)
    monkeypatch.setattr(target, "batch", max(5, target.batch // 10))
    probe, finding = run_case(target, SEED, 0)
    assert finding is None, finding.trace
    assert probe.count > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_nothing_is_found_in_seconds(name: str, tmp_path: Path) -> None:
    target, end_s, number = TARGETS[name](tmp_path), time.process_time() + 3.0, 0
    while time.process_time() < end_s:
        number += 1
        _, finding = run_case(target, SEED, number)
        assert finding is None, f"{finding.replay}\n{finding.trace}"


def test_messages_of_all_kinds_come_under_keys_that_are_read(tmp_path: Path) -> None:
    """Else only the reader of the keys sees their content."""
    messages, rng, kinds = Messages(tmp_path), Random(SEED), set()
    for _ in range(1000):
        with suppress(ProtocolError):
            kinds.add(parse_key(messages._key(rng, MISSION)).kind)
    assert kinds == set(KINDS)


class Reader(Target):
    """Fails at an input that ends with 7, in one of several ways."""

    name = "reader"
    inputs = 100
    batch = 10
    limit_s = 0.01
    way = "error"

    def case(self, rng: Random, probe: Probe) -> None:
        for _ in range(self.batch):
            probe.feed(str(rng.randrange(1000)).encode(), self.read, probe)

    def read(self, probe: Probe) -> None:
        if not probe.data.endswith(b"7"):
            return
        if self.way == "slow":
            end_s = time.thread_time() + 0.012
            while time.thread_time() < end_s:
                pass
        expect(self.way != "wrong", "a number that ends with 7 is taken")
        if self.way == "error":
            raise KeyError(probe.data)


@pytest.mark.parametrize(("way", "kind"), [("error", KeyError), ("slow", TooSlowError), ("wrong", ViolationError)])
def test_a_finding_is_the_same_again(way: str, kind: type[Exception], tmp_path: Path) -> None:
    reader = Reader(tmp_path)
    reader.way = way
    findings = [finding for number in range(9) if (finding := run_case(reader, 1, number)[1]) is not None]
    assert len(findings) > 2
    assert {finding.kind.split()[0] for finding in findings} == {kind.__name__}
    assert len({finding.kind for finding in findings}) == 1
    assert run_case(reader, 1, findings[0].case)[1] == findings[0]
    assert findings[0].data.endswith(b"7")
    assert keep(findings[0], tmp_path).read_bytes() == findings[0].data


def test_a_run_has_the_inputs_that_were_asked_for_and_goes_on_where_it_was(tmp_path: Path) -> None:
    planned = chunks(list(TARGETS), 0.01, 1)
    for name, target in TARGETS.items():
        cases = [number for chunk in planned if chunk.target == name for number in range(chunk.first, chunk.last)]
        assert sorted(cases) == list(range(len(cases)))
        assert len(cases) * target.batch >= 0.01 * target.inputs
    journal = Journal(tmp_path, 1, 0.01)
    journal.add(Outcome(planned[0], 7))
    assert Journal(tmp_path, 1, 0.01).done == {planned[0]: 7}
    assert Journal(tmp_path, 2, 0.01).done == {}


def test_the_command_ends_with_1_where_something_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    finding = run_case(Reader(tmp_path), 1, 0)[1] or run_case(Reader(tmp_path), 1, 1)[1]
    assert finding is not None
    options = argparse.Namespace(out=tmp_path, seed=1, share=1e-9, workers=1, minutes=1.0)
    for findings, code in (([finding], 1), ([], 0)):
        monkeypatch.setattr(command, "run", lambda todo, *_, found=findings: [Outcome(todo[0], 1, 1.0, 0.1, found)])
        assert command.fuzz(["drones"], options) == code
    assert finding.replay in capsys.readouterr().err
