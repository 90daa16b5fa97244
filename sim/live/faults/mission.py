"""A random mission with faults flown live: real agents, network and MAVLink, judged by what can be observed."""

from __future__ import annotations

import asyncio
import resource
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

import msgspec
import numpy as np

from radron.agent.errors import RadronError
from radron.sim.campaign.faults.course import LIVE
from radron.sim.campaign.faults.mission import LOCATED_M, Mission, Verdict
from radron.sim.live.course import Course
from radron.sim.live.faults.judge import LiveJudge
from radron.sim.live.faults.playable import needs_relays
from radron.sim.live.places import Places
from radron.sim.live.swarm import live_swarm
from radron.sim.live.view import View
from radron.sim.live.worldlink import Truth
from radron.sim.live.worldprocess import LiveError
from radron.sim.runfile import write_text
from radron.sim.scenario import Scenario, parse_scenario
from radron.sim.scoring.invariants.base import Setting, Violation

START = "start"  # the swarm did not get ready, or no drone took off
TRUTH = "truth.jsonl"  # in the folder of a flight: time since the start command, and the truth then
REPORT = "agents.json"
RANDOM_MISSION_READY_S = 90.0
BUSY_S = 0.3  # a world further behind slips, and the agents' watchdogs kill processes frozen for longer
TOO_BUSY = "this machine is too busy for live missions"


def fly_live_mission(mission: Mission, keep: Path | None = None) -> Verdict:
    """Fly a mission in real time, judge it, and return the verdict; its processes have ended when the function returns.

    A live flight cannot be repeated bit for bit. After a violation, or without a judgement, its files stay in ``keep/seed-N``
    (``RunFolder``, the truth, a line for each, and the report); None: they do not.

    Raises:
        RadronError: the machine was too busy for a valid result, or a fault was not played.
    """
    document = mission.drawn
    scenario = parse_scenario(document, mission.label)
    began = _core_s()
    with TemporaryDirectory(prefix="radron-live-") as scratch:
        folder = Path(scratch) if keep is None else keep / f"seed-{mission.seed}"
        judge = asyncio.run(_flown(scenario, mission.seed, folder))
    if not judge.violations:
        shutil.rmtree(folder, ignore_errors=True)
    error_m = judge.log.largest_error_m(judge.able)
    names = {violation.invariant for violation in judge.violations}
    least_m = judge.separation.least_m
    return Verdict(
        seed=mission.seed,
        drones=len(scenario.mission.drones),
        faults=document.get("fault", []),
        violations=judge.violations,
        able=len(judge.able),
        located=error_m is not None and error_m < LOCATED_M,
        converged=not names & {"convergence", START},
        error_m=error_m,
        min_separation_m=least_m if np.isfinite(least_m) else None,
        sim_s=round(judge.log.time_s, 3),
        drone_s=round(judge.log.drone_s, 3),
        core_s=_core_s() - began,
    )


async def _flown(scenario: Scenario, seed: int, folder: Path) -> LiveJudge:
    names = [drone.id for drone in scenario.mission.drones]
    places = Places.relayed(len(names)) if needs_relays(scenario.fault) else Places.here(len(names))
    judge: LiveJudge | None = None
    began_s = time.monotonic()
    try:
        async with live_swarm(scenario, seed, folder, places, View()) as swarm:
            observer = swarm.operator.observer
            judge = LiveJudge(Setting(swarm.scenario, LIVE.heal_s, LIVE.end_s), observer.agents)
            observer.listeners.append(judge.hear)
            with (folder / TRUTH).open("wb") as record:
                watch = _recorded(judge.see, record)
                _, report = await Course(swarm.scenario, seed, swarm.operator, swarm.faults, watch).fly(RANDOM_MISSION_READY_S)
            write_text(folder / REPORT, msgspec.json.encode(report).decode())
            exits = {name: swarm.agents.exit_code(name) for name in names}
            judge.finish([folder / "agents" / name / "agent.log" for name in names], report, exits)
            if judge.late_s > BUSY_S:
                raise RadronError(f"the world was up to {judge.late_s:.1f} s behind the clock: {TOO_BUSY}")
            if swarm.faults is not None and swarm.faults.failed:
                raise RadronError("; ".join(swarm.faults.failed))
    except LiveError as error:
        if judge is None:
            raise
        took_s = round(time.monotonic() - began_s, 1)
        judge.violations.append(Violation(invariant=START, time_s=took_s, drones=(), text=str(error)))
    return judge


def _recorded(see: Callable[[float, Truth], bool], record: BinaryIO) -> Callable[[float, Truth], bool]:
    """Return the same observer, which also records each truth."""

    def watch(time_s: float, truth: Truth) -> bool:
        record.write(msgspec.json.encode((time_s, truth)) + b"\n")
        return see(time_s, truth)

    return watch


def _core_s() -> float:
    """Return the processor time of this process and of all its ended children, s."""
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in spent)
