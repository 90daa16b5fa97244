"""The other drones as one drone sees them: what they are going to do, in its own local frame."""

from __future__ import annotations

from math import hypot

from msgspec import Struct

from agent.frames.graph import FrameGraph
from agent.frames.transform import Transform
from agent.motion.reference import PeerState
from agent.motion.separation import PeerPlan
from agent.peers import Peer, Peers
from protocol.messages import Pose, Stage

WORST_SIGMA_M = 5.0  # whoever knows its place less well is kept away from no further: it could drive the swarm off its circle
PLAN_AGE_NS = 1_000_000_000  # an older plan is not believed any more
_TAKING_PART = (Stage.TAKEOFF, Stage.SURVEY, Stage.TRACK, Stage.REACQUIRE)
_ON_GROUND = (Stage.PREFLIGHT, Stage.LANDED)


class Neighbour(Struct, frozen=True):
    """Another drone in the air. ``takes_part``: it searches and tracks with us, and counts when area and circle are shared."""

    id: str
    plan: PeerPlan
    takes_part: bool


def neighbours(
    peers: Peers, frames: FrameGraph, local_from_mission: Transform, own_sigma_m: float, now_ns: int
) -> list[Neighbour]:
    """Everybody who is heard, is not on the ground, and whose frame is known; by id. ``own_sigma_m``: of the own position."""
    found = []
    for name in peers.alive(now_ns):
        peer = peers[name]
        if peer.pose is None or (peer.status is not None and peer.status.stage in _ON_GROUND):
            continue
        mission_from_theirs = frames.mission_from_local(name, peer.pose.epoch)
        if mission_from_theirs is None:
            continue
        takes_part = peer.status is not None and peer.status.stage in _TAKING_PART
        sigma_m = min(hypot(own_sigma_m, peer.pose.position_sigma_m), WORST_SIGMA_M)
        plan = _plan(name, peer, peer.pose, local_from_mission @ mission_from_theirs, sigma_m, now_ns)
        found.append(Neighbour(name, plan, takes_part))
    return found


def _plan(name: str, peer: Peer, pose: Pose, local_from_theirs: Transform, sigma_m: float, now_ns: int) -> PeerPlan:
    """Its published plan; without a fresh one, its pose carried on by its velocity."""
    measured = PeerState(
        local_from_theirs.apply_point(pose.position_m),
        local_from_theirs.rotate_direction(pose.velocity_mps),
        age_s=(now_ns - pose.stamp_ns) * 1e-9,
    )
    plan = peer.plan
    if plan is None or plan.epoch != pose.epoch or now_ns - plan.stamp_ns > PLAN_AGE_NS:
        return PeerPlan.from_pose(name, now_ns, measured, sigma_m)
    ahead = [local_from_theirs.apply_point(position) for position in plan.positions_m]
    return PeerPlan(name, plan.stamp_ns, plan.step_ns * 1e-9, ahead, sigma_m, measured)
