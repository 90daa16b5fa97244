"""How long a vehicle has not followed its agent, as the operator is told."""

from __future__ import annotations

from agent.vehicle.interface import FlightMode

UNSTEERED_NS = 3_000_000_000  # after this long it is told


class Unsteered:
    """Of one drone: since when somebody else has flown it, or the autopilot has not been in offboard where it should be."""

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self._mode = FlightMode.HOLD

    def begin(self) -> None:
        """The operator has commanded: what was before does not count."""
        self._since_ns = None

    def step(self, mode: FlightMode, now_ns: int, *, steered: bool, released: bool) -> None:
        """Take the autopilot's mode; ``steered``: the agent wants it in offboard; ``released``: somebody else flies it."""
        self._mode = mode
        if not released and (not steered or mode is FlightMode.OFFBOARD):
            self._since_ns = None
        elif self._since_ns is None or self._since_ns > now_ns:  # or the clock was set back
            self._since_ns = now_ns

    def problem(self, now_ns: int, *, released: bool) -> str | None:
        """What is told; None while it follows, or has not failed to for long."""
        if self._since_ns is None or now_ns - self._since_ns < UNSTEERED_NS:
            return None
        lasts = f"for {(now_ns - self._since_ns) * 1e-9:.0f} s"
        if released:
            return f"under the control of a human pilot or of its failsafe: the autopilot has been in {self._mode} {lasts}"
        return f"not following its mission: the autopilot has been in {self._mode}, not in offboard, {lasts}"
