"""Fault isolation: suspects are named, and the drone that contradicts the others is realigned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from radron.agent.frames.consistency import Verdict, agreeing, without
from radron.agent.frames.finding import aligned_better, insert
from radron.agent.frames.joint import Joint, corrected
from radron.agent.frames.keyframe import Keyframe, listed
from radron.agent.frames.residuals import Fixes, Sightings
from radron.agent.frames.slides import FEWEST, MEMORY_S, place_anew

_FIRM = 2  # consecutive keyframes of contradiction before anything is done
_PATIENCE = 5  # keyframes for which a contradicted frame is kept while there is no better pose; consecutive rejected fixes
_ELSEWHERE_VAR = np.array([25.0**2, 25.0**2, 25.0**2, 0.0])  # of one drone, or of all if some have slid, which turns no drone
_DISPLACED_VAR = np.array([25.0**2, 25.0**2, 25.0**2, 0.2**2])  # of the swarm as a whole
_RECEIVERS = 3  # agreeing receivers that are right: single faults scatter, a spoofer puts all in one place
_OUT, _BELIEVED = 2, 2  # or so many rejected receivers, with so many accepted ones
_TRIED = 8  # drones tried in turn as the only wrong one


def judge(keyframe: Keyframe, judged: Verdict) -> None:
    """Find the drones whose frames are wrong, mark them as suspect, and place them by other drones' sightings (relative
    observations) of them.
    """
    _check_fixes_of_the_steady(keyframe)
    faulty_drone = judged.faulty_drone()
    confirmed, joint = agreeing(keyframe.tallies[-1]), keyframe.joint
    for drone in keyframe.joint.drones.tolist():
        member = keyframe.members[drone]
        if drone == faulty_drone:
            keyframe.members[drone] = replace(member, contradicted=member.contradicted + 1)
        else:
            sound = confirmed[drone] and not judged.disagree[drone].any()
            sound_ns = keyframe.stamp_ns if sound else member.sound_ns
            keyframe.members[drone] = replace(member, contradicted=0, sound_ns=sound_ns)
        _check_fixes(keyframe, drone, judged)
    _check_all_fixes(keyframe, joint)
    if faulty_drone is None:
        _report_conflicts(keyframe, judged)
    elif keyframe.members[faulty_drone].contradicted >= _FIRM:
        _isolate(keyframe, faulty_drone, judged)
    for drone in np.flatnonzero(judged.blind).tolist():
        if not judged.disagree[drone].any():
            keyframe.suspect(drone, "its sightings of the others contradict their positions")


def clear_suspicions(keyframe: Keyframe) -> None:
    """Trust the frames of those suspected drones again that have not been contradicted by measurements for a while."""
    longest_ns = round(keyframe.config.suspect_s * 1e9)
    for drone, member in enumerate(keyframe.members):
        suspicion = member.suspicion
        if suspicion is not None and keyframe.stamp_ns - suspicion.stamp_ns > longest_ns:
            keyframe.clear(drone)


def _check_fixes(keyframe: Keyframe, drone: int, judged: Verdict) -> None:
    member = keyframe.members[drone]
    if member.missed < _PATIENCE:
        return
    confirming, contradicting = int(judged.agree[drone].sum()), int(judged.disagree[drone].sum())
    if keyframe.slides(drone):
        keyframe.suspect(drone, "its track slid, and its fixes contradict the sightings between it and the others")
    elif confirming > 0 and confirming >= contradicting:
        keyframe.suspect(drone, "its fixes contradict the sightings between it and the others")
    else:  # sightings do not confirm its estimated pose, either
        keyframe.joint = keyframe.joint.widened(drone, _ELSEWHERE_VAR)
        place_anew(keyframe, [drone])
        keyframe.suspect(drone, "its fixes contradicted its estimated position; the position now follows the fixes")


def _check_all_fixes(keyframe: Keyframe, joint: Joint) -> None:
    """Move the swarm to the place of most of its fixes if these agree on one other place, and several receivers are rejected.
    ``joint``: before any receiver was given up.

    Sightings determine relative positions, not the place of the whole swarm. After most receivers had been wrong for a while and
    were right again, agreeing sightings kept all drones at the wrong place. The same followed when a drone that was dragged away
    had led all others by more than the error of exact receivers, and by less than the error of the others. A receiver with an
    error large enough to fit both places is no witness. Two such receivers together count as a witness, although receivers
    without corrections may err alike, by a metre or two.
    """
    drones, members = joint.drones.tolist(), keyframe.members
    if any(keyframe.setting.exact[drone] for drone in drones):
        return
    fixes = _recent_fixes(keyframe, [drone for drone in drones if not keyframe.slides(drone)])
    receivers = set(fixes.drone.tolist())
    out = {drone for drone in receivers if members[drone].missed >= _PATIENCE}
    for wrong in (set[int](), *({drone} for drone in sorted(out)[:_TRIED])):
        together = sorted(receivers - wrong)
        moved = out - wrong
        least = _RECEIVERS if moved == set(together) else _OUT + _BELIEVED
        if len(together) < least or len(moved) < _OUT:
            continue
        if _follow(keyframe, joint.displaceable(_DISPLACED_VAR), fixes.take(np.isin(fixes.drone, together)), moved):
            for drone in sorted(moved):
                keyframe.suspect(drone, "most fixes contradicted the estimated positions; the positions now follow the fixes")
            return


def _check_fixes_of_the_steady(keyframe: Keyframe) -> None:
    """Move the swarm to the place by the fixes of all steady tracks, if other tracks slide and some of these fixes are rejected:
    the slide has moved all. A single receiver is evidence only during the slide, as it may be wrong itself.
    """
    drones = keyframe.joint.drones.tolist()
    sliding = [drone for drone in drones if keyframe.slides(drone)]
    steady = [drone for drone in drones if drone not in sliding]
    if not sliding or len(steady) < FEWEST or any(keyframe.setting.exact[drone] for drone in steady):
        return
    fixes = _recent_fixes(keyframe, steady)
    receivers = set(fixes.drone.tolist())
    out = {drone for drone in receivers if keyframe.members[drone].missed >= _PATIENCE}
    newest_ns = max(keyframe.members[drone].slid_ns or 0 for drone in sliding)
    if not out or (len(receivers) < FEWEST and keyframe.stamp_ns - newest_ns > MEMORY_S * 1e9):
        return
    if _follow(keyframe, keyframe.joint.displaceable(_ELSEWHERE_VAR), fixes, out) and len(receivers) >= FEWEST:
        for drone in out:
            keyframe.clear(drone)


def _recent_fixes(keyframe: Keyframe, drones: list[int]) -> Fixes:
    """The last fixes of these drones, without drones with fixes that lead their track."""
    leading = keyframe.fixes.drone[keyframe.leads_m > 0.0]
    fixes = keyframe.intake.fixes(keyframe.index - _PATIENCE + 1, keyframe.index)
    return fixes.take(np.isin(fixes.drone, drones) & ~np.isin(fixes.drone, leading))


def _follow(keyframe: Keyframe, displaceable: Joint, fixes: Fixes, out: set[int]) -> bool:
    """Move the swarm by the displacement that all these fixes fit, if there is one; the drones ``out`` count again."""
    displaced = corrected(displaceable, Sightings.empty(), np.zeros(0), fixes)
    if (displaced.fixes < 0.5).any():
        return False
    keyframe.joint = displaced.joint
    place_anew(keyframe, displaced.joint.drones.tolist())
    for drone in out:
        keyframe.members[drone] = replace(keyframe.members[drone], missed=0)
    return True


def _report_conflicts(keyframe: Keyframe, judged: Verdict) -> None:
    """Report pairs of drones that contradict each other without a unique culprit."""
    for a, b in judged.conflicts():
        for one, other in ((a, b), (b, a)):
            name = keyframe.setting.names[other]
            reason = f"its frame and that of {name} contradict the sightings between them; one of the two is wrong"
            keyframe.suspect(one, reason, ambiguous=True)


def _isolate(keyframe: Keyframe, faulty_drone: int, judged: Verdict) -> None:
    others = [keyframe.setting.names[other] for other in np.flatnonzero(judged.disagree[faulty_drone])]
    keyframe.suspect(faulty_drone, f"its frame contradicts the sightings between it and {listed(others)}")
    if not keyframe.setting.exact[faulty_drone]:  # the frame is known from the mission: its localisation is wrong
        _realign(keyframe, faulty_drone)
    for drone, member in enumerate(keyframe.members):  # the faulty drone is known now
        if member.suspicion is not None and member.suspicion.ambiguous:
            keyframe.clear(drone)


def _realign(keyframe: Keyframe, drone: int) -> None:
    """Realign a contradicted drone by the others' sightings, or mark its frame unknown if these stay ambiguous for long."""
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
