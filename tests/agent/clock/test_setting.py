"""A dead clock is set by the autopilot's: the choice of the clock, the time, and the authority for it."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from radron.agent.clock import setting
from radron.agent.clock.handover import TIME_FILE, Told, Valid, hand_over, taken
from radron.agent.clock.setting import ClockError, set_clock, validity_of, wanted
from support.mesh.identities import DAY_NS, identity, new_issuer

BEGIN_NS = 1_800_000_000_000_000_000
VALID = Valid(BEGIN_NS, BEGIN_NS + 30 * DAY_NS)
DEAD_NS = 1_600_000_000_000_000_000


def told(utc_ns: int, uptime_s: float = 0.0) -> Told:
    return Told(utc_ns=utc_ns, uptime_s=uptime_s)


def test_a_dead_clock_is_set_to_the_time_that_has_gone_on_since_it_was_told() -> None:
    assert wanted(told(BEGIN_NS + DAY_NS, 100.0), VALID, DEAD_NS, 102.5) == BEGIN_NS + DAY_NS + 2_500_000_000


@pytest.mark.parametrize("clock_ns", [BEGIN_NS, BEGIN_NS + DAY_NS, VALID.end_ns + DAY_NS])
def test_a_clock_that_may_be_right_is_left_as_it_is(clock_ns: int) -> None:
    with pytest.raises(ClockError, match="which may be right: it is left as it is"):
        wanted(told(BEGIN_NS + 2 * DAY_NS), VALID, clock_ns, 0.0)


@pytest.mark.parametrize("utc_ns", [0, BEGIN_NS - 1, VALID.end_ns, 2**63 - 1, -(2**63), 10**30])
def test_no_time_is_taken_at_which_the_certificate_is_not_valid(utc_ns: int) -> None:
    with pytest.raises(ClockError, match=r"the autopilot's time is .*, which is not 2027-01-15"):
        wanted(told(utc_ns), VALID, DEAD_NS, 0.0)


def test_nor_one_before_the_release_was_made(tmp_path: Path) -> None:
    own = identity(new_issuer(), tmp_path, "d1").own
    file = tmp_path / "d1/certificate.pem"
    assert validity_of(file, None) == (own.not_before_ns, own.not_after_ns)
    assert validity_of(file, own.not_before_ns - 1) == (own.not_before_ns, own.not_after_ns)
    assert validity_of(file, own.not_before_ns + DAY_NS) == (own.not_before_ns + DAY_NS, own.not_after_ns)
    with pytest.raises(ClockError, match="there is no certificate"):
        validity_of(tmp_path / "missing.pem", None)


def test_what_the_agent_hands_over_is_taken_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock of this computer is not set: the system call is replaced, and chronyc is not there."""
    calls: list[int] = []
    monkeypatch.setattr(setting.time, "clock_settime_ns", lambda _, at_ns: calls.append(at_ns))
    monkeypatch.setenv("PATH", "")
    now_ns = time.time_ns()
    valid = Valid(now_ns + DAY_NS, now_ns + 3 * DAY_NS)
    hand_over(tmp_path, told(now_ns + 2 * DAY_NS, time.monotonic()))
    assert "set to the autopilot's" in set_clock(tmp_path / TIME_FILE, valid)
    assert 0 <= calls[0] - (now_ns + 2 * DAY_NS) < 60e9
    with pytest.raises(ClockError, match="there is no time"):
        set_clock(tmp_path / TIME_FILE, valid)
    (tmp_path / TIME_FILE).write_text('{"utc_ns": "now"}')
    with pytest.raises(ClockError, match="there is no time"):
        set_clock(tmp_path / TIME_FILE, valid)
    assert list(tmp_path.iterdir()) == []
    assert len(calls) == 1


def test_whatever_the_agent_puts_there_is_no_time_and_holds_nobody_up(tmp_path: Path) -> None:
    file = tmp_path / TIME_FILE
    for content in (b"", b"x" * 10_000_000, b'{"utc_ns":1,"uptime_s":-1e308}', b'{"utc_ns":1,"uptime_s":1e308}'):
        file.write_bytes(content)
        assert taken(file) is None
        assert not file.exists()
    file.symlink_to("/dev/zero")
    assert taken(file) is None
    os.mkfifo(file)
    assert taken(file) is None
    assert not file.exists()
    file.mkdir()
    assert taken(file) is None
