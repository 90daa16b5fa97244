"""Whose frame is wrong: suspects named, and the one that contradicts the others placed anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from agent.frames.consistency import Verdict, agreeing, without
from agent.frames.finding import aligned_better, insert
from agent.frames.keyframe import Keyframe

_FIRM = 2  # keyframes in a row for which a frame is contradicted before anything is done
_PATIENCE = 5  # keyframes for which a contradicted frame is kept while no better place is found; fixes in a row that do not fit
_MISSED_VAR = np.array([25.0**2, 25.0**2, 25.0**2, 0.0])


def judge(keyframe: Keyframe, judged: Verdict) -> None:
    """Find out whose frame is wrong, and place it anew by what the others see of it."""
    culprit = judged.culprit()
    confirmed = agreeing(keyframe.tallies[-1])
    for drone in keyframe.joint.drones.tolist():
        member = keyframe.members[drone]
        if drone == culprit:
            keyframe.members[drone] = replace(member, contradicted=member.contradicted + 1)
        else:
            sound = confirmed[drone] and not judged.disagree[drone].any()
            sound_ns = keyframe.stamp_ns if sound else member.sound_ns
            keyframe.members[drone] = replace(member, contradicted=0, sound_ns=sound_ns)
        _check_fixes(keyframe, drone, judged)
    if culprit is None:
        _name_quarrels(keyframe, judged)
    elif keyframe.members[culprit].contradicted >= _FIRM and not keyframe.setting.exact[culprit]:
        _convict(keyframe, culprit, judged)
    for drone in np.flatnonzero(judged.blind).tolist():
        if not judged.disagree[drone].any():
            keyframe.suspect(drone, "its sightings of the others contradict where they are")


def forgive(keyframe: Keyframe) -> None:
    """Who has not been contradicted for a while is believed again."""
    longest_ns = round(keyframe.config.suspect_s * 1e9)
    for drone, member in enumerate(keyframe.members):
        suspicion = member.suspicion
        if suspicion is not None and not suspicion.lasting and keyframe.stamp_ns - suspicion.stamp_ns > longest_ns:
            keyframe.members[drone] = replace(member, suspicion=None)


def _check_fixes(keyframe: Keyframe, drone: int, judged: Verdict) -> None:
    member = keyframe.members[drone]
    if member.missed < _PATIENCE:
        return
    if judged.agree[drone].any():
        keyframe.suspect(drone, "its fixes contradict the sightings between it and the others")
    else:  # nobody confirms where it is taken to be
        keyframe.joint = keyframe.joint.widened(drone, _MISSED_VAR)
        keyframe.suspect(drone, "its fixes contradicted where it was taken to be; it is placed by them again")


def _name_quarrels(keyframe: Keyframe, judged: Verdict) -> None:
    """Two contradict each other, and nobody tells which of them is wrong."""
    for a, b in judged.quarrels():
        for one, other in ((a, b), (b, a)):
            name = keyframe.setting.names[other]
            reason = f"its frame and that of {name} contradict the sightings between them; one of the two is wrong"
            keyframe.suspect(one, reason, ambiguous=True)


def _convict(keyframe: Keyframe, culprit: int, judged: Verdict) -> None:
    others = [keyframe.setting.names[other] for other in np.flatnonzero(judged.disagree[culprit])]
    keyframe.suspect(culprit, f"its frame contradicts the sightings between it and {_listed(others)}")
    _place_anew(keyframe, culprit)
    for drone, member in enumerate(keyframe.members):  # now it is known who it was
        if member.suspicion is not None and member.suspicion.ambiguous:
            keyframe.members[drone] = replace(member, suspicion=None)


def _place_anew(keyframe: Keyframe, drone: int) -> None:
    """A contradicted drone: placed where the others' sightings have it, or, when they cannot tell for long, nowhere."""
    member = keyframe.members[drone]
    after_sound = member.sound_ns // keyframe.intake.grid_ns + 1
    first = max(after_sound, member.since, keyframe.index - keyframe.setting.window)
    found = aligned_better(keyframe, drone, first)
    if found is None and member.contradicted < _PATIENCE:
        return
    keyframe.joint = keyframe.joint.without(drone)
    keyframe.tallies = tuple(without(one, drone) for one in keyframe.tallies)
    lost_ns = member.sound_ns + 1 if found is None else member.lost_ns
    keyframe.members[drone] = replace(
        member, trusted=False, since=first, contradicted=0, attempted=keyframe.index, lost_ns=lost_ns
    )
    if found is not None:
        insert(keyframe, drone, found)
    keyframe.emit(drone, member.sound_ns + 1, None if found is None else keyframe.placement(drone))


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
