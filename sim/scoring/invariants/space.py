"""Conditions on the vehicles' true positions: separated, inside the fence, between floor and ceiling."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from math import dist, inf

import shapely
from shapely import Polygon

from radron.protocol.stages import SEARCHING
from radron.sim.faults.agents import CopiedKey
from radron.sim.faults.machines import Takeover
from radron.sim.scoring.invariants.base import Breach, Invariant, Setting
from radron.sim.scoring.moment import Scene

MIN_SEPARATION_M, MIN_SEPARATION_UNDER_FAULTS_M, NEAR_COLLISION_M = 3.0, 2.5, 2.0
ONTO_M = 1.5  # contact distance to a vehicle on the ground: less than in the air, as only one of the two moves


class Separation(Invariant[Scene]):
    """Requires that two vehicles in the air are 3 m apart, 2.5 m from the first fault on: no rotor touches another in any gust.

    A copied key is no excuse, nor is a manual override at that time: only messages are false. The distance is that in space:
    vehicles whose autopilots return by themselves fly in altitude layers. Exempt are pairs with a fault of one vehicle's own
    position or thrust: it does not know, or cannot control, its place.
    """

    name = "separation"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.least_m = inf  # of all pairs that are not exempt
        self._pairs = list(combinations(range(len(setting.names)), 2))
        faults = setting.scenario.fault
        is_copied = any(isinstance(fault, CopiedKey) for fault in faults)
        excusing = (fault.at_s for fault in faults if not (is_copied and isinstance(fault, CopiedKey | Takeover)))
        self._excused_s = min(excusing, default=inf)

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """Yield the pairs of vehicles that are too near to each other."""
        apart_m = MIN_SEPARATION_M if moment.time_s < self._excused_s else MIN_SEPARATION_UNDER_FAULTS_M
        for pair, distance_m in self._near(moment, max(apart_m, self.least_m)):
            self.least_m = min(self.least_m, distance_m)
            if distance_m < apart_m:
                yield Breach(pair, f"{distance_m:.2f} m apart, at least {apart_m:g} m wanted")

    def _near(self, moment: Scene, within_m: float, in_air: int = 2) -> Iterator[tuple[tuple[int, int], float]]:
        """Yield the pairs within a distance, so many of each in the air, without the exempt ones."""
        places = moment.position_m.tolist()
        for pair in self._pairs:
            one, other = pair
            distance_m = dist(places[one], places[other])
            if distance_m >= within_m or sum(map(moment.airborne, pair)) != in_air:
                continue
            if not any(self.setting.lost_itself(drone, moment.time_s) for drone in pair):
                yield pair, distance_m


class Collision(Separation):
    """Requires that two vehicles in the air are never within 2 m of each other, where rotors of small vehicles may touch.

    No vehicle may come within 1.5 m of another on the ground, as in landing on it or taking off beside it.
    """

    name = "collision"

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """Yield the pairs of vehicles that have collided."""
        for pair, distance_m in self._near(moment, NEAR_COLLISION_M):
            yield Breach(pair, f"{distance_m:.2f} m apart")
        for pair, distance_m in self._near(moment, ONTO_M, in_air=1):
            yield Breach(pair, f"{distance_m:.2f} m apart, one of them on the ground")


class Fence(Invariant[Scene]):
    """Requires that no vehicle in the air leaves the area by more than the fence's margin; exempt as in :class:`Separation`."""

    name = "fence"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        area = setting.mission.area
        self._fence = Polygon(area.polygon_m).buffer(area.fence_margin_m)
        shapely.prepare(self._fence)

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """Yield the vehicles outside the fence."""
        inside = shapely.contains_xy(self._fence, moment.position_m[:, :2])
        if inside.all():
            return
        for drone in (~inside).nonzero()[0].tolist():
            if moment.airborne(drone) and not self.setting.lost_itself(drone, moment.time_s):
                x, y, _ = moment.position_m[drone].tolist()
                yield Breach((drone,), f"at ({x:.1f}, {y:.1f}) m, outside the fence")


class Heights(Invariant[Scene]):
    """Requires that vehicles stay below the ceiling, and above the floor while they follow setpoints.

    Exempt as in :class:`Separation`.
    """

    name = "height"

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """Yield the vehicles that are too low or too high."""
        area = self.setting.mission.area
        for drone, height_m in enumerate(moment.position_m[:, 2].tolist()):
            if area.floor_m <= height_m <= area.ceiling_m:
                continue
            pilot = moment.pilots[drone]
            guided = pilot is not None and pilot.stage in SEARCHING and moment.autopilots[drone].setpoint_age_s is not None
            low = guided and height_m < area.floor_m
            if (low or height_m > area.ceiling_m) and not self.setting.lost_itself(drone, moment.time_s):
                yield Breach((drone,), f"{height_m:.2f} m above ground, {area.floor_m:g} to {area.ceiling_m:g} m allowed")
