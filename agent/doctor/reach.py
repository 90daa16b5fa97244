"""How well the other drones are reached over the mesh's network: round trip and loss, by the system's ``ping``."""

from __future__ import annotations

import asyncio
import re
from asyncio.subprocess import DEVNULL, PIPE, STDOUT

from radron.agent.doctor.report import Check

PINGS, INTERVAL_S = 25, 0.2
SLOW_MS, LOSSY = 100.0, 0.05  # the drones plan with poses that are 0.1 s old; they miss nothing at this loss
_PATIENCE_S = PINGS * INTERVAL_S + 5.0
_COUNTS = re.compile(r"(\d+) packets transmitted, (\d+) received")
_TIMES = re.compile(r"= ([\d.]+)/([\d.]+)/([\d.]+)/")  # ms: least, mean, most


async def reach(drone: str, endpoint: str | None) -> Check:
    """Check how well the computer of another drone is reached by radio, with or without a running agent: round trip and loss of
    pings.
    """
    name = f"reach {drone}"
    if endpoint is None:
        return Check("swarm", name, "failed", "mesh.endpoints has no entry for it")
    address = endpoint.partition("/")[2].rpartition(":")[0].strip("[]")
    command = ("ping", "-n", "-q", "-c", str(PINGS), "-i", str(INTERVAL_S), "-W", "1", address)
    try:
        process = await asyncio.create_subprocess_exec(*command, stdin=DEVNULL, stdout=PIPE, stderr=STDOUT)
    except OSError:
        return Check("swarm", name, "not yet", "not measured: ping is missing; `apt-get install iputils-ping`")
    try:
        async with asyncio.timeout(_PATIENCE_S):
            output, _ = await process.communicate()
    except TimeoutError:
        return Check("swarm", name, "not yet", f"{address}: ping has not ended within {_PATIENCE_S:g} s")
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return judged(name, address, output.decode(errors="replace"))


def judged(name: str, address: str, output: str) -> Check:
    """Return the check of the radio link from the output of ``ping -q``."""
    counts, times = _COUNTS.search(output), _TIMES.search(output)
    if counts is None:
        lines = output.strip().splitlines()
        return Check("swarm", name, "not yet", f"{address}: ping says: {lines[-1][:80] if lines else 'nothing'}")
    sent, received = int(counts[1]), int(counts[2])
    if received == 0 or times is None:
        return Check("swarm", name, "not yet", f"{address} does not answer: is it switched on, its radio in reach?")
    loss, mean_ms, most_ms = 1.0 - received / sent, float(times[2]), float(times[3])
    text = f"{address}: {mean_ms:.1f} ms (at most {most_ms:.1f}), {100.0 * loss:.0f} % of {sent} lost"
    if loss > LOSSY or mean_ms > SLOW_MS:
        return Check("swarm", name, "check", f"{text}: check antennas and channel")
    return Check("swarm", name, "ok", text)
