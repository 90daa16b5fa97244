"""Position of a heard drone in this drone's local frame, and its alternative positions.

A heard drone is kept clear of even if its frame is not known. Its position comes from the best of these sources:

1. Its frame is known exactly: its poses and plans.
2. Its frame is estimated: the same, corrected by this drone's sightings, which give the relative position better than two frame
   estimates do. Sightings alone if they contradict the frame, as with a wrong heading.
3. Its localisation has jumped: a frame in which its vehicle has moved on without a jump (``carried_on``), until the log gives a
   better one. After a restart of this agent: the stored frame, likewise.
4. Its frame, or the own one, is not known: this drone's sightings alone.
5. No sightings either, but it is near its launch place: the mission's launch layout.

A drone is expected to follow its plan only while its poses state that its agent steers it, and while they agree with the plan. A
deviation beyond the margin of separation means that something else flies it. Then its position is predicted by its pose, like
that of a drone that publishes no more plans, and it is assumed to give no way.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import hypot

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.graph import LAUNCH_EPOCH
from radron.agent.frames.transform import Transform
from radron.agent.motion.reference import PeerState
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.myself import Self
from radron.agent.navigation.peers.following import Following
from radron.agent.navigation.peers.newest import Peer
from radron.agent.navigation.peers.placing import (
    SIGMAS,
    WORST_SIGMA_M,
    bare,
    blind,
    contradicts,
    doubt_m,
    expected,
    held,
    placed_by_sightings,
    planned,
    sigma_of_either_m,
    sigma_of_m,
    speed_of_mps,
)
from radron.agent.navigation.peers.relative import offset, places
from radron.agent.navigation.peers.theirframes import TheirFrames
from radron.protocol.messages import Pose
from radron.protocol.stages import MAY_TAKE_PART, TAKING_PART

NEAR_LAUNCH_M = 15.0  # up to this distance from its launch place the launch layout still gives the position of a waiting drone


class Other(Struct, frozen=True):
    """Another drone that has been heard: its id, its newest messages, and its newest pose.

    ``mission_from_theirs``: transform from its local frame, of the epoch of that pose, to the mission frame; None while it is not
    known.
    """

    name: str
    peer: Peer
    pose: Pose
    mission_from_theirs: Transform | None

    @property
    def took_part(self) -> bool:
        """Whether the drone took off, searched or tracked, by its newest message."""
        return self.peer.stage in TAKING_PART

    @property
    def may_take_part(self) -> bool:
        """Whether the drone took off, searched, tracked or held, by its newest message."""
        return self.peer.stage in MAY_TAKE_PART


class Heard:
    """Positions of heard drones, as obstacles (``PeerPlan``). In all methods, ``me``: state of this drone."""

    def __init__(self, mission: MissionConfig, frames: TheirFrames, following: Following) -> None:
        self._members = {member.id: member for member in mission.drones}
        self._frames, self._following = frames, following

    def by_frames(self, other: Other, me: Self) -> PeerPlan | None:
        """Return the obstacle by the frames of both drones, and by sightings; None while either frame is not known."""
        theirs, mine = other.mission_from_theirs, me.local_from_mission
        if theirs is None or mine is None:
            return None
        if theirs.covariance is None and mine.covariance is None:
            sigma_m = min(hypot(me.place_sigma_m, other.pose.position_sigma_m), WORST_SIGMA_M)
            return self._plan(other, mine @ theirs, sigma_m, me.now_ns)
        return self._by_estimated_frames(other, theirs, mine, me)

    def without_frames(self, other: Other, me: Self) -> PeerPlan | None:
        """Return the obstacle by sightings alone, or else by the launch layout; None if neither gives a position."""
        seen = placed_by_sightings(other.name, other.peer.sightings, speed_of_mps(other.pose), me.epoch, me.now_ns)
        return seen or self._by_layout(other, me)

    def elsewhere(self, other: Other, me: Self) -> Iterator[PeerPlan]:
        """Return its alternative positions as obstacles: by its localisation after a jump, by the poses of another sender under
        its id, and by a plan that its poses contradict. Nothing while the own frame is not known.
        """
        if me.local_from_mission is not None:
            local_from_mission = bare(me.local_from_mission)
            found = (
                self._by_its_localization(other, local_from_mission, me.now_ns),
                *self._by_other_stories(other, local_from_mission, me.now_ns),
                self._as_planned(other, local_from_mission, me),
            )
            yield from (place for place in found if place is not None)

    def _by_estimated_frames(
        self, other: Other, mission_from_theirs: Transform, local_from_mission: Transform, me: Self
    ) -> PeerPlan:
        name, peer, pose = other.name, other.peer, other.pose
        local_from_theirs = bare(local_from_mission) @ bare(mission_from_theirs)
        sigma_m = hypot(me.sigma_m, sigma_of_m(pose, mission_from_theirs))
        there = partial(expected, peer, pose.epoch, local_from_theirs)
        seen = offset(places(peer.sightings, me.epoch, me.now_ns, there), there)
        if seen is None:
            alone = placed_by_sightings(name, peer.sightings, speed_of_mps(pose), me.epoch, me.now_ns)
            if alone is not None and contradicts(alone, blind(name, pose, local_from_theirs, me.now_ns), sigma_m):
                return replace(alone, blind=self._following.is_blind(name, peer, pose, me.now_ns))
            otherwise = self._frames.elsewhere(name, pose)
            sigma_m = hypot(me.place_sigma_m, sigma_of_either_m(pose, mission_from_theirs, otherwise))
        else:
            far = hypot(*seen.vector[:2]) > SIGMAS * hypot(sigma_m, seen.sigma_m)  # then the frames are wrong, not the sightings
            share = 1.0 if far else sigma_m**2 / (sigma_m**2 + seen.sigma_m**2)
            dx, dy, dz = (share * part for part in seen.vector)
            x, y, z = local_from_theirs.translation
            local_from_theirs = Transform(local_from_theirs.yaw_rad, (x + dx, y + dy, z + dz))
            sigma_m = seen.sigma_m if far else share**0.5 * seen.sigma_m
        return self._plan(other, local_from_theirs, min(sigma_m, WORST_SIGMA_M), me.now_ns, doubt_m(sigma_m))

    def _plan(self, other: Other, local_from_theirs: Transform, sigma_m: float, now_ns: int, doubt_m: float = 0.0) -> PeerPlan:
        """Return its published plan as an obstacle; if it follows no recent plan, its pose, extrapolated by its velocity."""
        name, peer, pose = other.name, other.peer, other.pose
        measured = PeerState(
            local_from_theirs.apply_point(pose.position_m),
            local_from_theirs.rotate_direction(pose.velocity_mps),
            age_s=(now_ns - pose.stamp_ns) * 1e-9,
        )
        plan = self._following.plan(name, peer, pose, now_ns)
        if plan is None:
            return PeerPlan.from_pose(name, now_ns, measured, sigma_m, doubt_m, blind=peer.plan is not None)
        ahead = local_from_theirs.apply_points(plan.positions_m)
        return PeerPlan(name, plan.stamp_ns, plan.step_ns * 1e-9, ahead, sigma_m, measured, doubt_m)

    def _by_layout(self, other: Other, me: Self) -> PeerPlan | None:
        member, pose = self._members[other.name], other.pose
        gone_m = hypot(*pose.position_m[:2])
        if me.local_from_mission is None or gone_m > NEAR_LAUNCH_M or pose.epoch != LAUNCH_EPOCH:
            return None
        state = PeerState(me.local_from_mission.apply_point(member.origin_m), age_s=(me.now_ns - pose.stamp_ns) * 1e-9)
        return held(other.name, me.now_ns, state, hypot(me.sigma_m, member.origin_sigma_m, gone_m))

    def _by_its_localization(self, other: Other, local_from_mission: Transform, now_ns: int) -> PeerPlan | None:
        """Return its position if its localisation is right after a jump; None without a jump."""
        frame = self._frames.elsewhere(other.name, other.pose)
        return None if frame is None else blind(other.name, other.pose, local_from_mission @ frame, now_ns)

    def _by_other_stories(self, other: Other, local_from_mission: Transform, now_ns: int) -> Iterator[PeerPlan]:
        """Return its positions by the poses under its id that may come from another sender (``sources``)."""
        for pose in other.peer.sources.second_places(now_ns):
            frame = self._frames.told(other.name, pose.epoch) or other.mission_from_theirs
            if frame is not None:
                yield blind(other.name, pose, local_from_mission @ bare(frame), now_ns)

    def _as_planned(self, other: Other, local_from_mission: Transform, me: Self) -> PeerPlan | None:
        """Return its position by a plan that its poses contradict, in case that the poses are false; None without that."""
        plan = self._following.contradicted(other.name, other.peer, other.pose, me.now_ns)
        if plan is None or other.mission_from_theirs is None:
            return None
        sigma_m = between_sigma_m(other.pose, other.mission_from_theirs, me)
        return planned(other.name, plan, local_from_mission @ bare(other.mission_from_theirs), sigma_m, me.now_ns)


def between_sigma_m(pose: Pose, mission_from_theirs: Transform, me: Self) -> float:
    """Return the 1 sigma (m) of a drone's position relative to this one, up to ``WORST_SIGMA_M``."""
    return min(hypot(me.place_sigma_m, sigma_of_m(pose, mission_from_theirs)), WORST_SIGMA_M)
