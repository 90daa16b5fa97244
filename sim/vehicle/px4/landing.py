"""Emulation of PX4's land detector: takeoff and landing are noticed late, and landing sometimes never."""

from __future__ import annotations

import numpy as np

from radron.sim.vehicle.px4.modes import Mode

SPOOL_UP_S = 0.85  # after arming
DETECTED_S = (0.75, 1.1)  # delay of takeoff detection once the rotors turn and a climb is wanted
RAMP_S = 2.35  # from then until the thrust lifts the vehicle
DRIFTING_MPS = 1.5  # LNDMC_XY_VEL_MAX: a vehicle whose estimated speed is higher counts as flying
SETTLED_S = 0.2  # contact time until it stands firmly
DISARMED_S = 0.05  # contact time with stopped rotors
# Delay from contact to detection, and its frequency: of 13 recorded landings 9 took 3.2 to 4 s, one 7.8 and one 22.5 s.
LANDED_DELAYS_S = ((0.7, 3.2, 4.0), (0.15, 2.0, 3.2), (0.1, 4.0, 8.0), (0.05, 8.0, 22.5))
NOTICED_DESCENDING_S = (1.0, 4.5)


class LandDetector:
    """Emulates the land detector of one PX4 vehicle.

    landed: its result. climbing_s: time since it noticed the takeoff. standing: truly on the ground. flown: a flight has begun
    since the last arming. landed_s: time at which the last landing was noticed.
    """

    def __init__(self, step_s: float, rng: np.random.Generator) -> None:
        self.landed = True
        self.standing = True
        self.flown = False
        self.climbing_s = 0.0
        self.landed_s = 0.0
        self._step_s, self._rng = step_s, rng
        self._wanted_s = self._contact_s = self._pressed_s = 0.0
        self._detect_s = self._notice_s = 0.0

    def arm(self) -> None:
        """Prepare for a takeoff, as the rotors start."""
        self.flown = False
        self._wanted_s = 0.0

    def rise(self, wants_up: bool) -> bool:
        """Emulate one time step of an armed vehicle that counts as landed; return True when the takeoff is noticed.

        ``wants_up``: the rotors turn, and the target is above the vehicle.
        """
        if not wants_up:
            self._wanted_s = 0.0
            return False
        if self._wanted_s == 0.0:
            self._detect_s = float(self._rng.uniform(*DETECTED_S))
        self._wanted_s += self._step_s
        if self._wanted_s < self._detect_s:
            return False
        self.landed, self.flown, self.climbing_s = False, True, 0.0
        return True

    def fly(self, contact: bool, wants_down: bool, noticeable: bool, mode: Mode) -> None:
        """Emulate one time step of a vehicle that counts as flying.

        wants_down: its target is below. noticeable: it descends in the way that the detector expects of a landing.
        """
        self.climbing_s += self._step_s
        pressed = contact and wants_down
        self._pressed_s = self._pressed_s + self._step_s if pressed else 0.0
        self.standing = self._pressed_s > SETTLED_S or (self.standing and self.climbing_s < RAMP_S)
        if not pressed or not noticeable:
            self._contact_s = 0.0
            return
        if self._contact_s == 0.0:
            self._notice_s = self._draw(mode)
        self._contact_s += self._step_s

    def notice(self, time_s: float, armed: bool) -> bool:
        """Return True when the landing is noticed."""
        if self._contact_s <= (self._notice_s if armed else DISARMED_S):
            return False
        self.landed, self.standing, self.landed_s = True, True, time_s
        self._contact_s = self._wanted_s = self._pressed_s = 0.0
        return True

    def _draw(self, mode: Mode) -> float:
        if mode is Mode.DESCEND:
            return float(self._rng.uniform(*NOTICED_DESCENDING_S))
        kind = int(self._rng.choice(len(LANDED_DELAYS_S), p=[share for share, _, _ in LANDED_DELAYS_S]))
        return float(self._rng.uniform(*LANDED_DELAYS_S[kind][1:]))
