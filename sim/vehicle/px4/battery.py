"""A battery that empties: by what hovering takes, or the electronics alone."""

from __future__ import annotations

HOVER_A, IDLE_A = 15.0, 0.8
_FULL_V, _EMPTY_V = 4.1, 3.5  # of a cell, roughly linear between


class Battery:
    """One vehicle's battery, advanced in fixed steps."""

    def __init__(self, capacity_mah: float, cells: int, step_s: float) -> None:
        self.cells = cells
        self.used_mah = 0.0
        self.current_a = IDLE_A
        self._capacity_mah = capacity_mah
        self._step_s = step_s

    def step(self, flying: bool) -> None:
        """Draw current for one step."""
        self.current_a = HOVER_A if flying else IDLE_A
        self.used_mah = min(self._capacity_mah, self.used_mah + self.current_a * self._step_s / 3.6)

    @property
    def remaining(self) -> float:
        """0 .. 1."""
        return 1.0 - self.used_mah / self._capacity_mah

    @property
    def voltage_v(self) -> float:
        """Of all cells."""
        return self.cells * (_EMPTY_V + (_FULL_V - _EMPTY_V) * self.remaining)
