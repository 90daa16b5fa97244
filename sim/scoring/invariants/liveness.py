"""What must come about after the heal: the able drones agree, and everybody comes home."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot

from agent.vehicle.interface import FlightMode
from protocol.messages import Stage
from sim.faults.machines import Takeover
from sim.geometry import Array
from sim.scoring.invariants.able import Able
from sim.scoring.invariants.base import AT_HOME_M, Breach, Invariant, Setting
from sim.scoring.moment import Scene

AGREE_S = 20.0  # a log query every few seconds, and 5 s of backlog
_COMING_HOME = (Stage.RETURN, Stage.LANDING, Stage.LANDED)
_SEARCHING = frozenset((Stage.SURVEY, Stage.TRACK, Stage.REACQUIRE))


class Converged(Invariant[Scene]):
    """After the heal, the able drones have one digest and one hypothesis at least every 20 s, until the first of them comes home.

    While they measure, each new entry makes their logs differ until it has arrived everywhere.
    """

    name = "convergence"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._able = Able(setting)
        self._agreed_s = setting.heal_s
        self.ever = False  # they have agreed at least once since the heal, or there is nobody who could disagree

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """The able drones that have not agreed for too long."""
        able = self._able.see(moment)
        if moment.time_s < self.setting.heal_s or self._over(moment, able):
            return
        found = {self._belief(moment, drone) for drone in able}
        if len(found) <= 1:
            self._agreed_s, self.ever = moment.time_s, True
        elif moment.time_s - self._agreed_s > AGREE_S:
            digests, since_s = len({digest for digest, _ in found}), moment.time_s - self._agreed_s
            yield Breach(able, f"{digests} digests and {len(found)} beliefs {since_s:.0f} s after the last agreement")

    def _over(self, moment: Scene, able: tuple[int, ...]) -> bool:
        """Whether one of them does not search any more, after they have agreed."""
        return self.ever and any((pilot := moment.pilots[k]) is None or pilot.stage not in _SEARCHING for k in able)

    def _belief(self, moment: Scene, drone: int) -> tuple[str, object]:
        pilot = moment.pilots[drone]
        if pilot is None:
            return "", drone
        hypothesis = pilot.hypothesis
        return pilot.digest, None if hypothesis is None else hypothesis.position.tobytes()


class Landed(Invariant[Scene]):
    """The able drones end the mission landed, and at home; every other one has landed or returns, or its human pilot flies it.

    Exempt from home is who may land elsewhere, or was set down by its autopilot (``Setting``).
    """

    name = "landing"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.able = Able(setting)
        self._launch: Array | None = None

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """Nothing while it flies."""
        self.able.see(moment)
        if self._launch is None:
            self._launch = moment.position_m.copy()
        yield from ()

    def at_end(self, moment: Scene) -> Iterator[Breach]:
        """Those that are still out."""
        able = self.able.see(moment)
        for drone in range(len(self.setting.names)):
            if not self.is_home(moment, drone, drone in able):
                pilot, mode = moment.pilots[drone], moment.autopilots[drone].mode
                stage = "without an agent" if pilot is None else f"in stage {pilot.stage}"
                yield Breach((drone,), f"{moment.position_m[drone, 2]:.1f} m above ground, {stage}, mode {mode}")
            elif drone in able and (away_m := self._away_m(moment, drone)) > AT_HOME_M:
                yield Breach((drone,), f"landed {away_m:.1f} m from where it took off")

    def _away_m(self, moment: Scene, drone: int) -> float:
        """Horizontal distance from the place of its launch; 0 for who is exempt."""
        setting, time_s = self.setting, moment.time_s
        if self._launch is None or setting.may_land_elsewhere(drone, time_s) or setting.was_set_down(drone, time_s):
            return 0.0
        return hypot(*(moment.position_m[drone, :2] - self._launch[drone, :2]).tolist())

    def is_over(self, moment: Scene) -> bool:
        """Whether nothing more is to be expected of the flight."""
        able = self.able.see(moment)
        return self.able.drones is not None and all(
            self.is_home(moment, drone, drone in able) for drone in range(len(self.setting.names))
        )

    def is_home(self, moment: Scene, drone: int, able: bool) -> bool:
        """Whether a drone has ended its flight as it must."""
        autopilot, pilot = moment.autopilots[drone], moment.pilots[drone]
        if not moment.airborne(drone) and not autopilot.armed:
            return True
        if able:
            return False
        returns = autopilot.mode in (FlightMode.RETURN, FlightMode.LAND) or (pilot is not None and pilot.stage in _COMING_HOME)
        return returns or self._is_flown_by_hand(moment.time_s, drone)

    def _is_flown_by_hand(self, time_s: float, drone: int) -> bool:
        name, faults = self.setting.names[drone], self.setting.scenario.fault
        return any(
            isinstance(fault, Takeover) and name in fault.strikes(self.setting.names) and fault.at_s <= time_s for fault in faults
        )
