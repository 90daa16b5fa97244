"""``radron-update clock``: set a dead clock to the autopilot's time, as heard by the agent. As root.

The agent is not trusted. Only a clock before the start of the drone's certificate, or before the date of this release, is set. It
is only set to a time at which both are valid.
"""

from __future__ import annotations

import subprocess
import time
from contextlib import suppress
from pathlib import Path

from radron.agent.clock.handover import TIME_FILE, Told, Valid, taken, text
from radron.agent.errors import RadronError

TOLD = Path("/run/radron-agent") / TIME_FILE
CERTIFICATE = Path("/run/credstore/certificate.pem")
# After a dead clock, chronyd serves no time to other drones; this allows it again, as /etc/chrony/chrony.conf does otherwise.
GIVES_TIME = ("chronyc", "local", "stratum", "10", "orphan")
_PATIENCE_S = 10.0


class ClockError(RadronError):
    """The computer's clock is not set; the text gives the reason."""


def set_clock(file: Path, valid: Valid) -> str:
    """Set this computer's clock to the autopilot's time, which the agent has handed over, and remove the file; return the change
    in words.

    Raises:
        ClockError: no time was handed over, the time cannot be right, or the clock is not dead.
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
    """Return the right time now, UTC in nanoseconds, by the autopilot's time.

    Args:
        told: the autopilot's time, as heard by the agent.
        valid: the interval of plausible times.
        clock_ns: the clock's present time.
        uptime_s: now, by the monotonic clock.

    Raises:
        ClockError: the clock is not dead, or the autopilot's time cannot be right.
    """
    now_ns = told.at(uptime_s)
    if clock_ns >= valid.begin_ns:
        raise ClockError(f"the clock shows {text(clock_ns)}, which may be right: it is left as it is")
    if now_ns not in valid:
        raise ClockError(f"the autopilot's time is {text(now_ns)}, which is not {text(valid.begin_ns)} to {text(valid.end_ns)}")
    return now_ns


def validity_of(certificate: Path, made_ns: int | None) -> Valid:
    """Return the interval of plausible times: while the certificate is valid, and not before this release was made.

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
