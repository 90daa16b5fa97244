"""What an emulated vehicle is told at its start: its links, where the world lies, and what is to go wrong."""

from __future__ import annotations

from msgspec import Struct

Address = tuple[str, int]


class Datum(Struct, frozen=True, kw_only=True):
    """Where the world's origin lies on the WGS 84 ellipsoid; altitude above it. The default is SIH's home near Zurich."""

    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_m: float = 488.0


class Faults(Struct, frozen=True, kw_only=True):
    """What is wrong with a vehicle from its start. Links are cut in flight by ``Px4Face.cut_link``."""

    boot_s: float = 0.0  # later than the others by so much: no message before
    silent: bool = False  # sends nothing and hears nothing
    unhealthy: str | None = None  # text of an arming check that never passes


class Px4Config(Struct, frozen=True, kw_only=True):
    """One vehicle.

    onboard: where it sends its onboard link, ("127.0.0.1", 14540 + i) by PX4's custom; answers come back to the sending socket.
    ground_station: likewise of the ground-station link, 14550 for all vehicles; none: no such link.
    parameters: other values than ``parameters.DEFAULTS``.
    """

    onboard: Address
    ground_station: Address | None = None
    parameters: dict[str, float] = {}
    faults: Faults = Faults()
