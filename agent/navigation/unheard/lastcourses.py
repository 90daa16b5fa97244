"""Possible courses of the vehicle of a lost peer, from its last pose and its last stage."""

from __future__ import annotations

from collections.abc import Sequence

from radron.agent.frames.transform import Transform
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.peers.newest import Peer
from radron.agent.navigation.unheard.agentless import Agentless, Course
from radron.agent.navigation.unheard.contact import motion_of
from radron.protocol.messages import Pose, Stage
from radron.protocol.stages import BRAKING, STEERED

_BLIND_NS = 1_500_000_000  # an agent whose newest status is newer than its last pose by more than this has no telemetry


def stage_at(pose: Pose, peer: Peer) -> Stage:
    """Return the peer's stage at one of its poses: for the newest pose by all messages, for an older one by the pose itself.
    The stage of the search if none was published.
    """
    return pose.stage if isinstance(pose.stage, Stage) and pose is not peer.pose else peer.stage or Stage.SURVEY


def last_course(agentless: Agentless, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform) -> Course:
    """Return the course of the peer's vehicle if it lost its agent at this pose."""
    home = agentless.home(name, pose)
    return agentless.course(name, motion_of(pose, mission_from_theirs), stage_at(pose, peer), home, steered=pose.steered)


def possible_courses(
    agentless: Agentless,
    name: str,
    peer: Peer,
    pose: Pose,
    frames: Sequence[Transform],
    seen: PeerState | None,
    *,
    excluded: bool,
) -> list[Course]:
    """Return all possible courses of a lost peer's vehicle: without its agent, or with an agent that returns or holds.

    Each course begins at the last sighting of the vehicle, or else at its last pose. The peer returns by its own localisation, so
    a return after a jump may end beside its home. If the last pose says that the agent no longer steers, the safety pilot may
    hold the vehicle before a status reports it. If statuses still arrive 1.5 s after the last pose, the agent has no telemetry,
    and commands a hold.

    Args:
        agentless: the failsafe courses of the mission's vehicles.
        name: id of the peer.
        peer: the last known messages of the peer.
        pose: its last pose.
        frames: transforms from the peer's local frame to the mission frame: by its continuous motion, and, after a jump of its
            localisation, by that localisation (its alternative position hypothesis).
        seen: its motion at the last sighting, mission frame, if that is newer than its last pose.
        excluded: the peer is revoked, and returns in any case.
    """
    stages = _possible_stages(stage_at(pose, peer), steered=pose.steered)
    goes_home = excluded or _is_brought_home(agentless, name, peer, pose)
    is_blind = stages[0] in STEERED and peer.status is not None and peer.status.stamp_ns - pose.stamp_ns > _BLIND_NS
    home = agentless.home(name, pose)
    found = []
    for frame in frames:
        moves = motion_of(pose, frame) if seen is None else seen
        there = home if frame is frames[-1] else frame.apply_point(frames[-1].inverse().apply_point(home))
        steered = pose.steered and seen is None
        courses = [agentless.course(name, moves, stage, there, steered=steered) for stage in stages]
        comes_home = goes_home and all(course.way is None for course in courses)
        found += courses + ([agentless.return_of(name, moves, there)] if comes_home else [])
        found += [agentless.blind_hold(moves)] if is_blind else []
    return [course for number, course in enumerate(found) if course not in found[:number]]


def _possible_stages(stage: Stage, *, steered: bool) -> list[Stage]:
    """Return the stages that the peer may have had at its last pose, the published one first. ``steered``: that pose says that
    its agent steered it.
    """
    if not steered and stage in STEERED:
        return [stage, Stage.HOLD]
    if steered and stage in (Stage.TAKEOFF, *BRAKING):  # the climb or the braking was by setpoints
        return [stage, Stage.SURVEY]
    return [stage]


def _is_brought_home(agentless: Agentless, name: str, peer: Peer, pose: Pose) -> bool:
    """Whether the autopilot or the safety pilot had begun a return: it continues, whatever the failsafe without an agent is."""
    return stage_at(pose, peer) is Stage.RETURN and not pose.steered and agentless.has_home(name)
