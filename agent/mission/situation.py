"""The inputs of a decision on the stage of a mission."""

from __future__ import annotations

from math import inf

from msgspec import Struct

from radron.agent.vehicle.interface import VehicleState
from radron.protocol.texts import CodedText


class Situation(Struct, frozen=True):
    """The inputs of a decision. ``last_cone_ns``: stamp of the newest cone in the log, of any drone; 0 where there is none.

    ``at_home``: the drone hovers over the place where it took off. ``problems``: obstacles to a start. ``rms_m``: of the source
    estimate, by an estimator with a posterior; else None. ``nothing_found``: the search has ended without a source.
    ``searches_on``: for sources beside the found ones. ``looks``: a verification pass at one of them, whether it moves.
    ``stranded_s``: delay before a return, because links are lost, and the mission or the fence leaves no other choice; or because
    the position uncertainty is too large, or the position never known; else infinite. ``revoked``: an operator has excluded this
    drone from the swarm. ``battery_low``: this drone's turn to return for want of battery; ``battery_spent``: not enough for the
    way home. ``no_nearer``: its return has made no progress for long.
    """

    now_ns: int
    vehicle: VehicleState | None
    has_hypothesis: bool
    last_cone_ns: int
    at_home: bool
    problems: tuple[CodedText, ...] = ()
    rms_m: float | None = None
    nothing_found: bool = False
    stranded_s: float = inf
    revoked: bool = False
    battery_low: bool = False
    battery_spent: bool = False
    no_nearer: bool = False
    searches_on: bool = False
    looks: bool = False

    @property
    def must_return(self) -> bool:
        """Whether the drone is to end its search, or its hold, and return."""
        return self.battery_low or self.revoked

    @property
    def is_found(self) -> bool:
        """Whether a found source is to be tracked now."""
        return self.has_hypothesis and not self.searches_on
