"""A vehicle that has landed and stays armed: its autopilot does not disarm it (COM_DISARM_LAND), or has not noticed."""

from __future__ import annotations

from agent.vehicle.interface import VehicleState

STANDS_NS = 10_000_000_000  # PX4 disarms 2 s after a landing by default
WHAT = "has landed and is still armed, for {seconds:.0f} s: command land once more to disarm it, or disarm it by remote control"


class StandingArmed:
    """Of one drone. ``disarms``: an operator wants it disarmed, as long as it stands."""

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self.disarms = False

    def step(self, vehicle: VehicleState, now_ns: int, *, comes_down: bool) -> None:
        """Take the newest telemetry; ``comes_down``: in a stage in which it lands."""
        if not comes_down or vehicle.in_air or not vehicle.armed:
            self._since_ns, self.disarms = None, False
        elif self._since_ns is None or self._since_ns > now_ns:  # or the clock was set back
            self._since_ns = now_ns

    def ordered(self) -> None:
        """An operator has commanded to land: where it stands, it is to be disarmed."""
        self.disarms = self._since_ns is not None

    def problem(self, now_ns: int) -> str | None:
        """What the operator is told; None while it flies, or is about to be disarmed by its autopilot."""
        if self._since_ns is None or now_ns - self._since_ns < STANDS_NS:
            return None
        return WHAT.format(seconds=(now_ns - self._since_ns) * 1e-9)
