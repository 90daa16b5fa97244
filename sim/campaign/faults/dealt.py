"""Missions with faults dealt from a deck instead of drawn, so that few missions cover every kind.

Some successive seeds have each fault of a deck once, five in each mission; times, targets and numbers are random, as are the
swarm, its area and the source (``draw``). Two missions of ten have no fault at all, as faults would hide other errors: one
has estimated frames, the other a strong source on a circle at full speed. Missions with jumps of a localisation or a wrong
clock also have estimated frames, with all kinds of localisation. With a wrong clock the source moves, and the autopilot's
link is down during a step backward; otherwise these faults have hardly any effect. In one mission of ten the drones fly by
satellites alone, without sightings of each other: there positions are most uncertain.

Live missions take two minutes of real time each. Three of them cover all kinds dealt there. Their hands are always the same,
so that faults to be noticed by an agent do not strike a dead agent; and in each a person disarms a drone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from radron.sim.campaign.faults.course import LIVE, Course
from radron.sim.campaign.faults.missions import PACE_MPS, draw_mission
from radron.sim.campaign.faults.strengths import STRENGTHS, Strike
from radron.sim.faults.kinds import KINDS

Card = tuple[str, dict[str, Any]]  # a kind, and its fixed numbers

_STREAM, _DECK_STREAM = 1_000_006, 1_000_007
HAND = 5  # faults of a mission
_CALM = 2  # missions of ten without faults
LASTS_S = (8.0, 14.0)
_MAX_OFFLINE_S = 7.0  # an agent that is back later may find its vehicle landed
_WITHOUT_END = (
    "late",
    "motor",
    "revoked",
    "old-command",
    "heading-reset",
    "camera-dead",
)  # a dead camera: an agent needs a while to be sure
_SEEN_BY_FRAMES = {"position-jump", "clock"}  # matter most with estimated frames
_SEEN_BY_TIME = {"clock"}  # matter most with a moving source
_UNHEARD_S = (1.5, 3.0)  # before and after a clock step backward
OF_SATELLITES = ("position-jump", "heading-reset", "satellites-lost", "spoofed")  # for drones that fly by satellites
OLD_COMMAND: Card = ("old-command", {})
LITTLE_AHEAD: Card = ("clock", {"jump_s": 1.5})  # so little that measurements with these stamps still count
JUMPED: Card = ("position-jump", {"announced": True})  # of drones without sightings of each other
_UNDISTURBED = (OLD_COMMAND, LITTLE_AHEAD)  # without effect on a drone with a dead agent
_WANDERING = {"motion": "wander", "speed_mps": PACE_MPS}
_ROUND = {"motion": "circle", "speed_mps": PACE_MPS, "circle_radius_m": 7.0, "activity_bq": 1e10}
_ROUND_S = 60.0  # of tracking: enough to know the lag behind the source to a tenth of a second
LIVE_HANDS: tuple[tuple[Card, ...], ...] = (  # the faults of a hand strike two drones in turn, so that none hides another one
    (("late", {"at_s": LIVE.first_s}), ("freeze", {}), ("kill", {}), ("cut", {}), ("partition", {})),
    (
        ("takeover", {}),
        ("stream-lost", {"message": "ATTITUDE_QUATERNION"}),
        ("stream-lost", {"message": "GPS_RAW_INT"}),
        ("camera-dead", {"for_s": 9.0}),
        ("mavlink-loss", {"probability": 0.2}),
    ),
    (
        ("satellites-lost", {}),
        ("position-jump", {"announced": True, "turn_deg": 0.0}),
        ("stream-lost", {}),
        ("delay", {}),
        ("slow-cpu", {}),
    ),
)
DECK: tuple[Card, ...] = (  # no wrong content in the logs of agents that refuse invalid entries
    ("kill", {}),
    ("revoked", {}),
    ("freeze", {}),
    ("late", {}),
    ("slow-cpu", {}),
    ("disk", {}),
    ("partition", {}),
    ("cut", {}),
    ("delay", {}),
    ("reorder", {}),
    ("duplicate", {}),
    ("corrupt", {}),
    ("range", {}),
    ("loss", {"probability": 0.5, "resent": False}),
    ("loss", {"probability": 1.0, "news": "plan"}),
    ("forged", {"what": "impossible"}),
    ("forged", {"what": "impersonated"}),
    ("forged", {"what": "other-mission"}),
    ("forged", {"what": "two-versions"}),
    OLD_COMMAND,
    LITTLE_AHEAD,
    ("clock", {"jump_s": -20.0}),
    ("position-jump", {"announced": True, "jump_m": 2.0, "turn_deg": 45.0}),  # as after a heading reset of the filter
    ("battery", {"at_s": 0.0, "level": 0.15}),
    ("mavlink-loss", {}),
)
MISLEADING: tuple[Card, ...] = (  # wrong content in the logs, or vehicles off course: less can be demanded of the others
    ("lie", {"what": "pose"}),
    ("lie", {"what": "plan"}),
    ("equivocating", {}),
    ("camera-dead", {"blind": True}),
    ("camera-noisy", {}),
    ("camera-stuck", {}),
    ("camera-gain", {}),
    ("satellites-lost", {"for_s": 1.8}),  # any longer, and the autopilot has landed it before its position is confirmed
    JUMPED,
    ("position-jump", {"announced": False}),
    ("spoofed", {}),
    ("gust", {}),
    ("motor", {}),
    ("takeover", {}),
    ("refusal", {}),
)


def deal(seed: int, course: Course) -> dict[str, Any]:
    """Return the scenario of a seed's mission with dealt faults, as the content of a scenario file.

    The faults are in order of time.
    """
    live = course == LIVE
    missions = len(LIVE_HANDS) if live else _CALM + (len(DECK) + len(MISLEADING)) // HAND
    turn = seed % missions
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    hand = list(LIVE_HANDS[turn]) if live else _hand(seed // missions, turn - _CALM) if turn >= _CALM else []
    kinds = {kind for kind, _ in hand}
    estimated = False if live else True if turn == 0 or kinds & _SEEN_BY_FRAMES else None
    alone = JUMPED in hand
    document = draw_mission(rng, f"dealt-faults-{seed}", course, estimated=estimated, dealt=True, alone=alone)
    if turn == 1 or (kinds & _SEEN_BY_TIME and not live):
        document["source"] |= _WANDERING if hand else _ROUND
    if turn == 1 and not hand:
        document["mission"]["track"]["duration_s"] = _ROUND_S
    if not hand:
        return document
    drones = document["mission"]["drones"]
    names = [drone["id"] for drone in drones]
    *whom, last = [names[place] for place in rng.permutation(len(names))]
    follow = [drone["id"] for drone in drones if drone.get("localization") != "slam"]
    struck = [last if card in _UNDISTURBED else _target(card[0], k, whom, follow) for k, card in enumerate(hand)]
    faults = [strike(rng, card, names, target, course) for card, target in zip(hand, struck, strict=True)]
    faults += [{"kind": "disarm", "at_s": 0.0, "target": last}] if live else []
    faults += [_unheard(fault) for fault in faults if fault["kind"] == "clock" and fault["jump_s"] < 0.0]
    document["fault"] = sorted(faults, key=lambda fault: fault["at_s"])
    return document


def _hand(shuffled: int, turn: int) -> list[Card]:
    """Return the cards of a turn, from the two decks, which are shuffled anew each time."""
    rng = np.random.default_rng(np.random.SeedSequence(shuffled, spawn_key=(_DECK_STREAM,)))
    cards = [deck[place] for deck in (DECK, MISLEADING) for place in rng.permutation(len(deck)).tolist()]
    return cards[turn * HAND :][:HAND]


def _target(kind: str, place: int, whom: Sequence[str], follow: Sequence[str]) -> str:
    """Return the drone that a card strikes: one after the other; ``follow``: drones with satellite positions."""
    turns = [whom[(place + k) % len(whom)] for k in range(len(whom))]
    return next(name for name in turns if kind not in OF_SATELLITES or name in follow)


def _unheard(clock: dict[str, Any]) -> dict[str, Any]:
    """Return a loss of the autopilot's link during a clock step backward, so that old telemetry does not seem new."""
    at_s = round(clock["at_s"] - _UNHEARD_S[0], 2)
    return {"kind": "mavlink-loss", "at_s": at_s, "for_s": sum(_UNHEARD_S), "probability": 1.0, "target": clock["target"]}


def strike(rng: np.random.Generator, card: Card, names: list[str], target: str, course: Course) -> dict[str, Any]:
    """Return the scenario's entry of a fault for one drone.

    ``card``: kind of fault and its fixed numbers; times and all other numbers are drawn at random. ``target``: the drone.
    ``names``: all drones.
    """
    kind, given = card
    at_s = round(float(rng.uniform(course.first_s, course.heal_s - LASTS_S[1])), 2)
    lasts_s = round(float(rng.uniform(*LASTS_S)), 2)
    entry: dict[str, Any] = {"kind": kind, "at_s": at_s} | STRENGTHS[kind](Strike(rng, names, [target])) | given
    if kind == "clock":
        entry.pop("drift_ppm", None)
    if course == LIVE:  # the emulated PX4 drifts as a real one
        entry.pop("drift_mps2", None)
    if kind != "partition":
        entry["target"] = target
    if kind not in _WITHOUT_END:
        entry.setdefault("for_s", min(lasts_s, _MAX_OFFLINE_S) if KINDS[kind].family == "process" else lasts_s)
    return entry
