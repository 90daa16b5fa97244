"""The agent's side of a dead clock: while it waits, it listens for the autopilot's time, and hands it over to its computer."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

from radron.agent.clock.handover import Told, Valid, hand_over, text
from radron.agent.clock.systemtime import WAIT_S, overheard_time
from radron.agent.config.drone import VehicleConfig
from radron.agent.vehicle.mavlink.exposure import exposure


def seek_time(vehicle: VehicleConfig, valid: Valid, folder: Path, wait_s: float = WAIT_S) -> str:
    """Listen for the autopilot's time, and hand it over to the computer if it may be right; return the outcome in words.

    Args:
        vehicle: its link, not used by others before or after.
        valid: the interval of plausible times.
        folder: of the handover to the computer.
        wait_s: how long to listen at most.

    Raises:
        VehicleError: the link's ``source`` is no address.
    """
    if vehicle.source is None and exposure(vehicle.address) is not None:
        return (
            f"no time is taken on {vehicle.address}, where anybody could tell it: set vehicle.source to the autopilot's address"
        )
    told_ns = asyncio.run(overheard_time(vehicle.address, vehicle.system_id, vehicle.source, wait_s))
    uptime_s = time.monotonic()
    if told_ns is None:
        return (
            f"the autopilot on {vehicle.address} tells no time yet: it has it from satellites or a ground station "
            "(heard on serial lines and udpin links alone)"
        )
    if told_ns not in valid:
        return f"the autopilot's clock, {text(told_ns)}, cannot be right either"
    try:
        hand_over(folder, Told(utc_ns=told_ns, uptime_s=uptime_s))
    except OSError as error:
        return f"the autopilot's, {text(told_ns)}, cannot be handed over ({folder}: {error.strerror})"
    return f"it is set by the autopilot's, {text(told_ns)}"
