"""What the vehicle of a silent drone does if its agent is gone, by the last that is known of it: its pose, and its stage."""

from __future__ import annotations

from collections.abc import Sequence

from agent.frames.transform import Transform
from agent.motion.reference import PeerState
from agent.navigation.peers.newest import Peer
from agent.navigation.unheard.agentless import Agentless, Course
from agent.navigation.unheard.contact import motion_of
from protocol.messages import Pose, Stage
from protocol.stages import BRAKING, STEERED

_BLIND_NS = 1_500_000_000  # statuses go on, and its last pose is older: its agent hears nothing of its vehicle


def last_stage(peer: Peer) -> Stage:
    """Its stage by its last status; as in flight where none is known."""
    return peer.status.stage if peer.status is not None else Stage.SURVEY


def last_course(agentless: Agentless, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform) -> Course:
    """What its vehicle does from this pose on if its agent is gone."""
    home = agentless.home(name, peer, mission_from_theirs)
    return agentless.course(name, motion_of(pose, mission_from_theirs), last_stage(peer), home, steered=pose.steered)


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
    """What its vehicle does if its agent is gone, or as it is revoked and obeys, by each frame.

    It begins where it was ``seen`` last, mission frame, or else at its last pose. It goes home by its localisation, as that is:
    where that is wrong, to beside its home. If its agent did not steer it any more by that pose, a human pilot may have it hold,
    and no status has told it yet, or it is brought home; one that has told its stage, but no pose for seconds, has had no
    telemetry, and has it hold.

    Args:
        agentless: the vehicles of the mission without their agents.
        name: its id.
        peer: the last that is known of it.
        pose: its last pose.
        frames: mission from its own: by which it flies, and, if it is in doubt, by which it may be elsewhere.
        seen: how it moved when it was seen last, if that was after its last pose.
        excluded: it is revoked.
    """
    stages = _possible_stages(last_stage(peer), steered=pose.steered)
    goes_home = excluded or _is_brought_home(agentless, name, peer, pose)
    is_blind = stages[0] in STEERED and peer.status is not None and peer.status.stamp_ns - pose.stamp_ns > _BLIND_NS
    home = agentless.home(name, peer, frames[-1])
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
    """The stages in which it may be, that of its last status first; ``steered``: by its agent, by its last pose."""
    if not steered and stage in STEERED:
        return [stage, Stage.HOLD]
    if steered and stage in (Stage.TAKEOFF, *BRAKING):  # it was rising, or braking, by setpoints
        return [stage, Stage.SURVEY]
    return [stage]


def _is_brought_home(agentless: Agentless, name: str, peer: Peer, pose: Pose) -> bool:
    """Whether its autopilot, or a human pilot, had it return: then that goes on, whatever it would do without its agent."""
    return last_stage(peer) is Stage.RETURN and not pose.steered and agentless.has_home(name)
