"""The preflight finding on the clock, with a fake chronyc."""

import asyncio

import pytest

from radron.agent.preflight import chrony
from radron.agent.preflight.chrony import chrony_finding

REPORT = "C0A80101,192.168.1.1,3,1700000000.123456789,{},0.000001,0.00002,-1.234,0.000,0.05,0.0012,0.0004,64.2,{}"


@pytest.fixture
def answering(tmp_path, monkeypatch):
    """Put a chronyc with the given behaviour on the path."""
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")

    def answer(script):
        program = tmp_path / "chronyc"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        return asyncio.run(chrony_finding(alone=False))

    return answer


@pytest.mark.parametrize(
    ("script", "verdict", "text"),
    [
        (f"echo {REPORT.format('-0.000212', 'Normal')}", "ok", "0.2 ms from 192.168.1.1"),
        (f"echo '{REPORT.format('0.001', 'Insert second')}'", "ok", "1.0 ms"),
        (f"echo {REPORT.format('0.120', 'Normal')}", "not yet", "0.12 s from 192.168.1.1"),
        (f"echo '{REPORT.format('0.0', 'Not synchronised')}'", "not yet", "not synchronised"),
        ("echo '506 Cannot talk to daemon' >&2; exit 1", "failed", "506 Cannot talk to daemon"),
        (f"echo {REPORT.format('nan', 'Normal')}", "failed", "unexpected output"),
        ("echo 1,2,3", "failed", "unexpected output"),
        ("true", "failed", "unexpected output"),
        ("printf '\\377\\376'", "failed", "unexpected output"),
    ],
)
def test_what_chrony_says(answering, script, verdict, text):
    finding = answering(script)
    assert finding.verdict == verdict
    assert text in finding.text


def test_the_report_is_asked_for_in_its_form_for_programs(answering):
    assert "-c tracking" in answering('echo "$@" >&2; exit 1').text


def test_one_that_hangs_is_not_waited_for(answering, monkeypatch):
    monkeypatch.setattr(chrony, "_PATIENCE_S", 0.2)
    assert "has not answered" in answering("exec sleep 60").text


@pytest.mark.parametrize(("alone", "verdict"), [(True, "ok"), (False, "failed")])
def test_without_chrony_only_a_drone_that_flies_alone_is_ready(tmp_path, monkeypatch, alone, verdict):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert asyncio.run(chrony_finding(alone)).verdict == verdict
