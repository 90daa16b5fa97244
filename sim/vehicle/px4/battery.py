"""Battery model of an emulated vehicle: drained by hovering or by the electronics, or as in PX4's simulator on request."""

from __future__ import annotations

from enum import IntEnum

from radron.sim.vehicle.px4.parameters import Parameters

HOVER_A, IDLE_A = 15.0, 0.8
_FULL_V, _EMPTY_V = 4.1, 3.5  # of a cell, approximately linear between
_FILTER_S = 0.6  # filter of the autopilot's remaining charge
_DRAINS_BELOW = 50.0  # SIM_BAT_MIN_PCT's default: down to there this battery lasts as long as a real one


class Warning(IntEnum):
    """Battery warning levels of PX4, from none to emergency."""

    NONE = 0
    LOW = 1
    CRITICAL = 2
    EMERGENCY = 3


_LEVELS = (
    (Warning.LOW, "BAT_LOW_THR", 0.5),
    (Warning.CRITICAL, "BAT_CRIT_THR", 0.75),
    (Warning.EMERGENCY, "BAT_EMERGEN_THR", 2.6),
)  # parameter, and duration of its condition


class Battery:
    """Simulates one vehicle's battery in fixed time steps. dead: empty at once, by an injected failure."""

    def __init__(self, parameters: Parameters, step_s: float) -> None:
        self.cells = int(parameters["BAT1_N_CELLS"])
        self.used_mah = 0.0
        self.current_a = IDLE_A
        self.dead = False
        self.warning = Warning.NONE
        self._parameters = parameters
        self.capacity_mah = parameters["BAT1_CAPACITY"]
        self._step_s = step_s
        self._filtered = 1.0
        self._below_s = [0.0] * len(_LEVELS)

    def step(self, armed: bool, flying: bool) -> None:
        """Draw current from the battery for one time step."""
        self.current_a = HOVER_A if flying else IDLE_A
        used_mah = self.used_mah + self.current_a * self._step_s / 3.6
        least = self._parameters["SIM_BAT_MIN_PCT"]
        if least < _DRAINS_BELOW and not armed:
            used_mah = 0.0
        elif least < _DRAINS_BELOW:
            drained_mah = self.used_mah + self.capacity_mah * self._step_s / self._parameters["SIM_BAT_DRAIN"]
            used_mah = min(drained_mah, max(self.used_mah, self.capacity_mah * (1.0 - least / 100.0)))
        self.used_mah = min(self.capacity_mah, used_mah)
        left = 0.0 if self.dead else self.remaining
        self._filtered += self._step_s / _FILTER_S * (left - self._filtered)
        self._warn()

    def _warn(self) -> None:
        found = Warning.NONE
        for index, (level, name, least_s) in enumerate(_LEVELS):
            below = self._filtered < self._parameters[name]
            self._below_s[index] = self._below_s[index] + self._step_s if below else 0.0
            if self._below_s[index] > least_s:
                found = level
        self.warning = found

    @property
    def remaining(self) -> float:
        """Remaining charge, from 0 to 1."""
        return 1.0 - self.used_mah / self.capacity_mah

    @property
    def voltage_v(self) -> float:
        """Voltage of all cells together."""
        return self.cells * (_EMPTY_V + (_FULL_V - _EMPTY_V) * self.remaining)
