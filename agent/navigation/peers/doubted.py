"""Where else a drone of an exactly known frame may be whose localisation has jumped unannounced (``localization.ownpose``).

It flies on by continuity; if its localisation is right, its poses are of the launch's frame as before. So it is in either of two
places, not anywhere around them: separation is kept from each, and not for the sake of the doubt. Kept from the one it flies by
as far as the doubt reaches, too, four drones in doubt by 8.8 m held each other off their homes for two minutes.

One that is in doubt itself is in either of two places to all others, too, and keeps clear of them as seen from both
(``myself.Self.elsewhere``). So two drones reckon with the same of each other: with two ways in which they may lie where one of
them is in doubt, with four where both are.
"""

from __future__ import annotations

from math import dist, sqrt

from agent.frames.transform import Transform
from agent.localization.knownframe import SAME_M
from protocol.messages import Pose


def doubt_m(pose: Pose, mission_from_theirs: Transform, other: Transform) -> float:
    """Distance between the two places of a drone, as it tells with its frame; 0 without that doubt.

    Args:
        pose: of an epoch after the first.
        mission_from_theirs: its frame of that epoch.
        other: the frame by which it is elsewhere: that of its first epoch, gone on by continuity where jumps were announced.
    """
    apart_m = dist(mission_from_theirs.apply_point(pose.position_m)[:2], other.apply_point(pose.position_m)[:2])
    told_m = sqrt(2.0) * mission_from_theirs.sigmas_at(pose.position_m)[0]
    return apart_m if told_m >= SAME_M and abs(apart_m - told_m) < SAME_M else 0.0
