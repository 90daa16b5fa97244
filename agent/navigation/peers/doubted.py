"""Alternative position hypothesis of a drone with an exactly known frame after an unannounced jump (``localization.ownpose``).

The drone flies on by continuity; if its localisation is right, its poses are of the launch's frame as before. Both hypotheses are
points, with no possible position around them. Separation is kept from each, without the position uncertainty, which equals their
distance. If the uncertainty counted as well, drones with hypotheses 8.8 m apart would hold each other off their homes.

A drone with two hypotheses about itself keeps clear of all others as seen from both (``myself.Self.elsewhere``). Two drones make
the same assumptions: two relative positions if one of them has jumped, four if both have.
"""

from __future__ import annotations

from math import dist, sqrt

from radron.agent.frames.transform import Transform
from radron.agent.localization.knownframe import SAME_M
from radron.protocol.messages import Pose


def doubt_m(pose: Pose, mission_from_theirs: Transform, other: Transform) -> float:
    """Return the distance between both hypotheses of a drone, if it matches the uncertainty published with its frame; else 0.

    Args:
        pose: of an epoch after the first.
        mission_from_theirs: its frame of that epoch.
        other: the frame of the alternative hypothesis: of its first epoch, continued through announced jumps.
    """
    apart_m = dist(mission_from_theirs.apply_point(pose.position_m)[:2], other.apply_point(pose.position_m)[:2])
    told_m = sqrt(2.0) * mission_from_theirs.sigmas_at(pose.position_m)[0]
    return apart_m if told_m >= SAME_M and abs(apart_m - told_m) < SAME_M else 0.0
