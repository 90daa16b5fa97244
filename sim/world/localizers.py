"""Kinds of localisation of the simulated vehicles, and events in flight.

A vehicle localises by satellites, by satellites with carrier phase (RTK), or by SLAM.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal

from msgspec import Meta, Struct

from radron.agent.errors import ConfigError
from radron.protocol.units import DroneId
from radron.sim.world.gnss import RTK, GnssTruth

Kind = Literal["gnss", "rtk", "slam"]
Metres = Annotated[float, Meta(ge=0.0, le=1000.0)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Seconds = Annotated[float, Meta(ge=0.0, le=1e6)]
HalfTurn = Annotated[float, Meta(ge=0.0, le=180.0)]


class SlamTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """True errors of SLAM, that is odometry by camera or LiDAR: they grow with the distance flown.

    The rates of growth (1 sigma) change slowly with the distance. The defaults give 0.7 m and 1 degree after the first 100 m, and
    then grow with the root of the distance: 0.5-1 % and about a degree in 100 m are what visual-inertial odometry reaches on
    multirotors (Delmerico and Scaramuzza, ICRA 2018; Geiger et al., KITTI odometry).
    """

    drift: Share = 0.01  # of the distance flown, of each horizontal axis
    vertical: Share = 0.003  # the same vertically; a barometer or rangefinder helps
    yaw_degpm: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.015
    along_m: Annotated[float, Meta(gt=0.0, le=1e5)] = 25.0  # correlation length of these rates
    told_m: Metres = 0.1  # reported accuracy, regardless of the true one
    closure_s: Annotated[float, Meta(gt=0.0, le=1e6)] | None = None  # mean time between loop closures; None: no closures
    closure_share: Share = 0.8  # share of the drift that a closure corrects at once
    closure_announced: bool = True  # with a new epoch


class EventTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An event in flight that changes a vehicle's localisation: a switch to another kind, or a jump.

    at_s: seconds after the start of the simulation. switch_to: new kind of localisation; gnss and rtk are lost at a switch to
    slam. jump_m: horizontal jump of its position, in a direction drawn from the seed. turn_deg: jump of its heading, to either
    side. announced: a new epoch begins, so that the agent learns of the jump.
    """

    at_s: Seconds
    switch_to: Kind | None = None
    jump_m: Metres = 0.0
    turn_deg: HalfTurn = 0.0
    announced: bool = True


class VehicleTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """True localisation of one vehicle: its kind, initial errors, receiver and events.

    The vehicle's local frame begins at the mission's launch layout, with errors drawn from the seed. origin_m: 1 sigma of each
    axis (a tenth of it vertically: the ground is known best). yaw_deg: the heading is uniform within this angle to either side.
    receiver: its satellite receiver, by default the usual one of this kind; a vehicle with SLAM has none unless given.
    """

    kind: Kind
    origin_m: Metres = 0.0
    yaw_deg: HalfTurn = 0.0
    receiver: GnssTruth | None = None
    slam: SlamTruth = SlamTruth()
    events: tuple[EventTruth, ...] = ()

    @property
    def reception(self) -> GnssTruth | None:
        """The satellite receiver on board; None without one."""
        if self.receiver is not None:
            return self.receiver
        kinds = {self.kind, *(event.switch_to for event in self.events)}
        if "rtk" in kinds:
            return RTK
        return GnssTruth() if "gnss" in kinds else None

    def check(self, where: str) -> None:
        """Raise ConfigError for an impossible event. ``where``: place in the scenario file, for the error."""
        kind: Kind = self.kind
        if list(self.events) != sorted(self.events, key=lambda event: event.at_s):
            raise ConfigError(f"{where}.events: give them in order of at_s")
        for event in self.events:
            kind = event.switch_to or kind
            if event.turn_deg and kind != "slam":
                raise ConfigError(f"{where}.events: turn_deg: north is where it is by {kind}; only slam frames turn")
        if self.yaw_deg and self.kind != "slam":
            raise ConfigError(f"{where}.yaw_deg: north is where it is by {self.kind}; only slam frames start with any heading")


class LiarTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A vehicle with a spoofed position, drawn from the seed: it is wrong by ``shift_m``, in a direction drawn from the seed.

    As with spoofed satellites, its positions and its fixes are shifted alike; it flies by them, and reports nothing.
    """

    shift_m: Metres = 20.0
    at_s: Seconds = 0.0


def check_vehicles(vehicles: dict[DroneId, VehicleTruth], liar: LiarTruth | None, drones: Iterable[str], where: str) -> None:
    """Raise ConfigError if a scenario gives localisation for vehicles that the mission does not have, or impossible events."""
    known = list(drones)
    for name, vehicle in vehicles.items():
        if name not in known:
            raise ConfigError(f"{where}: localization.vehicles: no drone {name!r} in the mission; there are {', '.join(known)}")
        vehicle.check(f"{where}: localization.vehicles.{name}")
    if liar is not None and not vehicles:
        raise ConfigError(f"{where}: localization.liar: give localization.vehicles, one of which is the liar")
