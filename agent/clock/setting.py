"""``radron-update clock``: a dead clock is set to the time that the agent has heard from the autopilot. As root.

The agent is not believed what it says: only a clock that shows a time before the drone's certificate, or before this release was
made, is set, and only to one at which both are valid.
"""

from __future__ import annotations

import subprocess
import time
from contextlib import suppress
from pathlib import Path

from agent.clock.handover import TIME_FILE, Told, Valid, taken, text
from agent.errors import RadronError

TOLD = Path("/run/radron-agent") / TIME_FILE
CERTIFICATE = Path("/run/credstore/certificate.pem")
# A chronyd whose clock was dead gives no time to other drones; now it may, as /etc/chrony/chrony.conf has it otherwise.
GIVES_TIME = ("chronyc", "local", "stratum", "10", "orphan")
_PATIENCE_S = 10.0


class ClockError(RadronError):
    """The clock is not set, and why."""


def set_clock(file: Path, valid: Valid) -> str:
    """Set this computer's clock by what the agent has handed over, which is gone then; returns what was done.

    Raises:
        ClockError: nothing was handed over, it cannot be right, or the clock is not dead.
        OSError: not permitted.
    """
    told = taken(file)
    if told is None:
        raise ClockError(f"{file}: there is no time")
    before_ns = time.time_ns()
    now_ns = wanted(told, valid, before_ns, time.monotonic())
    time.clock_settime_ns(time.CLOCK_REALTIME, now_ns)
    with suppress(OSError, subprocess.TimeoutExpired):
        subprocess.run(GIVES_TIME, capture_output=True, check=False, timeout=_PATIENCE_S)
    return f"the clock showed {text(before_ns)}; set to the autopilot's, {text(now_ns)}"


def wanted(told: Told, valid: Valid, clock_ns: int, uptime_s: float) -> int:
    """What the clock should show now, UTC in nanoseconds.

    Args:
        told: what the agent has heard.
        valid: between which times a clock may be right.
        clock_ns: what it shows now.
        uptime_s: now, by the monotonic clock.

    Raises:
        ClockError: the clock is not dead, or the time that was told cannot be right.
    """
    now_ns = told.at(uptime_s)
    if clock_ns >= valid.begin_ns:
        raise ClockError(f"the clock shows {text(clock_ns)}, which may be right: it is left as it is")
    if now_ns not in valid:
        raise ClockError(f"the autopilot's time is {text(now_ns)}, which is not {text(valid.begin_ns)} to {text(valid.end_ns)}")
    return now_ns


def validity_of(certificate: Path, made_ns: int | None) -> Valid:
    """When a certificate is valid, from the date of this release on.

    Raises:
        ClockError: there is no certificate that can be read.
    """
    from cryptography import x509  # noqa: PLC0415  a second

    try:
        own = x509.load_pem_x509_certificate(certificate.read_bytes())
    except (OSError, ValueError):
        raise ClockError(f"{certificate}: there is no certificate, by which a time could be judged") from None
    begin_ns, end_ns = (int(at.timestamp()) * 1_000_000_000 for at in (own.not_valid_before_utc, own.not_valid_after_utc))
    return Valid(max(begin_ns, made_ns or 0), end_ns)
