"""What the vehicles' satellite receivers tell their autopilots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.movingframes import MovingFrames
from sim.vehicle.px4.estimate import Geodetic
from sim.vehicle.px4.face import Px4Face
from sim.vehicle.px4.state import GPS_FIX_S, Reading

Array = NDArray[np.float64]
OPEN_SKY_M = (0.7, 1.0)  # horizontal, vertical: what a receiver tells that has no errors of its own here


class Satellites:
    """N receivers: those of the scenario, or for vehicles of which it says nothing one that agrees with the vehicle's filter."""

    def __init__(self, localized: MovingFrames | None, count: int) -> None:
        self._receivers = [None] * count if localized is None else localized.receiver
        self._readings: list[Reading | None] = [None] * count

    def hopeful(self, drone: int) -> bool:
        """Whether a vehicle waits for its satellites; not any more where they are lost for good."""
        receiver = self._receivers[drone]
        return receiver is None or not receiver.lost

    def tell(self, drone: int, face: Px4Face, place: Array, believed: Geodetic) -> None:
        """Let a vehicle's autopilot know, each step. ``place``: (3,), true, in the world."""
        receiver = self._receivers[drone]
        if receiver is None:
            on_board = face.by_satellites
            ready = on_board and face.boot_us >= GPS_FIX_S * 1e6
            face.receive_satellites(on_board, Reading(face.boot_us, believed, *OPEN_SKY_M) if ready else None)
            return
        fix = receiver.fix(0, place)
        if fix is not None:
            where = Geodetic(fix.latitude_deg, fix.longitude_deg, fix.altitude_m)
            self._readings[drone] = Reading(face.boot_us, where, fix.horizontal_sigma_m, fix.vertical_sigma_m)
        if not receiver.available:
            self._readings[drone] = None
        face.receive_satellites(True, self._readings[drone])
