"""Missions with one attack each, or with one reset of an autopilot: kinds of faults that random missions do not contain.

These missions have a random stream of their own, so that a new kind changes no mission of the other series.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from radron.sim.campaign.faults.course import Course
from radron.sim.campaign.faults.dealt import OF_SATELLITES, Card, strike
from radron.sim.campaign.faults.missions import draw_mission

_STREAM = 1_000_008
# A thief that publishes a wrong place of the drone in every way at once, twenty times a second, with stamps slightly ahead.
LANDED: Card = ("copied-key", {"boot": "same", "stage": "landed", "epochs": 1, "lead_s": 0.09, "period_s": 0.05})
ANYHOW: Card = ("copied-key", {})
ATTACKS: tuple[tuple[Card, ...], ...] = (  # the faults of one entry strike the same drone at the same time
    *((thief,) for thief in (LANDED, ANYHOW)),
    *((thief, ("takeover", {"mode": "hold"})) for thief in (LANDED, ANYHOW)),
    *((thief, ("takeover", {"mode": "return"})) for thief in (LANDED, ANYHOW)),
    (("heading-reset", {}),),
    (("heading-reset", {}), ("satellites-lost", {"for_s": 1.8})),
    (("old-entries", {}),),
    (("dense-entries", {}),),
    (("poisoned", {"beside": True}),),
    (("poisoned", {"beside": False, "counts": "none", "place": "estimate"}),),
    (("poisoned", {"beside": False, "counts": "many"}),),
)


def attack(seed: int, course: Course) -> dict[str, Any]:
    """Return the scenario of a seed's mission with an attack, as the content of a scenario file.

    Successive seeds take the entries of ``ATTACKS`` in turn.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    document = draw_mission(rng, f"attack-{seed}", course)
    drones, cards = document["mission"]["drones"], ATTACKS[seed % len(ATTACKS)]
    names = [drone["id"] for drone in drones]
    needs_satellites = any(kind in OF_SATELLITES for kind, _ in cards)
    able = [drone["id"] for drone in drones if drone.get("localization") != "slam"] if needs_satellites else names
    able = able or names  # where all fly by vision there is no vehicle to strike
    target = able[int(rng.integers(len(able)))]
    faults = [strike(rng, card, names, target, course) for card in cards]
    together = {"at_s": faults[0]["at_s"]}
    document["fault"] = [fault | together for fault in faults]
    return document
