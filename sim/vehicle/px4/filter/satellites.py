"""Readings of the emulated vehicles' satellite receivers for their autopilots."""

from __future__ import annotations

from radron.sim.geometry import Array
from radron.sim.vehicle.px4.face import Px4Face
from radron.sim.vehicle.px4.filter.estimate import Geodetic
from radron.sim.vehicle.px4.state import GPS_FIX_S, Reading
from radron.sim.world.movingframes import MovingFrames

SATELLITES = 10  # SIM_GPS_USED's default
OPEN_SKY_M = (0.7, 1.0)  # horizontal, vertical: reported accuracy of a receiver without modelled errors


class Satellites:
    """The satellite receivers of N vehicles: the scenario's, or for other vehicles a receiver that agrees with the filter."""

    def __init__(self, localized: MovingFrames | None, count: int) -> None:
        self._receivers = [None] * count if localized is None else localized.receiver
        self._readings: list[Reading | None] = [None] * count

    def may_regain(self, drone: int) -> bool:
        """Return whether a vehicle may still get satellites; it may not after a permanent loss."""
        receiver = self._receivers[drone]
        return receiver is None or not receiver.lost

    def tell(self, drone: int, face: Px4Face, place: Array, believed: Geodetic) -> None:
        """Give the present reading to a vehicle's autopilot, once each time step. ``place``: (3,), true position in the world."""
        receiver = self._receivers[drone]
        if receiver is None:
            on_board = face.by_satellites
            ready = on_board and face.in_sight and face.boot_us >= GPS_FIX_S * 1e6
            face.receive_satellites(on_board, Reading(face.boot_us, believed, *OPEN_SKY_M) if ready else None)
            return
        fix = receiver.fix(0, place)
        if fix is not None:
            where = Geodetic(fix.latitude_deg, fix.longitude_deg, fix.altitude_m)
            self._readings[drone] = Reading(face.boot_us, where, fix.horizontal_sigma_m, fix.vertical_sigma_m)
        if not (receiver.available and face.in_sight):
            self._readings[drone] = None
        face.receive_satellites(True, self._readings[drone])
