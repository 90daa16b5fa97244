"""Return for want of battery: one drone after the other, so that the source is not left by all at once."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from agent.vehicle.interface import VehicleState
from protocol.messages import Stage, Status

_COMING_HOME = (Stage.RETURN, Stage.LANDING)
_ON_GROUND = (Stage.PREFLIGHT, Stage.LANDED)
_URGENT = 0.5  # share of the reserve below which a drone waits for nobody
_SURE_NS = 2_000_000_000  # a level that is low for a moment only is not believed


class Reserve:
    """The battery of one drone against the mission's reserve. ``is_low``: it is below."""

    def __init__(self, drone: str, reserve: float) -> None:
        self._drone, self._reserve = drone, reserve
        self._since_ns: int | None = None
        self.is_low = False

    def returns(
        self, now_ns: int, vehicle: VehicleState | None, statuses: Mapping[str, Status], unheard: Collection[str] = ()
    ) -> bool:
        """Whether this drone is to return now. ``statuses``: of the others that are heard; ``unheard``: drones that may
        be on their way home without their agents.

        It waits for those that are on their way home, and for those with a smaller id whose batteries are low too.
        """
        level = vehicle.battery if vehicle is not None else None
        if level is None or level >= self._reserve:
            self._since_ns, self.is_low = None, False
            return False
        self._since_ns = now_ns if self._since_ns is None else self._since_ns
        self.is_low = now_ns - self._since_ns >= _SURE_NS
        return self.is_low and (level < _URGENT * self._reserve or not (unheard or any(map(self._goes_first, statuses.values()))))

    def _goes_first(self, other: Status) -> bool:
        if other.stage in _ON_GROUND:
            return False
        low = other.battery is not None and other.battery < self._reserve
        return other.stage in _COMING_HOME or (low and other.drone < self._drone)
