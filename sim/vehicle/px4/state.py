"""One vehicle's state, as its messages tell it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from sim.vehicle.px4.battery import Battery
from sim.vehicle.px4.commander import Commander
from sim.vehicle.px4.estimate import Estimate, Geodetic

GPS_FIX_S = 3.0  # after the start: then there are a position on the globe, the origin, and home
Message: TypeAlias = Any  # pymavlink has no types


@dataclass(slots=True)
class State:
    """What the messages are made of. ``home_altitude_m`` wanders in flight, as PX4's does; ``position_sigma_m``: horizontal,
    vertical, by the filter's own account.
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

    @property
    def has_fix(self) -> bool:
        """GNSS is there."""
        return self.boot_s >= GPS_FIX_S


Builder = Callable[[State], Message]  # None where there is nothing to tell yet
