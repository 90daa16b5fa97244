"""Random missions from seeds: each draws its kinds of faults first, then the faults (swarm testing).

Leaving kinds out at random finds more than drawing from all of them each time: some faults suppress the effects of others
(Groce et al., "Swarm testing", ISSTA 2012).
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import tomli_w

from radron.sim.campaign.faults.course import FULL, Course
from radron.sim.campaign.faults.missions import draw_mission
from radron.sim.campaign.faults.strengths import STRENGTHS, Strike
from radron.sim.faults.base import Family
from radron.sim.faults.kinds import DEALT_ONLY, KINDS

_STREAM = 1_000_005  # key of these random numbers, beside those of the flight itself
_MAX_FAULTS = 5
_FAMILY_ENABLED = 0.4
_KIND_ENABLED = 0.6
_STAYS = 0.3
_AT_THE_HEAL = 0.4  # share of the network's faults that end with the heal
_ONE, _TWO = 0.7, 0.9  # cumulated shares of faults that strike one drone, and two; the others strike all
_NEVER_STAY = ("freeze", "late")  # a frozen process is killed by its watchdog: to stay, it is "kill"
_ONE_ONLY = ("kill", "late", "motor", "takeover", "equivocating", "revoked")  # else often no drone would be left
_WITHOUT_END = ("late", "motor", "revoked")
_WITHOUT_TARGET = ("partition",)
_SHARE_RETURN, _SHARE_HOLD = 0.7, 0.15  # of the missions: autopilots' action without setpoints; in the others they land
_FLOOD_S = 5.0  # each second of it costs as much as ten others


def draw(seed: int, course: Course = FULL) -> dict[str, Any]:
    """Return the scenario of a seed's random mission, as the content of a scenario file; faults are in order of time."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    document = draw_mission(rng, f"faults-{seed}", course)
    names = [drone["id"] for drone in document["mission"]["drones"]]
    kinds = _enabled(rng)
    count = int(rng.integers(1, _MAX_FAULTS + 1))
    faults = [_fault(rng, kinds[int(rng.integers(len(kinds)))], names, course) for _ in range(count)]
    document["fault"] = sorted(faults, key=lambda fault: fault["at_s"])
    document["mission"]["safety"] = {"agent_lost": _agent_lost(seed)}
    return document


def _agent_lost(seed: int) -> Literal["return", "hold", "land"]:
    """Draw the autopilots' action without agents, mostly the default. A separate stream keeps the faults of each seed."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM, 1)))
    drawn = float(rng.random())
    return "return" if drawn < _SHARE_RETURN else "hold" if drawn < _SHARE_RETURN + _SHARE_HOLD else "land"


def as_toml(document: dict[str, Any]) -> str:
    """Return a mission as the text of a scenario file, which ``radron-sim run`` can fly, too."""
    return tomli_w.dumps(document)


def _enabled(rng: np.random.Generator) -> list[str]:
    """Draw the kinds of this seed, at least one."""
    families: dict[Family, list[str]] = {}
    for name, kind in KINDS.items():
        if issubclass(kind, DEALT_ONLY):
            continue
        families.setdefault(kind.family, []).append(name)
    while True:
        kinds = [
            name
            for members in families.values()
            if rng.random() < _FAMILY_ENABLED
            for name in members
            if rng.random() < _KIND_ENABLED
        ]
        if kinds:
            return kinds


def _fault(rng: np.random.Generator, kind: str, names: list[str], course: Course) -> dict[str, Any]:
    target = _target(rng, kind, names)
    at_s = round(float(rng.uniform(course.first_s, course.heal_s - 2.0)), 2)
    entry: dict[str, Any] = {"kind": kind, "at_s": at_s} | STRENGTHS[kind](Strike(rng, names, target))
    if kind not in _WITHOUT_TARGET and len(target) < len(names):
        entry["target"] = target[0] if len(target) == 1 else target
    lasting = rng.random() < _STAYS and KINDS[kind].family != "network" and kind not in _NEVER_STAY
    duration_s = _duration_s(rng, kind, course.heal_s - at_s)
    if kind not in _WITHOUT_END and not lasting:
        entry["for_s"] = duration_s
    return entry


def _target(rng: np.random.Generator, kind: str, names: list[str]) -> list[str]:
    share = rng.random()
    count = 1 if kind in _ONE_ONLY or share < _ONE else 2 if share < _TWO else len(names)
    chosen = rng.permutation(len(names))[:count]
    return [names[place] for place in sorted(chosen)]


def _duration_s(rng: np.random.Generator, kind: str, left_s: float) -> float:
    """Draw a duration: at least 0.5 s, until the heal at most."""
    until_heal = rng.random() < _AT_THE_HEAL and KINDS[kind].family == "network"
    duration_s = float(np.exp(rng.uniform(np.log(0.5), np.log(left_s))))
    if kind == "flood":
        return round(min(duration_s, _FLOOD_S), 2)
    return round(left_s if until_heal else duration_s, 2)
