"""Failsafe courses of a lost peer's vehicle, if its agent is lost, by the last known data: its pose and its stage."""

from __future__ import annotations

from collections.abc import Sequence

from radron.agent.frames.transform import Transform
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.peers.newest import Peer
from radron.agent.navigation.unheard.agentless import Agentless, Course
from radron.agent.navigation.unheard.contact import motion_of
from radron.protocol.messages import Pose, Stage
from radron.protocol.stages import BRAKING, STEERED

_BLIND_NS = 1_500_000_000  # status newer than the last pose by more than this: the agent is without telemetry


def stage_at(pose: Pose, peer: Peer) -> Stage:
    """Return the stage at a pose of the peer; a stage in flight if none was published."""
    return pose.stage if isinstance(pose.stage, Stage) and pose is not peer.pose else peer.stage or Stage.SURVEY


def last_course(agentless: Agentless, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform) -> Course:
    """Return the failsafe course of the vehicle from this pose on."""
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
    """Return the possible courses of a lost peer's vehicle, by each frame: failsafe courses, and the return of a revoked drone.

    Each course begins where the vehicle was last ``seen``, mission frame, or else at its last pose. A return follows the peer's
    own localisation: with a localisation error it ends beside home. If the last pose says that the agent no longer steers, the
    safety pilot may hold or return the vehicle, before any status reports it. If statuses continue without a pose for seconds,
    the agent is without telemetry, and commands a hold.

    Args:
        agentless: the failsafe courses of the mission's vehicles.
        name: its id.
        peer: the last known messages of the peer.
        pose: its last pose.
        frames: mission from its own: the frame of its flight, and the frame of its alternative position hypothesis, if any.
        seen: its motion at the last sighting, if that is newer than its last pose.
        excluded: it is revoked.
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
    """Return the possible stages, the stage of the last status first; ``steered``: by its agent, according to its last pose."""
    if not steered and stage in STEERED:
        return [stage, Stage.HOLD]
    if steered and stage in (Stage.TAKEOFF, *BRAKING):  # the climb or the braking was by setpoints
        return [stage, Stage.SURVEY]
    return [stage]


def _is_brought_home(agentless: Agentless, name: str, peer: Peer, pose: Pose) -> bool:
    """Whether its autopilot or the safety pilot had begun a return: that return continues, whatever the failsafe would be."""
    return stage_at(pose, peer) is Stage.RETURN and not pose.steered and agentless.has_home(name)
