"""One random mission with faults: flown, judged, and summed up in a line."""

from __future__ import annotations

import time
import traceback
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from msgspec import Struct

from radron.protocol.stages import SEARCHING
from radron.sim.campaign.faults.attacks import attack
from radron.sim.campaign.faults.course import ATTACKED, DEALT, FULL, LIVE, Course
from radron.sim.campaign.faults.dealt import deal
from radron.sim.campaign.faults.draw import draw
from radron.sim.campaign.faults.recording import Recording
from radron.sim.scenario import parse_scenario
from radron.sim.scoring.invariants.base import Setting, Violation
from radron.sim.scoring.invariants.judge import Judge
from radron.sim.scoring.moment import Hypothesis, Scene

LOCATED_M = 2.0
EXCEPTION = "exception"
_DOCUMENTS = {DEALT: deal, LIVE: deal, ATTACKED: attack}  # other courses draw their missions
_RECORDED_EVERY = 10  # one drone is recorded and replayed in one mission of this many


@dataclass(frozen=True, slots=True)
class Mission:
    """A random mission with faults, as a job of a campaign.

    ``document``: content of a scenario file, flown instead of the mission drawn from the seed. ``until``: name of the condition
    whose violation ends the flight (see ``Judge``).
    """

    seed: int
    course: Course = FULL
    document: dict[str, Any] | None = None
    until: str | None = None

    @property
    def label(self) -> str:
        """All that is needed to repeat the mission."""
        return f"seed {self.seed}"

    @property
    def drawn(self) -> dict[str, Any]:
        """Content of the scenario file that is flown."""
        if self.document is not None:
            return self.document
        return _DOCUMENTS.get(self.course, draw)(self.seed, self.course)


class Verdict(Struct, frozen=True, kw_only=True):
    """Result of a random mission with faults: a line of ``missions.jsonl``.

    faults: entries of the scenario. able: number of drones able to finish the mission after the faults have ended (heal).
    located: their source estimates were off by less than 2 m at the end of the last tracking; error_m: the largest of these
    errors, None without able drones or with a missing estimate. converged: all able drones held one log and one estimate after
    the heal. min_separation_m: smallest distance between two vehicles in the air, except vehicles with a fault of their own
    position or thrust; None without such a pair. core_s: processor time, judgement included; drone_s: time in the air of all
    drones together.
    """

    seed: int
    drones: int
    faults: list[dict[str, Any]]
    violations: list[Violation]
    able: int
    located: bool
    converged: bool
    error_m: float | None
    min_separation_m: float | None
    sim_s: float
    drone_s: float
    core_s: float


def fly_mission(mission: Mission) -> Verdict:
    """Fly a random mission, judge it, and return the verdict. An exception in it is a violation like any other."""
    from radron.sim.lockstep.flight import watched  # noqa: PLC0415  (only the workers need the physics)

    document, course = mission.drawn, mission.course
    scenario = parse_scenario(document, mission.label)
    setting = Setting(scenario, course.heal_s, course.end_s)
    judge, log = Judge(setting, mission.until), Log(len(setting.names))
    violations: list[Violation] = []
    began = time.process_time()
    recorded = setting.names[mission.seed // _RECORDED_EVERY % len(setting.names)]
    try:
        with TemporaryDirectory() as folder:
            recording = Recording(recorded if mission.seed % _RECORDED_EVERY == _RECORDED_EVERY - 1 else "", Path(folder))
            watched(
                scenario, mission.seed, lambda moment: log.see(moment, judge.landed.able.drones) | judge(moment), recording.make
            )
            judge.finish()
            for text in recording.differences():
                violations.append(Violation(invariant="replay", time_s=log.time_s, drones=(recorded,), text=text))
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({place.filename}:{place.lineno})"
        violations.append(Violation(invariant=EXCEPTION, time_s=log.time_s, drones=(), text=text))
    able = judge.landed.able.drones or ()
    error_m, least_m = log.largest_error_m(able), judge.separation.least_m
    return Verdict(
        seed=mission.seed,
        drones=len(setting.names),
        faults=document.get("fault", []),
        violations=judge.violations + violations,
        able=len(able),
        located=error_m is not None and error_m < LOCATED_M,
        converged=judge.converged.ever,
        error_m=error_m,
        min_separation_m=least_m if np.isfinite(least_m) else None,
        sim_s=round(log.time_s, 3),
        drone_s=round(log.drone_s, 3),
        core_s=time.process_time() - began,
    )


class Log:
    """Collects the numbers of a verdict besides the violations: time in the air, and errors of the source estimates."""

    def __init__(self, drones: int) -> None:
        self.time_s = self.drone_s = 0.0
        self.error_m: list[float | None] = [None] * drones  # of the source estimate, at the last search of an able drone

    def see(self, moment: Scene, able: Collection[int] | None) -> bool:
        """Record the state of the world at one time; the result is always False: the flight continues.

        ``able``: drones that must finish the mission; None before they are known. A drone that has returned without a link has
        the complete log again after the faults have ended, and the estimate from it.
        """
        step_s, self.time_s = moment.time_s - self.time_s, moment.time_s
        self.drone_s += step_s * sum(map(moment.airborne, range(len(self.error_m))))
        pilots = list(enumerate(moment.pilots))
        searches = any(pilot is not None and pilot.stage in SEARCHING for drone, pilot in pilots if able is None or drone in able)
        if searches and moment.source is not None:
            for drone, pilot in pilots:
                if pilot is not None:
                    self.error_m[drone] = _error_m(pilot.hypothesis, moment.source)
        return False

    def largest_error_m(self, drones: Collection[int]) -> float | None:
        """Return the largest error of these drones' last source estimates; None without drones, or with a missing estimate."""
        known = [error for drone in drones if (error := self.error_m[drone]) is not None]
        return max(known) if known and len(known) == len(drones) else None


def _error_m(hypothesis: Hypothesis | None, source: tuple[float, float]) -> float | None:
    if hypothesis is None:
        return None
    return float(np.hypot(hypothesis.position[0] - source[0], hypothesis.position[1] - source[1]))
