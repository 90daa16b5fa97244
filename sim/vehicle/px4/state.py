"""One vehicle's state, as its messages tell it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from sim.vehicle.px4.battery import Battery
from sim.vehicle.px4.commander import Commander
from sim.vehicle.px4.estimate import Estimate, Geodetic

GPS_FIX_S = 3.0  # after the start: then a receiver has its first position
Message: TypeAlias = Any  # pymavlink has no types


class Reading(NamedTuple):
    """What a satellite receiver says: when by the vehicle's clock, where, and 1 sigma of the distances."""

    boot_us: int
    place: Geodetic
    horizontal_m: float
    vertical_m: float


@dataclass(slots=True)
class State:
    """What the messages are made of. ``home_altitude_m`` wanders in flight, as PX4's does; ``position_sigma_m``: horizontal,
    vertical, by the filter's own account. ``resets``: of the filter.

    ``receiver``: there is one on board; ``reading``: its newest, none without reception. ``has_origin``: the vehicle is guided by
    satellites and has had some, so it knows its place on the globe, and has a home. ``knows_position``: in its local frame.
    """

    commander: Commander
    battery: Battery
    origin: Geodetic  # of the local frame
    position_sigma_m: tuple[float, float]
    uid: int = 0
    boot_s: float = 0.0
    utc_ns: int = 0
    estimate: Estimate | None = None
    home_altitude_m: float = 0.0
    resets: int = 0
    receiver: bool = True
    reading: Reading | None = None
    has_origin: bool = False
    knows_position: bool = True

    @property
    def now(self) -> Estimate:
        """The newest estimate; there is one from the first step on."""
        assert self.estimate is not None
        return self.estimate

    @property
    def boot_ms(self) -> int:
        """PX4's clock."""
        return int(self.boot_s * 1e3)

    @property
    def boot_us(self) -> int:
        """PX4's clock."""
        return int(self.boot_s * 1e6)


Builder = Callable[[State], Message]  # None where there is nothing to tell yet
