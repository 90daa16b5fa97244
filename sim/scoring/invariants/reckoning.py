"""Conditions on the drones' predictions in flight: positions of other drones, own room to fly, and fresh telemetry."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import dist, inf

import shapely
from shapely import Polygon

from radron.agent.pilot import Pilot
from radron.sim.faults.agents import Late
from radron.sim.faults.base import Family
from radron.sim.geometry import Array, Vector3
from radron.sim.scoring.invariants.base import Breach, Invariant, Setting
from radron.sim.scoring.moment import Moment

ACCOUNTED_M = 15.0  # farther vehicles need not be accounted for yet
LAYER_M = 2.5  # vehicles with this height difference may be passed
FARTHER_M, DISTANCE_SIGMAS = 4.0, 3.0  # excess of the believed distance: twice the margin of plans, and the position uncertainty
UNRECKONED_S = 1.5  # a lost peer is accounted for after a second, and ways around others change
ROOM_M, WIDE_S = 1.0, 1.0  # the room follows the estimated frame in steps of 0.3 m
UNTOLD_S = 1.5  # agents fly by telemetry that is up to a second old
_ELSEWHERE: tuple[Family, ...] = ("liar", "pose", "thrust")  # faults with a published wrong place
_LOW_M = 1.5  # a lower vehicle may estimate that it has landed
_HOME_M = 3.0  # so near to its home a revoked drone descends


class Reckoned(Invariant[Moment]):
    """Requires that a drone that flies by setpoints does not take another drone to be farther away than it is.

    This holds with or without a link to the other drone. The limit is 4 m and 3 sigma, for 1.5 s, of vehicles less than 15 m away
    and at its height. A vehicle less than 4 m before a line or circle that the drone keeps from is within the limit. The source
    estimate of a lost peer is unknown: if that peer circles its own estimate, it has to be beyond that circle, or less than 4 m
    before it.

    Exempt are:

    - drones with a fault of their own position or thrust, and liars;
    - late or restarted agents: they may never have had links to other drones;
    - drones with an unknown own position: reports of other drones have no meaning before the first sighting;
    - pairs with a revoked drone, if the other's agent was lost, or was revoked too, after their last contact: nobody can know
      that its vehicle leaves a circle, and climbs to the other's height;
    - a revoked drone that descends at its home: other drones keep clear of it.

    After the last contact of a pair with a revoked drone, a fault of the other's own position is unknown too: the drone may then
    expect the other at its own position estimate instead.
    """

    name = "reckoned"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        late = [fault for fault in setting.scenario.fault if isinstance(fault, Late)]
        self._late = {setting.names.index(name) for fault in late for name in setting.strikes(fault)}
        self._home_m = [drone.origin_m[:2] for drone in setting.mission.drones]
        self._lost_s: dict[int, float] = {}  # begin of the agents' present absence
        self._misled_s: dict[int, float] = {}  # end of the faults of own positions
        for fault in setting.scenario.fault:
            for name in setting.strikes(fault) if fault.family == "pose" else ():
                drone = setting.names.index(name)
                self._misled_s[drone] = max(fault.end_s, self._misled_s.get(drone, -inf))
        self._first: list[Pilot | None] = [None] * len(setting.names)
        self._since_s: dict[tuple[int, int], float] = {}
        self._found: dict[tuple[int, int], str] = {}
        self._believed: dict[tuple[int, int], tuple[object, list[float]]] = {}

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the pairs of a drone and the other drone that it does not account for."""
        for drone, pilot in enumerate(moment.pilots):
            if self._first[drone] is None:
                self._first[drone] = pilot
            if pilot is None:
                self._lost_s.setdefault(drone, moment.time_s)
            else:
                self._lost_s.pop(drone, None)
        places = [(x, y, z) for x, y, z in moment.position_m.tolist()]
        for drone in range(len(moment.pilots)):
            judged = list(self._judged(moment, places, drone))
            for other in range(len(moment.pilots)):
                if other != drone:
                    farther_m = self._farther_m(places, drone, other, moment.pilots) if other in judged else 0.0
                    self._note(moment.time_s, places, drone, other, farther_m)
        for pair, since_s in self._since_s.items():
            if moment.time_s - since_s > UNRECKONED_S:
                yield Breach(pair, self._found[pair])

    def _judged(self, moment: Moment, places: Sequence[Vector3], drone: int) -> Iterator[int]:
        """Yield the others that a drone has to account for."""
        pilot = moment.pilots[drone]
        if pilot is None or moment.autopilots[drone].setpoint_age_s is None:
            return
        if moment.time_s > self.setting.unheard_s(drone) and dist(places[drone][:2], self._home_m[drone]) < _HOME_M:
            return
        near = [other for other in range(len(places)) if other != drone and _is_near(places, drone, other)]
        if not near or self._is_exempt(moment, drone) or pilot.reckoning is None or pilot.whereabouts is None:
            return
        for other in near:
            if not self._is_exempt(moment, other) and not self._left_unheard(drone, other):
                yield other

    def _is_exempt(self, moment: Moment, drone: int) -> bool:
        """Return whether the drone publishes a wrong place, or may have had no links to the others."""
        pilot = moment.pilots[drone]
        is_new = drone in self._late or (pilot is not None and pilot is not self._first[drone])
        return is_new or self.setting.struck(_ELSEWHERE, drone, moment.time_s, 15.0)

    def _note(self, time_s: float, places: Sequence[Vector3], drone: int, other: int, farther_m: float) -> None:
        """Note the excess of a pair. ``farther_m``: as in ``_farther_m``; 0 without judgement."""
        if farther_m <= 0.0:
            self._since_s.pop((drone, other), None)
            return
        self._since_s.setdefault((drone, other), time_s)
        taken = "does not reckon with it" if farther_m == inf else f"takes it for {farther_m:.1f} m farther away"
        self._found[drone, other] = f"{_apart_m(places, drone, other):.1f} m from the other, and {taken}"

    def _farther_m(self, places: Sequence[Vector3], drone: int, other: int, pilots: Sequence[Pilot | None]) -> float:
        """Return the excess of the believed distance over the permitted one, m."""
        pilot = pilots[drone]
        if pilot is None or (reckoning := pilot.reckoning) is None:
            return 0.0
        near = self._knowable(drone, other, places[other], pilots[other])
        judged, believed_m = self._believed.get((drone, other), (None, []))
        if judged is not reckoning:  # computed once for each plan
            believed_m = [self._believed_m(pilot, other, pilots[other], place) for place in near]
            self._believed[drone, other] = reckoning, believed_m
        mine = places[drone][:2]  # the plan may be older than the alternative place
        return min(one_m - dist(mine, place[:2]) for one_m, place in zip(believed_m, near, strict=False)) - FARTHER_M

    def _believed_m(self, pilot: Pilot, other: int, other_pilot: Pilot | None, place: Vector3) -> float:
        """Return the believed distance to another drone, which is at ``place``, m; infinite if it is not accounted for."""
        if (reckoning := pilot.reckoning) is None:
            return inf
        theirs = _around_source_of(pilot, other_pilot, place)
        if theirs is not None and reckoning.keeps_from_circle(theirs, FARTHER_M):
            return 0.0
        return reckoning.distance_m(self.setting.names[other], DISTANCE_SIGMAS, place, FARTHER_M)

    def _knowable(self, drone: int, other: int, place: Vector3, other_pilot: Pilot | None) -> list[Vector3]:
        """Return the permitted predictions of another drone at ``place``: that place; and the other's own position estimate,
        if that was wrong after the last contact of the two.
        """
        is_misled = other in self._misled_s and self._misled_s[other] > self.setting.unheard_s(drone, other)
        told = other_pilot.whereabouts if is_misled and other_pilot is not None else None
        return [place] if told is None else [place, told.place_m]

    def _left_unheard(self, drone: int, other: int) -> bool:
        """Return whether the other's agent was lost, or the other was revoked, after the last contact of the two."""
        unheard_s = self.setting.unheard_s(drone, other)
        return self._lost_s.get(other, -inf) > unheard_s or self.setting.revoked_s.get(other, -inf) > unheard_s


class Confined(Invariant[Moment]):
    """Requires that the region in which a drone permits itself to fly lies inside the mission's fence.

    The tolerance is a metre; the region is taken in the drone's estimated frame.
    """

    name = "confined"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        area = setting.mission.area
        self._fence = Polygon(area.polygon_m).buffer(area.fence_margin_m + ROOM_M)
        shapely.prepare(self._fence)
        self._since_s: dict[int, float] = {}
        self._over: dict[int, tuple[object, object, float]] = {}

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that permit themselves to fly too far beyond the fence."""
        outside = {
            drone: over_m
            for drone, pilot in enumerate(moment.pilots)
            if pilot is not None and (over_m := self._over_m(drone, pilot)) > 0.0
        }
        self._since_s = {drone: self._since_s.get(drone, moment.time_s) for drone in outside}
        for drone, since_s in self._since_s.items():
            if moment.time_s - since_s > WIDE_S:
                yield Breach((drone,), f"it may fly {outside[drone] + ROOM_M:.1f} m beyond the fence")

    def _over_m(self, drone: int, pilot: Pilot) -> float:
        """Return the excess of the room over the permitted one, m; computed once for each room and frame, which many plans
        share.
        """
        if (reckoning := pilot.reckoning) is None:
            return 0.0
        room, frame, over_m = self._over.get(drone, (None, None, 0.0))
        if room is not reckoning.room or frame is not reckoning.mission_from_local:
            over_m = self._beyond_m(reckoning.corners_m)
            self._over[drone] = reckoning.room, reckoning.mission_from_local, over_m
        return over_m

    def _beyond_m(self, corners: Array | None) -> float:
        """Return the distance of the farthest of these corners outside, m."""
        if corners is None or shapely.contains_xy(self._fence, corners).all():
            return 0.0
        return float(shapely.distance(self._fence, shapely.points(corners)).max())


class FreshTelemetry(Invariant[Moment]):
    """Requires that no agent steers its vehicle by telemetry older than 1.5 s, as the vehicle may be anywhere."""

    name = "telemetry-age"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that are steered by telemetry that is too old."""
        for drone, (command, told_s) in enumerate(zip(moment.commands, moment.told_s, strict=True)):
            if command is not None and command.setpoint is not None and moment.time_s - told_s > UNTOLD_S:
                yield Breach((drone,), f"flown by telemetry of {moment.time_s - told_s:.1f} s ago")


def _around_source_of(pilot: Pilot, other: Pilot | None, place: Vector3) -> Vector3 | None:
    """Return the other's place relative to its own source estimate, moved to this drone's estimate; None without both
    estimates.
    """
    if other is None or pilot.hypothesis is None or other.hypothesis is None:
        return None
    dx, dy, _ = (pilot.hypothesis.position - other.hypothesis.position).tolist()
    return place[0] + dx, place[1] + dy, place[2]


def _is_near(places: Sequence[Vector3], drone: int, other: int) -> bool:
    """Return whether another vehicle is in the air near a drone."""
    mine_m, theirs_m = places[drone][2], places[other][2]
    return theirs_m >= _LOW_M and abs(mine_m - theirs_m) <= LAYER_M and _apart_m(places, drone, other) <= ACCOUNTED_M


def _apart_m(places: Sequence[Vector3], drone: int, other: int) -> float:
    """Return the true horizontal distance, m."""
    return dist(places[drone][:2], places[other][:2])
