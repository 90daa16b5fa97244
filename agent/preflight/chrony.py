"""The synchronisation of this computer's clock by chrony: ``chronyc -c tracking``, as a finding of the preflight check."""

from __future__ import annotations

import asyncio
from asyncio.subprocess import DEVNULL, PIPE, STDOUT
from math import isfinite

from radron.agent.localization.clocks import LIMIT_S
from radron.agent.vehicle.interface import Finding

NAME = "chrony"
_PATIENCE_S = 3.0
# Fields of the report, by chronyc(1): reference id, server, stratum, reference time, offset of the system's clock in seconds, and
# more, to the leap status.
_FIELDS, _SERVER, _OFFSET, _LEAP = 14, 1, 4, -1
_SYNCHRONISED = ("normal", "insert second", "delete second")


async def chrony_finding(alone: bool) -> Finding:
    """Check by chrony whether this computer's clock is synchronised. ``alone``: a mission of a single drone, without other
    clocks.
    """
    try:
        process = await asyncio.create_subprocess_exec(
            "chronyc", "-n", "-c", "tracking", stdin=DEVNULL, stdout=PIPE, stderr=STDOUT
        )
    except OSError as error:
        if alone:
            return Finding(NAME, "ok", "not installed; not needed, as there is no other drone")
        return Finding(NAME, "failed", f"chronyc cannot be run ({error.strerror}): install chrony, with one server for all")
    try:
        async with asyncio.timeout(_PATIENCE_S):
            output, _ = await process.communicate()
    except TimeoutError:
        return Finding(NAME, "failed", f"chronyc has not answered in {_PATIENCE_S:g} s: check that chronyd runs")
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return judged(output.decode(errors="replace"), process.returncode)


def judged(output: str, returncode: int | None) -> Finding:
    """Return the preflight finding on the computer's clock from the output of ``chronyc -c tracking``."""
    lines = output.strip().splitlines()
    text = lines[-1][:80] if lines else ""
    if returncode != 0:
        return Finding(NAME, "failed", f"chronyc says: {text or 'nothing'}; check that chronyd runs")
    fields = [field.strip() for field in lines[-1].split(",")] if lines else []
    offset_s = _number(fields[_OFFSET]) if len(fields) >= _FIELDS else None
    if offset_s is None:
        return Finding(NAME, "failed", f"unexpected output of chronyc: {text!r}")
    if fields[_LEAP].lower() not in _SYNCHRONISED:
        return Finding(NAME, "not yet", f"the clock is not synchronised ({fields[_LEAP].lower()})")
    if abs(offset_s) > LIMIT_S:
        return Finding(NAME, "not yet", f"being corrected: the clock differs by {abs(offset_s):.2f} s from {fields[_SERVER]}")
    return Finding(NAME, "ok", f"the clock differs by {1e3 * abs(offset_s):.1f} ms from {fields[_SERVER]}")


def _number(field: str) -> float | None:
    try:
        value = float(field)
    except ValueError:
        return None
    return value if isfinite(value) else None
