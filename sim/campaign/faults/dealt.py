"""Missions with faults for live flights: they take a minute of real time each, so the faults are dealt to them, not drawn.

Three successive seeds have each fault of the deck once, five in each mission: the whole deck in as few flights as possible. Their
times, targets and numbers are random, and so are the swarm, its area and the source, as in the missions of ``draw``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.campaign.faults.course import LIVE
from sim.campaign.faults.missions import draw_mission
from sim.campaign.faults.strengths import STRENGTHS, Strike
from sim.faults.kinds import KINDS

_STREAM, _DECK_STREAM = 1_000_006, 1_000_007
HAND = 5  # faults of a mission
LASTS_S = (8.0, 14.0)
_LONGEST_OFFLINE_S = 7.0  # an agent that is back later may find its vehicle landed
_FIRST_TRY_S = 0.0  # of whoever disarms it: before it takes off
DECK: tuple[tuple[str, dict[str, Any]], ...] = (
    ("kill", {}),
    ("freeze", {}),
    ("late", {}),
    ("slow-cpu", {}),
    ("partition", {}),
    ("cut", {}),
    ("delay", {}),
    ("mavlink-loss", {"probability": 0.2}),
    ("stream-lost", {"message": "ATTITUDE_QUATERNION"}),
    ("stream-lost", {"message": "GPS_RAW_INT"}),
    ("stream-lost", {}),
    ("satellites-lost", {}),
    ("position-jump", {"announced": True, "turn_deg": 0.0}),
    ("takeover", {}),
    ("disarm", {}),
)


def deal(seed: int) -> dict[str, Any]:
    """The scenario document of a seed's live mission, with its faults in order of time."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    document = draw_mission(rng, f"live-faults-{seed}", LIVE, may_estimate=False)
    names = [drone["id"] for drone in document["mission"]["drones"]]
    missions = len(DECK) // HAND
    order = np.random.default_rng(np.random.SeedSequence(seed // missions, spawn_key=(_DECK_STREAM,))).permutation(len(DECK))
    hand = order[seed % missions * HAND :][:HAND].tolist()
    whom = [names[place] for place in rng.permutation(len(names))]
    faults = [_fault(rng, DECK[card], names, whom[k % len(names)]) for k, card in enumerate(hand)]
    document["fault"] = sorted(faults, key=lambda fault: fault["at_s"])
    return document


def _fault(rng: np.random.Generator, card: tuple[str, dict[str, Any]], names: list[str], target: str) -> dict[str, Any]:
    kind, given = card
    at_s = round(float(rng.uniform(LIVE.first_s, LIVE.heal_s - LASTS_S[1])), 2)
    lasts_s = round(float(rng.uniform(*LASTS_S)), 2)
    entry: dict[str, Any] = {"kind": kind, "at_s": at_s} | STRENGTHS[kind](Strike(rng, names, [target])) | given
    if kind != "partition":
        entry["target"] = target
    if kind == "disarm":
        entry["at_s"] = _FIRST_TRY_S
    elif kind != "late":
        entry["for_s"] = min(lasts_s, _LONGEST_OFFLINE_S) if KINDS[kind].family == "process" else lasts_s
    return entry
