"""Where else a drone of an exactly known frame may be whose localisation has jumped unannounced (``localization.ownpose``).

It flies on by continuity; if its localisation is right, its poses are of the launch's frame as before. So it is in either of two
places, and two such drones lie to each other in one of four ways. Each keeps clear of both places of the other, as seen from its
own by continuity. That leaves out that both localisations are right, as after spoofing that has ended for both: so each keeps
clear of that, too. Nothing else needs the own other place: one without such a doubt keeps clear of both places itself.
"""

from __future__ import annotations

from math import hypot, sqrt

from agent.frames.transform import Transform
from agent.localization.knownframe import SAME_M
from agent.motion.separation import PeerPlan
from agent.navigation.myself import Self
from agent.navigation.placing import WORST_SIGMA_M, bare, blind
from protocol.messages import Pose

_LEAST_SIGMA_M = SAME_M / sqrt(2.0)  # a drone that states less is in no such doubt


def doubted(name: str, pose: Pose, launch: Transform, me: Self) -> list[PeerPlan]:
    """The places of a drone by its localisation, own local frame, as far as separation does not allow for them anyway.

    Args:
        name: its id.
        pose: of an epoch after the first.
        launch: its frame in its first epoch, mission from local.
        me: this drone.
    """
    found = []
    if me.local_from_mission is not None and pose.position_sigma_m >= WORST_SIGMA_M:
        found.append(blind(name, pose, bare(me.local_from_mission) @ launch, me.now_ns))
    both_m = hypot(me.sigma_m, pose.position_sigma_m)
    if me.otherwise is not None and pose.position_sigma_m >= _LEAST_SIGMA_M and both_m >= WORST_SIGMA_M:
        found.append(blind(name, pose, bare(me.otherwise).inverse() @ launch, me.now_ns))
    return found
