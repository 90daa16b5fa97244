"""Return for want of battery: one drone after the other, so that the source is not left by all at once."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from msgspec import Struct

from radron.agent.vehicle.interface import VehicleState
from radron.protocol.messages import Status
from radron.protocol.stages import ON_GROUND, RETURNING

_URGENT = 0.5  # of the reserve: with less at landing a drone does not wait for others
_SPENT = 0.2  # of the reserve: with less at landing a drone lands on the spot
_LANDING_S = 10.0
_SPAN_NS = 5_000_000_000  # over a shorter time the rate is not known
_STEP = 0.01  # of the level by some autopilots: the drain may be less by this
_SURE_NS = 2_000_000_000  # a level that is low for a moment only does not count


class Reserve(Struct, frozen=True):
    """The battery of one drone against the mission's reserve. ``low``: since when it has been below (ns), and the level then.
    ``is_low``: it is below for sure; ``is_spent``: it does not last for the way home, at the rate at which it has drained since;
    ``returns``: the drone is to return now.
    """

    drone: str
    reserve: float
    low: tuple[int, float] | None = None
    is_low: bool = False
    is_spent: bool = False
    returns: bool = False

    def observed(
        self,
        now_ns: int,
        vehicle: VehicleState | None,
        statuses: Mapping[str, Status],
        unheard: Collection[str] = (),
        way_home_s: float = 0.0,
    ) -> Reserve:
        """Take the newest level. ``statuses``: of the others, with a link; ``unheard``: drones that may be on their way home
        without their agents; ``way_home_s``: duration of the own way home.

        The drone waits for drones on their way home, and for drones with a smaller id and a low battery, but no longer than the
        drain of its battery since it is low allows.
        """
        level = vehicle.battery if vehicle is not None else None
        if level is None or level >= self.reserve:
            return Reserve(self.drone, self.reserve)
        since_ns, then = low = (now_ns, level) if self.low is None else self.low
        if now_ns - since_ns < _SURE_NS:
            return Reserve(self.drone, self.reserve, low)
        drain_ps = max(0.0, then - level - _STEP) / ((now_ns - since_ns) * 1e-9) if now_ns - since_ns >= _SPAN_NS else 0.0
        at_home = level - drain_ps * (way_home_s + _LANDING_S)
        is_spent = at_home < _SPENT * self.reserve and level < _URGENT * self.reserve
        is_next = not (unheard or any(map(self._goes_first, statuses.values())))
        return Reserve(self.drone, self.reserve, low, True, is_spent, at_home < _URGENT * self.reserve or is_next)

    def _goes_first(self, other: Status) -> bool:
        if other.stage in ON_GROUND:
            return False
        low = other.battery is not None and other.battery < self.reserve
        return other.stage in RETURNING or (low and other.drone < self.drone)
