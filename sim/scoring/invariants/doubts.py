"""Conditions on the drones' position uncertainty: not smaller than their data allow, and accounted for in their plans."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from itertools import pairwise
from math import hypot, inf, pi, sqrt, tau

from radron.agent.navigation.reckoning import End
from radron.agent.pilot import Pilot
from radron.protocol.entries import Exposure
from radron.sim.faults.machines import Clock
from radron.sim.geometry import Array
from radron.sim.scoring.invariants.base import EXCLUDED_SIGMAS, LOOK_TICKS, Breach, Invariant, Setting
from radron.sim.scoring.moment import EPOCH_NS, Moment
from radron.sim.world.gnss import GnssTruth

EXCLUDED_M = 0.5
MIN_MEASUREMENTS = 4  # measurements of which half may exclude the truth: a clock's error times the speed of a moment is no bound
BOUND_S = 5.0
BERTH_SIGMAS, BERTH_S = 2.0, 3.0  # of the other's position; for so long a drone evading a third one may come nearer
# Margins within which an obstacle blocks the way out, beside the least distance. The second one: obstacles that do not give
# way, from which plans keep two metres more, and lines and circles that others may be behind.
_AWAY_M, _BLIND_AWAY_M = 1.0, 3.0
_LOW_M = 1.5  # a drone in takeoff or landing does not choose its way


class Mistimed(Invariant[Moment]):
    """Requires that measurements with a wrong clock are not placed wrongly in the estimate.

    At most half of a drone's measurements under a reported wrong clock are fused, at the end, at a wrong place. A place is wrong
    if it excludes the drone's true place at the stamped time, by 6 sigma and 0.5 m.

    Exempt are measurements after the first liar, the first unannounced fault of a drone's own position, or the first simultaneous
    jump of half of the clocks or more: the clocks of the other drones are the only time reference.
    """

    name = "mistimed"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._wrong = any(fault.family == "clock" for fault in setting.scenario.fault)
        self._until_s = min(setting.misled_s(("pose", "liar")), _outvoted_s(setting))
        self._times_s: list[float] = []
        self._places: list[Array] = []  # (N, 3) at these times

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Record the true places of the drones; yield nothing in flight."""
        if self._wrong and moment.time_s < self._until_s:
            self._times_s.append(moment.time_s)
            self._places.append(moment.position_m.copy())
        yield from ()

    def at_end(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones whose measurements are fused at wrong places, according to the first log available."""
        pilot = next((pilot for pilot in moment.pilots if pilot is not None), None)
        if not self._times_s or pilot is None:
            return
        excluded: dict[int, list[bool]] = {}
        for record in pilot.fusion.log:
            entry = record.entry
            if not isinstance(entry, Exposure) or entry.clock_sigma_m == 0.0:
                continue
            fused = pilot.fusion.place(entry.entry_id)
            time_s = (0.5 * (entry.stamp_ns + entry.end_ns) - EPOCH_NS) * 1e-9
            tick = bisect_right(self._times_s, time_s)
            if fused is not None and 0 < tick < len(self._times_s):
                drone = self.setting.names.index(entry.drone)
                (u, v, _), sigma_m = fused
                x, y, _ = self._places[tick][drone].tolist()
                excluded.setdefault(drone, []).append(hypot(u - x, v - y) > max(EXCLUDED_M, EXCLUDED_SIGMAS * sigma_m))
        for drone, found in excluded.items():
            if len(found) >= MIN_MEASUREMENTS and 2 * sum(found) > len(found):
                yield Breach((drone,), f"{sum(found)} of its {len(found)} measurements with a wrong clock exclude where it was")


def _outvoted_s(setting: Setting) -> float:
    """Return the first time at which half of the clocks or more jump at once, s; infinite if they never do."""
    jumps = (fault for fault in setting.scenario.fault if isinstance(fault, Clock) and fault.jump_s != 0.0)
    return min((jump.at_s for jump in jumps if 2 * len(setting.strikes(jump)) >= len(setting.names)), default=inf)


class PlaceBound(Invariant[Moment]):
    """Requires that no drone states its position for 5 s with a smaller uncertainty than its sources allow (estimated frames).

    The sources are satellite receivers and the launch layout: its own, or, with sightings, those of the whole swarm.

    A receiver's error is correlated for a minute (``GnssTruth``), whatever the rate of its fixes. For a flight of length T and a
    correlation time tau the best estimate of a constant has the information (1 + T / (2 tau)) / sigma^2 on each axis.
    """

    name = "place-bound"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        drones, vehicles = setting.mission.drones, setting.scenario.localization.vehicles
        self._judged = not any(drone.is_exact for drone in drones)
        receptions = [vehicles[drone.id].reception if drone.id in vehicles else None for drone in drones]
        self._sees = setting.scenario.sightings is not None
        self._sources = [(one, drone.origin_sigma_m) for one, drone in zip(receptions, drones, strict=True)]
        self._since_s: dict[int, float] = {}
        self._found: list[Breach] = []
        self._ticks = 0

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that are overconfident about their position; checked twice a second."""
        self._ticks += 1
        if self._judged and self._ticks % LOOK_TICKS == 0:
            self._found = list(self._too_sure(moment))
        yield from self._found

    def _too_sure(self, moment: Moment) -> Iterator[Breach]:
        each = [_information(reception, origin_m, moment.time_s) for reception, origin_m in self._sources]
        for drone, pilot in enumerate(moment.pilots):
            placed = pilot.whereabouts if pilot is not None else None
            bound_m = sqrt(2.0 / (sum(each) if self._sees else each[drone]))
            if placed is None or placed.sigma_m >= bound_m:
                self._since_s.pop(drone, None)
            elif moment.time_s - self._since_s.setdefault(drone, moment.time_s) > BOUND_S:
                yield Breach((drone,), f"it states its place to {placed.sigma_m:.2f} m, where {bound_m:.2f} m are possible")


class WideBerth(Invariant[Moment]):
    """Requires that no drone plans for 3 s to end up too near to another: within the separation plus 2 sigma of its position.

    The judgement uses the drone's own knowledge: the truth shows an ignored uncertainty only by chance, and too late. Exempt are:

    - pairs with a drone on the ground or nearly so;
    - other drones that do not know of it, which may appear anywhere;
    - a drone surrounded by other drones, or by lines and circles that it keeps behind: each way out leads too near to the next.
    """

    name = "berth"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._least_m = setting.mission.limits.separation_m
        self._planned_ns = [-1] * len(setting.names)
        self._since_s: dict[tuple[int, int], float] = {}
        self._over_m: dict[tuple[int, int], float] = {}

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the pairs of a planning drone and the drone that it comes too near to."""
        for drone, pilot in enumerate(moment.pilots):
            reckoning = pilot.reckoning if pilot is not None else None
            if reckoning is not None and reckoning.stamp_ns == self._planned_ns[drone]:
                continue
            self._planned_ns[drone] = reckoning.stamp_ns if reckoning is not None else -1
            clear_m = self._clearances_m(pilot)
            for other, name in enumerate(self.setting.names):
                high = min(moment.position_m[drone, 2], moment.position_m[other, 2]) > _LOW_M
                if not high or clear_m.get(name, inf) >= self._least_m:
                    self._since_s.pop((drone, other), None)
                else:
                    self._since_s.setdefault((drone, other), moment.time_s)
                    self._over_m[drone, other] = self._least_m - clear_m[name]
        for pair, since_s in self._since_s.items():
            if moment.time_s - since_s > BERTH_S:
                yield Breach(pair, f"it plans to come {self._over_m[pair]:.1f} m too near, where the other may be")

    def _clearances_m(self, pilot: Pilot | None) -> dict[str, float]:
        """Return the distances of the others from its plan's end, by id, m, each at its nearest expected place; empty if they
        surround the drone.
        """
        reckoning = pilot.reckoning if pilot is not None else None
        ends = reckoning.ends(BERTH_SIGMAS) if reckoning is not None else []
        if _all_around([one.bearing_rad for one in ends if one.clearance_m < self._least_m + _away_m(one)]):
            return {}
        nearest: dict[str, float] = {}
        for one in ends:
            if not one.blind:
                nearest[one.id] = min(one.clearance_m, nearest.get(one.id, inf))
        return nearest


def _away_m(one: End) -> float:
    return _BLIND_AWAY_M if one.blind else _AWAY_M


def _all_around(bearings_rad: list[float]) -> bool:
    """Return whether there is a bearing in every half of the directions, so that each way leads nearer to an obstacle."""
    ascending = sorted(bearings_rad)
    gaps_rad = [after - before for before, after in pairwise([*ascending, *(angle + tau for angle in ascending[:1])])]
    return bool(gaps_rad) and max(gaps_rad) < pi


def _information(reception: GnssTruth | None, origin_sigma_m: float, flown_s: float) -> float:
    """Return the Fisher information (1/m^2) of one axis of a drone's frame, from its receiver and the launch layout."""
    told = 1.0 / origin_sigma_m**2 if origin_sigma_m > 0.0 else inf
    if reception is None:
        return told
    return told + (1.0 + flown_s / (2.0 * reception.correlation_s)) / reception.horizontal_m**2
