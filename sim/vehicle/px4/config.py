"""Configuration of an emulated vehicle: its links, the world's datum, and injected faults."""

from __future__ import annotations

from msgspec import Struct

from radron.sim.vehicle.px4.release import ReleaseName

Address = tuple[str, int]


class Datum(Struct, frozen=True, kw_only=True):
    """Origin of the simulated world on the WGS 84 ellipsoid, with the altitude above it.

    The default is the home place of PX4's simulator (SIH) near Zurich.
    """

    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_m: float = 488.0


class Faults(Struct, frozen=True, kw_only=True):
    """Faults of an emulated vehicle that are configured from the start.

    In flight, links are cut by ``Px4Face.cut_links``, satellites by ``lose_satellites``.
    """

    boot_s: float = 0.0  # additional boot time: no message before
    silent: bool = False  # neither sends nor receives
    unhealthy: str | None = None  # text of an arming check that never passes
    satellites_lost_s: tuple[float, float] | None = None  # begin of an outage, by its own clock, and duration


class Px4Config(Struct, frozen=True, kw_only=True):
    """Configuration of one emulated vehicle.

    onboard: address to which it sends its onboard link, ("127.0.0.1", 14540 + i) by PX4's custom; answers return to the sending
    socket. ground_station: address for the ground-station link, 14550 for all vehicles; None: no such link. parameters: values
    that replace ``parameters.DEFAULTS``. release: version of PX4.
    """

    onboard: Address
    ground_station: Address | None = None
    parameters: dict[str, float] = {}
    faults: Faults = Faults()
    release: ReleaseName = "1.17"
