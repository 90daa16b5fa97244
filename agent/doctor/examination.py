"""The examination: the preflight check with the camera's background and the parameters, and the computer and its links."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.doctor.computer import computer
from radron.agent.doctor.reach import reach
from radron.agent.doctor.report import Check, Report, Setting
from radron.agent.preflight.background import Background
from radron.agent.preflight.check import Preflight
from radron.agent.preflight.chrony import NAME as CHRONY
from radron.agent.preflight.corrections import Corrections
from radron.agent.vehicle.demands import demands_of
from radron.agent.vehicle.interface import Finding

_AREAS = {name: "swarm" for name in ("mission", "return layer", "certificate", "revoked", "state", "mesh")}
_AREAS |= {"flight records": "computer", "clock": "clock", CHRONY: "clock"}
_AREAS |= {"camera": "camera", "calibration": "camera", "sightings": "camera"}
_PARAMETERS = "parameters"


async def examine(
    drone: DroneConfig, mission: MissionConfig, wait_s: float, smart: Path | None, write: bool, tell: Callable[[str], None]
) -> Report:
    """Examine one drone on the bench: the preflight check, and camera, parameters, computer, and links to the other drones.

    Args:
        drone: the drone file.
        mission: its mission.
        wait_s: the longest time to wait for parts that are not ready yet.
        smart: output of ``smartctl --json`` about the disk; None: there is none.
        write: also set the autopilot's parameters that are wrong.
        tell: called with the parts that are waited for.
    """
    corrections = Corrections(demands_of(mission, drone, sets=False)) if write else None
    preflight = Preflight(drone, mission, Background(mission.detection), corrections)
    others = [member.id for member in mission.drones if member.id != drone.id]
    told = ""

    def waiting(findings: list[Finding]) -> None:
        nonlocal told
        late = [finding.name for finding in findings if finding.verdict == "not yet"]
        names = ", ".join(dict.fromkeys(_PARAMETERS if name.isupper() and name not in others else name for name in late))
        if names and names != told:
            told = names
            tell(f"waiting for: {names}")

    reached = asyncio.gather(*(reach(name, drone.mesh.endpoints.get(name)) for name in others))
    await preflight.run(wait_s, waiting)
    if not reached.done():
        tell("measuring the links to the other drones")
    checks = computer(Path(drone.recorder.folder or drone.state or "/"), smart)
    checks += folded([_check(finding, others) for finding in preflight.findings])
    return Report(
        drone=drone.id,
        version=version("radron"),
        mission=f"{mission.name} {mission.mission_id}",
        stamp_ns=time.time_ns(),
        checks=(*checks, *await reached),
        written=tuple(_setting(corrections)),
    )


def _check(finding: Finding, others: list[str]) -> Check:
    area = "swarm" if finding.name in others else _AREAS.get(finding.name, "autopilot")
    return Check(area, finding.name, finding.verdict, str(finding.text))


def folded(checks: list[Check]) -> list[Check]:
    """Return the checks of a drone with one common line for all correct autopilot parameters, so that all checks fit on
    a page.
    """
    good = [check for check in checks if check.area == "autopilot" and check.name.isupper() and check.verdict == "ok"]
    if not good:
        return checks
    text = ", ".join(f"{check.name} {check.text.partition(';')[0]}" for check in good)
    return [*(check for check in checks if check not in good), Check("autopilot", _PARAMETERS, "ok", text)]


def _setting(corrections: Corrections | None) -> list[Setting]:
    changes = [] if corrections is None else corrections.changes
    return [Setting(change.name, change.before, change.after, change.taken) for change in changes]
