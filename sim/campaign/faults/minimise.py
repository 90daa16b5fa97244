"""Reduction of a failing random mission to the smallest scenario that still violates the condition."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from radron.sim.campaign.faults.mission import Mission, Verdict, fly_mission
from radron.sim.scoring.invariants.base import Violation

Document = dict[str, Any]
_MAX_FLIGHTS = 60
_MIN_FAULT_S = 0.5  # a fault is not shortened below this
_MIN_DRONES = 2
_EXACT = ("localization", "origin_sigma_m", "yaw_sigma_deg")  # keys of a drone whose frame is estimated


def minimise(
    mission: Mission, fly: Callable[[Mission], Verdict] = fly_mission, tell: Callable[[str], None] = lambda text: None
) -> tuple[Document, Violation] | None:
    """Remove from a mission all parts without which its first violated condition is still violated.

    One part after another is removed, and restored if the condition holds without it, until nothing more can be removed: faults,
    drones, the errors of poses and frames, the source's motion; at last faults are shortened.

    Returns: the content of the smallest scenario file and its violation; None for a mission without a violation.
    """
    verdict = fly(mission)
    if not verdict.violations:
        return None
    found = min(verdict.violations, key=lambda violation: violation.time_s)
    tell(f"{mission.label} violates {found.invariant} at {found.time_s:.2f} s; taking away what this does not need")
    document, flights, tried = mission.drawn, 0, set[str]()
    again = True
    while again:
        again = False
        for what, smaller in _smaller(document):
            if what in tried or flights == _MAX_FLIGHTS:
                continue
            flights += 1
            shown = _violation(fly(replace(mission, document=smaller, until=found.invariant)), found.invariant)
            tell(f"  {'needed' if shown is None else 'not needed'}: {what}")
            if shown is not None:
                document, found, again = smaller, shown, True
                break
            tried.add(what)
    return document, found


def _violation(verdict: Verdict, invariant: str) -> Violation | None:
    return next((violation for violation in verdict.violations if violation.invariant == invariant), None)


def _smaller(document: Document) -> Iterator[tuple[str, Document]]:
    """Yield the mission with one thing less, the largest things first; each with its name."""
    faults = document.get("fault", [])
    for place, fault in enumerate(faults):
        yield _name(fault), document | {"fault": [*faults[:place], *faults[place + 1 :]]}
    drones = document["mission"]["drones"]
    for drone in drones if len(drones) > _MIN_DRONES else ():
        rest = [other for other in drones if other is not drone]
        left = [_without(fault, drone["id"]) for fault in faults]
        if None not in left:
            yield f"drone {drone['id']}", _with_drones(document, rest) | {"fault": left}
    if "sightings" in document:
        exact = [{key: value for key, value in drone.items() if key not in _EXACT} for drone in drones]
        plain = {key: value for key, value in _with_drones(document, exact).items() if key not in ("sightings", "localization")}
        yield "estimated frames", plain
    if document["source"].get("motion", "static") != "static":
        still = {key: document["source"][key] for key in ("activity_bq", "nuclide", "start_m") if key in document["source"]}
        yield "the source's motion", document | {"source": still}
    for place, fault in enumerate(faults):
        half_s = round(fault.get("for_s", 0.0) / 2.0, 2)
        if half_s >= _MIN_FAULT_S:
            shorter = [*faults[:place], fault | {"for_s": half_s}, *faults[place + 1 :]]
            yield f"{_name(fault)} for more than {half_s:g} s", document | {"fault": shorter}


def _name(fault: dict[str, Any]) -> str:
    return f"{fault['kind']} at {fault['at_s']:g} s"


def _with_drones(document: Document, drones: list[Document]) -> Document:
    """Return the mission with these drones only, also in the truth of their localisation."""
    names = [drone["id"] for drone in drones]
    changed = document | {"mission": document["mission"] | {"drones": drones}}
    vehicles = document.get("localization", {}).get("vehicles")
    if vehicles is not None:
        kept = {name: vehicle for name, vehicle in vehicles.items() if name in names}
        changed["localization"] = document["localization"] | {"vehicles": kept}
    return changed


def _without(fault: dict[str, Any], drone: str) -> dict[str, Any] | None:
    """Return the fault without a drone; None if no target remains."""
    if "groups" in fault:
        groups = [[name for name in group if name != drone] for group in fault["groups"]]
        return fault | {"groups": [group for group in groups if group]}
    target = fault.get("target", [])
    named = [target] if isinstance(target, str) else target
    if drone not in named:
        return fault
    rest = [name for name in named if name != drone]
    return fault | {"target": rest} if rest else None
