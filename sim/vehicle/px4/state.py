"""State of one emulated vehicle, from which its MAVLink messages are built."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from radron.sim.vehicle.px4.battery import Battery
from radron.sim.vehicle.px4.commander import Commander
from radron.sim.vehicle.px4.filter.deadreckoning import DeadReckoning
from radron.sim.vehicle.px4.filter.estimate import Estimate, Geodetic

GPS_FIX_S = 0.5  # after the start: first position of a receiver
ORIGIN_S = 1.6  # after the start: the filter begins, and knows its place on the globe
Message: TypeAlias = Any  # pymavlink has no types


class Reading(NamedTuple):
    """Reading of a satellite receiver: time by the vehicle's clock, position, and 1-sigma accuracies."""

    boot_us: int
    place: Geodetic
    horizontal_m: float
    vertical_m: float


@dataclass(slots=True)
class State:
    """Everything that the MAVLink messages of one emulated vehicle report.

    ``home_altitude_m`` wanders in flight, as PX4's does. ``position_sigma_m``: horizontal and vertical, as reported by the
    filter. ``resets``: number of resets of the filter; ``events``: number of the latest event. ``receiver``: there is one on
    board; ``reading``: its latest reading, None without reception. ``has_origin``: the vehicle uses satellites and has had some,
    so it knows its place on the globe, and has a home. ``knows_position``: the vehicle knows its position in its local frame.
    ``truth``: true state as sent by PX4's own simulator; its position is in the world, ENU.
    """

    commander: Commander
    battery: Battery
    reckoning: DeadReckoning
    origin: Geodetic  # of the local frame
    position_sigma_m: tuple[float, float]
    software: int  # version number, as AUTOPILOT_VERSION carries it
    uid: int = 0
    boot_s: float = 0.0
    utc_ns: int = 0
    estimate: Estimate | None = None
    truth: Callable[[], Estimate] | None = None
    home_altitude_m: float = 0.0
    resets: int = 0
    events: int = 0
    receiver: bool = True
    reading: Reading | None = None
    has_origin: bool = False
    knows_position: bool = True

    @property
    def now(self) -> Estimate:
        """The latest estimate of the vehicle's motion; it exists from the first step on."""
        assert self.estimate is not None
        return self.estimate

    @property
    def boot_ms(self) -> int:
        """PX4's clock, milliseconds since its start."""
        return int(self.boot_s * 1e3)

    @property
    def boot_us(self) -> int:
        """PX4's clock, microseconds since its start."""
        return int(self.boot_s * 1e6)


Builder = Callable[[State], Message]  # None where there is nothing to send yet
