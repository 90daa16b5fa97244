"""N emulated vehicles, stepped together: the interface of the world process.

    fleet = Px4Fleet(configs, motion, error, STEP_S, rng)     # Multirotors and Localization as in lockstep, made for STEP_S
    await fleet.start()                                       # opens the sockets on the running loop
    every STEP_S (0.01 s): fleet.step()                       # moves everything by one step and sends the messages due
    fleet.reports()                                           # what the observer wants to know of each vehicle
    fleet.close()
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.localization import Localization
from sim.vehicle.multirotor import Multirotors
from sim.vehicle.px4.config import Datum, Px4Config

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class VehicleReport:
    """What an observer sees of one vehicle, beside its true motion."""

    mode: str
    armed: bool
    in_air: bool
    failsafe: bool
    setpoints: int  # position targets received
    computed_setpoints: int  # of them those that say something else than the one before
    largest_gap_s: float  # between two computed setpoints while in offboard


class Px4Fleet:
    """The vehicles 0 .. N-1, MAVLink system ids 1 .. N.

    Each has its own local NED frame with an origin some tens of metres from where it stands.
    """

    def __init__(
        self,
        configs: Sequence[Px4Config],
        motion: Multirotors,
        error: Localization,
        step_s: float,
        rng: np.random.Generator,
        *,
        datum: Datum = Datum(),  # noqa: B008 - frozen
        frame_yaw_rad: Sequence[float] | None = None,
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """``frame_yaw_rad``: heading of each vehicle's local frame in the world; none: all are right. ``clock_ns``: UTC."""

    async def start(self) -> None:
        """Open the links on the running loop."""

    def step(self) -> None:
        """Advance by one step: estimate, modes, motion, errors; then send what is due. Never blocks."""

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start: the vehicles' boot time."""
        return 0.0

    def reports(self) -> list[VehicleReport]:
        """One for each vehicle."""
        return []

    def close(self) -> None:
        """Close the links."""
