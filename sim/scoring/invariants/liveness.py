"""Condition on the end of a flight after faults: all drones return."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import hypot

from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Stage
from radron.protocol.stages import RETURNING
from radron.sim.faults.machines import Battery
from radron.sim.geometry import Array
from radron.sim.scoring.invariants.able import Able
from radron.sim.scoring.invariants.base import AT_HOME_M, Breach, Invariant, Setting
from radron.sim.scoring.moment import Scene
from radron.sim.vehicle.autopilot import DISARM_AFTER_S, LANDING_SPEED_MPS, RETURN_CLIMB_MPS
from radron.sim.vehicle.px4.battery import HOVER_A

_WAY_S = 50.0 / 3.0  # home across the area, with evasions
_URGENT = (
    0.5  # of the mission's reserve: with less in its battery an agent may land where it is (``radron.agent.mission.reserve``)
)
_ACTS_BELOW = 0.07  # the level at which an autopilot acts (BAT_CRIT_THR): a vehicle without a home lands
_HOVER_PS = HOVER_A / 3.6 / 5000.0  # share of a battery (BAT1_CAPACITY) drawn in flight in a second


class Landed(Invariant[Scene]):
    """Requires that the drones able to finish the mission end it landed, and at home.

    Every other drone has landed or returns; or its safety pilot flies it; or it holds by the mission's choice
    (``safety.agent_lost``), without its agent or with a possibly lost state. Exempt from home are drones that may land elsewhere,
    or were set down by their autopilot (``Setting``). Also exempt are drones with a battery report so low that agent or autopilot
    may have landed them where they were.
    """

    name = "landing"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.able = Able(setting)
        self._coming_home_since_s: float | None = None  # all drones have nothing left to do but return
        self._launch: Array | None = None
        highest_m = max(setting.mission.return_heights_m)
        self.lands_within_s = _WAY_S + highest_m / RETURN_CLIMB_MPS + highest_m / LANDING_SPEED_MPS + DISARM_AFTER_S

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """Record the launch places; yield nothing in flight."""
        self.able.see(moment)
        if self._launch is None:
            self._launch = moment.position_m.copy()
        yield from ()

    def at_end(self, moment: Scene) -> Iterator[Breach]:
        """Yield each drone that has not landed, or has landed away from its launch place."""
        able = self.able.see(moment)
        for drone in range(len(self.setting.names)):
            if not self.is_home(moment, drone, drone in able):
                pilot, mode = moment.pilots[drone], moment.autopilots[drone].mode
                stage = "without an agent" if pilot is None else f"in stage {pilot.stage}"
                yield Breach((drone,), f"{moment.position_m[drone, 2]:.1f} m above ground, {stage}, mode {mode}")
            elif drone in able and (away_m := self._away_m(moment, drone)) > AT_HOME_M:
                yield Breach((drone,), f"landed {away_m:.1f} m from where it took off")

    def _away_m(self, moment: Scene, drone: int) -> float:
        """Return the horizontal distance from the launch place, m; 0 for an exempt drone."""
        setting, time_s = self.setting, moment.time_s
        if self._launch is None or setting.may_land_elsewhere(drone, time_s) or setting.was_set_down(drone, time_s):
            return 0.0
        if _lands_for_want_of_battery(setting, drone, time_s):
            return 0.0
        return hypot(*(moment.position_m[drone, :2] - self._launch[drone, :2]).tolist())

    def is_over(self, moment: Scene) -> bool:
        """Return whether the flight can be ended: every drone has ended it correctly, and is down or stays up for good.

        After ``lands_within_s``, the time to land from the highest return, landings are no longer awaited: a drone on its return
        then counts as correct.
        """
        able, drones = self.able.see(moment), range(len(self.setting.names))
        if self.able.drones is None or not all(self.is_home(moment, drone, drone in able) for drone in drones):
            self._coming_home_since_s = None
            return False
        if self._coming_home_since_s is None:
            self._coming_home_since_s = moment.time_s
        lands = (drone for drone in drones if not self._stays_up(moment, drone))
        within = moment.time_s - self._coming_home_since_s < self.lands_within_s
        return not within or all(_is_down(moment, drone) for drone in lands)

    def is_home(self, moment: Scene, drone: int, able: bool) -> bool:
        """Return whether a drone has ended its flight correctly. ``able``: the drone must finish the mission."""
        autopilot, pilot = moment.autopilots[drone], moment.pilots[drone]
        if _is_down(moment, drone):
            return True
        if able:
            return False
        returns = autopilot.mode in (FlightMode.RETURN, FlightMode.LAND) or (
            pilot is not None and pilot.stage in (*RETURNING, Stage.LANDED)
        )
        return returns or self._stays_up(moment, drone)

    def _stays_up(self, moment: Scene, drone: int) -> bool:
        """Return whether an unable drone may stay up for good: it holds without its agent, or a safety pilot flies it."""
        left = self.setting.mission.safety.agent_lost == "hold" and moment.pilots[drone] is None
        holds = moment.autopilots[drone].mode is FlightMode.HOLD and (left or drone in self.able.without_state)
        return holds or self.setting.taken_over(drone, moment.time_s)


def _is_down(moment: Scene, drone: int) -> bool:
    return not moment.airborne(drone) and not moment.autopilots[drone].armed


def _lands_for_want_of_battery(setting: Setting, drone: int, time_s: float) -> bool:
    """Return whether the battery of a drone may have reported, by a fault, a level at which it lands where it is."""
    name = setting.names[drone]
    faults = [
        one for one in setting.scenario.fault if isinstance(one, Battery) and one.at_s <= time_s and name in setting.strikes(one)
    ]
    urgent = _URGENT * setting.mission.safety.battery_reserve
    return any(_lowest(one, faults, time_s) < max(urgent, _ACTS_BELOW if one.acts else 0.0) for one in faults)


def _lowest(battery: Battery, faults: Sequence[Battery], time_s: float) -> float:
    """Return the lowest level that a faulted battery may have reported by now, in flight all the time; ``faults``: of the
    same drone.
    """
    until_s = min(time_s, battery.end_s) if battery.lies else time_s
    spans = ((one, min(until_s, one.end_s) - max(battery.at_s, one.at_s)) for one in faults)
    faster = sum(one.drain_ps * max(0.0, span_s) for one, span_s in spans)
    return battery.level - faster - _HOVER_PS * (until_s - battery.at_s)
