"""The other drones as one drone sees them: what they are going to do, in its own local frame.

Separation rests on this, so nobody who is heard vanishes from it because its frame is not known. Where a drone is follows, from
the best to the last resort:

1. its frame is known exactly: from its poses and plans;
2. its frame is estimated: from these, corrected by where this drone sees it, which says more of the distance between the two than
   two estimates of where each is in the mission frame;
3. its localisation has jumped: by a frame that continues its motion (``carried_on``), until the log has a better one;
4. its frame, or the own one, is not known: from where this drone sees it alone;
5. nor is it seen, but it is still near its launch place: from the mission's launch layout.

One that flew and is heard no more still hangs there: its autopilot stops it. It is kept away from where it is seen, or for a
while from where it must have stopped.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from functools import partial
from math import hypot

import numpy as np
from msgspec import Struct

from agent.config import MissionConfig
from agent.continuity import carried_on
from agent.frames.graph import FrameGraph
from agent.frames.transform import Array, Transform
from agent.motion.reference import PeerState
from agent.motion.separation import PeerPlan
from agent.peers import Peer, Peers
from agent.sights import offset, placed_alone, places
from protocol.messages import Pose, Sighting, Stage

WORST_SIGMA_M = 5.0  # whoever knows its place less well is kept away from no further: it could drive the swarm off its circle
_DOUBTED = np.diag([0.5 * WORST_SIGMA_M**2, 0.5 * WORST_SIGMA_M**2, 1.0, 0.01])  # of a frame that is not believed any more
PLAN_AGE_NS = 1_000_000_000  # an older plan is not believed any more
NEAR_LAUNCH_M = 15.0  # so far from its launch place the layout still tells of a drone that waits there for its frame
_TAKING_PART = (Stage.TAKEOFF, Stage.SURVEY, Stage.TRACK, Stage.REACQUIRE)
_ON_GROUND = (Stage.PREFLIGHT, Stage.LANDED)
_SIGMAS = 3.0
_DOUBT_SIGMAS, _MOST_DOUBT_M = 2.0, 1.0  # by which even the bare separation grows where frames are estimated
SILENT_NS = 1_000_000_000  # without a pose, ten times as long as from one to the next
SILENCE_NS = 20_000_000_000  # for which a drone that is not heard is taken to be where it stopped; an agent is back by then
_GOES_ON_S = 1.0  # for which its autopilot goes on without it (PX4: COM_OF_LOSS_T), and the way that this leaves unknown
_POSE_GAP_NS = 500_000_000  # between two poses that a place is told from


class Neighbour(Struct, frozen=True):
    """Another drone in the air. ``takes_part``: it searches and tracks with us, and counts when area and circle are shared."""

    id: str
    plan: PeerPlan
    takes_part: bool


class Self(Struct, frozen=True):
    """The own drone: epoch of its frame, where it is in it, and that frame; None while it is not known.

    ``sigma_m``: 1 sigma of the own position in the mission frame (horizontal distance).
    """

    now_ns: int
    epoch: int
    sigma_m: float
    local_from_mission: Transform | None


class Neighbourhood:
    """Who flies around one drone."""

    def __init__(self, mission: MissionConfig, frames: FrameGraph) -> None:
        self._frames = frames
        self._members = {member.id: member for member in mission.drones}
        self._placed: dict[str, tuple[Pose, Transform]] = {}  # each one's newest pose in a frame known, and that frame
        self._carried: dict[str, int] = {}  # the epoch of which the frame is one by continuity

    def around(self, peers: Peers, me: Self) -> list[Neighbour]:
        """Everybody who is not on the ground, and of whom it can be told where it is; by id."""
        found, alive = [], peers.alive(me.now_ns)
        for name in peers.names:
            peer = peers[name]
            if peer.pose is None or (peer.status is not None and peer.status.stage in _ON_GROUND):
                continue
            mission_from_theirs = self._frame_of(name, peer.pose)
            plan = None
            if me.now_ns - peer.pose.stamp_ns > SILENT_NS:
                plan = self._silent(name, peer, peer.pose, mission_from_theirs, me)
            elif mission_from_theirs is not None and me.local_from_mission is not None:
                plan = self._placed_by_frames(name, peer, peer.pose, mission_from_theirs, me.local_from_mission, me)
            heard = name in alive
            takes_part = heard and plan is not None and peer.status is not None and peer.status.stage in _TAKING_PART
            if heard:
                plan = plan or _placed_by_sights(name, peer.sights, peer.pose, me) or self._placed_by_layout(name, peer.pose, me)
            if plan is not None:
                found.append(Neighbour(name, plan, takes_part))
        return found

    def _silent(self, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform | None, me: Self) -> PeerPlan | None:
        """One that is heard no more: by what was seen of it since, or where it must have stopped."""
        stopped_ns = pose.stamp_ns + round(_GOES_ON_S * 1e9)
        seen = _placed_by_sights(name, [sight for sight in peer.sights if sight.stamp_ns > stopped_ns], pose, me)
        if seen is not None or peer.status is None or me.now_ns - pose.stamp_ns > SILENCE_NS:
            return seen
        if mission_from_theirs is None or me.local_from_mission is None:
            return None
        local_from_theirs = _bare(me.local_from_mission) @ _bare(mission_from_theirs)
        (x, y, z), (u, v, w) = pose.position_m, pose.velocity_mps
        stopped = PeerState(local_from_theirs.apply_point((x + _GOES_ON_S * u, y + _GOES_ON_S * v, z + _GOES_ON_S * w)))
        sigma_m = hypot(me.sigma_m, _sigma_m(pose, mission_from_theirs), 0.5 * _GOES_ON_S * hypot(u, v))
        return _held(name, me.now_ns, stopped, sigma_m)

    def _frame_of(self, name: str, pose: Pose) -> Transform | None:
        """Its frame, or one by the continuity of its motion after a jump; one that is not believed any more with all doubt."""
        known = self._frames.mission_from_local(name, pose.epoch)
        if known is not None:
            self._placed[name] = pose, known
            return known
        last = self._placed.get(name)
        if last is None:
            return None
        before, transform = last
        if before.epoch != pose.epoch:
            elapsed_s = (pose.stamp_ns - before.stamp_ns) * 1e-9
            old, new = (before.position_m, before.quaternion), (pose.position_m, pose.quaternion)
            transform = carried_on(transform, old, before.velocity_mps, new, elapsed_s)
            self._carried[name] = pose.epoch
        elif self._carried.get(name) != pose.epoch:  # the log does not believe it any more
            return Transform(transform.yaw_rad, transform.translation, _DOUBTED)
        self._placed[name] = pose, transform
        return transform

    def _placed_by_frames(
        self, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform, local_from_mission: Transform, me: Self
    ) -> PeerPlan:
        if mission_from_theirs.covariance is None and local_from_mission.covariance is None:
            sigma_m = min(hypot(me.sigma_m, pose.position_sigma_m), WORST_SIGMA_M)
            return _plan(name, peer, pose, local_from_mission @ mission_from_theirs, sigma_m, me.now_ns)
        local_from_theirs = _bare(local_from_mission) @ _bare(mission_from_theirs)
        sigma_m = hypot(me.sigma_m, _sigma_m(pose, mission_from_theirs))
        expected = partial(_expected, peer, pose.epoch, local_from_theirs)
        seen = offset(places(peer.sights, me.epoch, me.now_ns, expected), expected)
        if seen is not None:
            far = hypot(*seen.vector[:2]) > _SIGMAS * hypot(sigma_m, seen.sigma_m)  # then the frames are wrong, not the eyes
            share = 1.0 if far else sigma_m**2 / (sigma_m**2 + seen.sigma_m**2)
            dx, dy, dz = (share * part for part in seen.vector)
            x, y, z = local_from_theirs.translation
            local_from_theirs = Transform(local_from_theirs.yaw_rad, (x + dx, y + dy, z + dz))
            sigma_m = seen.sigma_m if far else share**0.5 * seen.sigma_m
        return _plan(name, peer, pose, local_from_theirs, min(sigma_m, WORST_SIGMA_M), me.now_ns, _doubt_m(sigma_m))

    def _placed_by_layout(self, name: str, pose: Pose, me: Self) -> PeerPlan | None:
        member = self._members[name]
        gone_m = hypot(*pose.position_m[:2])
        if me.local_from_mission is None or gone_m > NEAR_LAUNCH_M or pose.epoch != 0:
            return None
        state = PeerState(me.local_from_mission.apply_point(member.origin_m), age_s=(me.now_ns - pose.stamp_ns) * 1e-9)
        return _held(name, me.now_ns, state, hypot(me.sigma_m, member.origin_sigma_m, gone_m))


def _placed_by_sights(name: str, sights: Sequence[Sighting], pose: Pose, me: Self) -> PeerPlan | None:
    """From what this drone sees alone. Of its pose only the speed counts, which is the same in every frame."""
    seen = places(sights, me.epoch, me.now_ns, _nowhere)
    alone = placed_alone(seen, me.now_ns, hypot(*pose.velocity_mps[:2]))
    if alone is None:
        return None
    return _held(name, me.now_ns, *alone)


def _nowhere(_: int) -> None:
    """Nobody knows where it should have been."""


def _expected(peer: Peer, epoch: int, local_from_theirs: Transform, stamp_ns: int) -> Array | None:
    """Where its poses put a drone at a stamp; own local frame."""
    poses = peer.poses
    place = bisect_right(poses, stamp_ns, key=_stamp)
    before, after = poses[max(place - 1, 0)], poses[min(place, len(poses) - 1)]
    if before.epoch != epoch or after.epoch != epoch:
        return None
    if abs(stamp_ns - before.stamp_ns) > _POSE_GAP_NS:
        return None
    span_ns = after.stamp_ns - before.stamp_ns
    if span_ns <= 0 or place == 0:
        elapsed_s = (stamp_ns - before.stamp_ns) * 1e-9
        position = np.array(before.position_m) + elapsed_s * np.array(before.velocity_mps)
    else:
        share = (stamp_ns - before.stamp_ns) / span_ns
        position = (1.0 - share) * np.array(before.position_m) + share * np.array(after.position_m)
    return local_from_theirs.apply(position)


def _stamp(pose: Pose) -> int:
    return pose.stamp_ns


def _bare(transform: Transform) -> Transform:
    """The same without its covariance, which costs more than the transform."""
    return Transform(transform.yaw_rad, transform.translation)


def _sigma_m(pose: Pose, mission_from_theirs: Transform) -> float:
    """1 sigma of where a drone is in the mission frame: by its frame where that is estimated, else as it tells itself."""
    return mission_from_theirs.sigmas_at(pose.position_m)[0] or pose.position_sigma_m


def _held(name: str, now_ns: int, state: PeerState, sigma_m: float) -> PeerPlan:
    """Kept away from where it is, as little as is known of that."""
    return PeerPlan.from_pose(name, now_ns, state, min(sigma_m, WORST_SIGMA_M), _doubt_m(sigma_m))


def _doubt_m(sigma_m: float) -> float:
    return min(_DOUBT_SIGMAS * sigma_m, _MOST_DOUBT_M)


def _plan(
    name: str, peer: Peer, pose: Pose, local_from_theirs: Transform, sigma_m: float, now_ns: int, doubt_m: float = 0.0
) -> PeerPlan:
    """Its published plan; without a fresh one, its pose carried on by its velocity."""
    measured = PeerState(
        local_from_theirs.apply_point(pose.position_m),
        local_from_theirs.rotate_direction(pose.velocity_mps),
        age_s=(now_ns - pose.stamp_ns) * 1e-9,
    )
    plan = peer.plan
    if plan is None or plan.epoch != pose.epoch or now_ns - plan.stamp_ns > PLAN_AGE_NS:
        return PeerPlan.from_pose(name, now_ns, measured, sigma_m, doubt_m)
    ahead = local_from_theirs.apply_points(plan.positions_m)
    return PeerPlan(name, plan.stamp_ns, plan.step_ns * 1e-9, ahead, sigma_m, measured, doubt_m)
