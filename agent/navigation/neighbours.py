"""The predicted motion of the other drones, in this drone's local frame, as the input of separation.

A drone that is heard is never left out because its frame is not known. Its position comes from the best of these sources:

1. its frame is known exactly: its poses and plans;
2. its frame is estimated: the same, corrected by this drone's sightings of it, which determine the distance between the two
   better than two estimates in the mission frame do; where a wrong heading leaves nothing to correct, by sightings alone;
3. its localisation has jumped: a frame that continues its motion (``carried_on``), until the log yields a better one; after a
   restart of this agent: the frame of before, likewise;
4. its frame, or the own one, is not known: this drone's sightings alone;
5. it is not seen either, but still near its launch place: the mission's launch layout.

A drone goes where its plan says only as long as its agent steers it, which its poses tell, and its poses follow that plan: one
that departs from it by more than separation allows for is flown by somebody else. It is placed by its pose, as one that
publishes plans no more, and never gives way.

One that was never heard may fly, too, where this agent was started in flight, or after that one had measured something: it was
revoked before, or is out of reach. It counts as missing, like one that is not heard any more; and so does one of which poses were
heard for a moment, but never a status. Where this drone sees it fly, that is where it is.

One whose exactly known localisation has jumped unannounced may be in either of two places, and separation is kept from both, and
as seen from both where this drone is the one (``doubted``); so it is from one whose poses and plans contradict each other,
although its agent steers it: one of them is false. One whose localisation has jumped while it was not heard may have flown home
meanwhile (``heardagain``).

From a flying drone that is not heard any more separation is kept where it is seen, or else wherever it may be (``silent``), and
where a plan of up to two seconds ago leads: messages may only be lost, or take as long; one that circled stands there then, until
it leaves. One that is heard, but whose plans tell that it does not hear this drone, never gives way, and does not take part.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import dist, hypot, inf

from msgspec import Struct
from msgspec.structs import replace

from agent.config.mission import MissionConfig
from agent.frames.graph import LAUNCH_EPOCH, FrameGraph
from agent.frames.transform import Transform
from agent.motion.reference import PeerState
from agent.motion.separation import PeerPlan
from agent.navigation.myself import Self
from agent.navigation.peers.doubted import doubt_m as doubt_between_m
from agent.navigation.peers.following import Following
from agent.navigation.peers.newest import OLDEST_NS, RECENT_NS, Peer, Peers
from agent.navigation.peers.placing import (
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
    sigma_of_m,
    speed_of_mps,
    unexplained_m,
)
from agent.navigation.peers.relative import offset, places
from agent.navigation.peers.theirframes import TheirFrames
from agent.navigation.unheard.absence import Absence
from agent.navigation.unheard.agentless import CIRCLING
from agent.navigation.unheard.contact import SILENT_NS, Circle
from agent.navigation.unheard.heardagain import HeardAgain
from agent.navigation.unheard.silent import LEAVING_NS, QUIET_NS, TAKING_PART, Silent
from agent.navigation.unheard.viewer import Viewer
from protocol.messages import Pose, Stage

NEAR_LAUNCH_M = 15.0  # up to this distance the layout still locates a drone that waits near its launch place
# Two places of a drone nearer to each other than this are one: steering has room for three half-planes in each step.
_SAME_M = 0.3
_STOPPED_NS = 2_000_000_000  # after this long without its agent a drone has stopped: older sightings show where it still flew


class Neighbour(Struct, frozen=True):
    """Another drone in the air. ``takes_part``: it searches and tracks too, and counts when area and circle are divided."""

    id: str
    plan: PeerPlan
    takes_part: bool


class Neighbourhood:
    """The drones that fly around one drone.

    ``absence``: of those that took part, or may do so, and are not heard, as of the last ``around``; None where there are none.
    """

    def __init__(self, mission: MissionConfig, frames: FrameGraph, drone: str) -> None:
        """``drone``: the own id."""
        self.frames = TheirFrames(mission, frames)
        self._members = {member.id: member for member in mission.drones}
        self._following = Following()
        self._silent, self._heard_again = Silent(mission, drone), HeardAgain()
        self._id, self._fastest_mps = drone, mission.limits.speed_mps
        # The stage of each that hears this drone, and the circle of this one then.
        self._while_heard: dict[str, tuple[Stage, Circle | None]] = {}
        self._unheard_ns: dict[str, int] = {}  # who was never heard: since when it may fly
        self.absence: Absence | None = None

    def around(self, peers: Peers, me: Self) -> list[Neighbour]:
        """All drones that are not on the ground and can be located, by id; then as they lie to it if it is elsewhere."""
        self._silent.keep_time(peers.set_ns)
        found, missing = self._seen_from(peers, me)
        partners = [one.id for one in found if one.takes_part]
        self.absence = self._silent.absence(missing, partners, peers, me.now_ns) if missing else None
        if (elsewhere := me.elsewhere()) is not None:
            others, _ = self._seen_from(peers, elsewhere)
            new = [one for one in others if not any(_is_same(one, known, me.now_ns) for known in found)]
            found += [replace(one, takes_part=False) for one in new]
            if self.absence is not None and me.local_from_mission is not None and elsewhere.local_from_mission is not None:
                moved = bare(me.local_from_mission).inverse() @ bare(elsewhere.local_from_mission)
                self.absence = self.absence.with_homes(self._silent.homes, moved)
        return found

    def _seen_from(self, peers: Peers, me: Self) -> tuple[list[Neighbour], list[str]]:
        """All drones as they lie to this one if its frame is right; and who is missing."""
        found: list[Neighbour] = []
        missing = []
        for name in peers.names:
            peer = peers[name]
            on_ground = peer.sources.is_on_ground(me.now_ns)
            if peer.pose is None or on_ground:
                self._silent.heard(name)
                self._heard_again.forget(name)
                if not on_ground and me.may_fly(name):
                    missing += [name] if self._is_unheard(name, me.now_ns) else []
                if not on_ground and me.local_from_mission is not None:
                    found += self._of_unknown(name, peer, me.viewer(me.local_from_mission), me)
                continue
            self._following.compare(name, peer, peer.pose)
            mission_from_theirs = self.frames.of(name, peer.pose)
            took_part = peer.status is not None and peer.status.stage in TAKING_PART
            if me.now_ns - peer.pose.stamp_ns > SILENT_NS:
                found += self._of_silent(name, peer, peer.pose, mission_from_theirs, me)
                missing += [name] if took_part or (peer.status is None and me.may_fly(name)) else []
                continue
            is_carried = name in self.frames.epochs
            self._heard_again.follow(name, peer.pose.stamp_ns, self._silent.agentless(name), is_carried=is_carried)
            apart = self._silent.excluded(name) if me.revoked else self._unhearing(name, peer, mission_from_theirs, me)
            if apart is None:
                self._silent.heard(name)
            else:
                missing += [name] if took_part else []
                found += [Neighbour(name, one, False) for one in apart]
            plan = None
            if mission_from_theirs is not None and me.local_from_mission is not None:
                plan = self._placed_by_frames(name, peer, peer.pose, mission_from_theirs, me.local_from_mission, me)
            takes_part = took_part and plan is not None and apart is None
            if plan is None:
                plan = placed_by_sightings(name, peer.sightings, speed_of_mps(peer.pose), me.epoch, me.now_ns)
                plan = plan or self._placed_by_layout(name, peer.pose, me)
            if plan is not None:
                followed = replace(plan, deviation_m=self._following.deviation_m(name), blind=plan.blind or apart is not None)
                found.append(Neighbour(name, followed, takes_part))
            found += self._of_unplaced(name, inf if plan is None else plan.sigma_m, me)
            stop = self._stop(name, peer, peer.pose, mission_from_theirs, me)
            as_planned = self._as_planned(name, peer, peer.pose, mission_from_theirs, me)
            second = self._second_place(name, peer, me)
            elsewhere = (self._elsewhere(name, peer.pose, mission_from_theirs, me), second, as_planned, stop)
            found += [Neighbour(name, place, False) for place in elsewhere if place is not None]
        return found, missing

    def _of_unplaced(self, name: str, sigma_m: float, me: Self) -> Iterator[Neighbour]:
        """Where else one may be that was heard again, and is not placed (``heardagain``), by its error (1 sigma)."""
        if me.local_from_mission is not None and sigma_m >= WORST_SIGMA_M:
            for one in self._heard_again.plans(name, me.viewer(me.local_from_mission)):
                yield Neighbour(name, one, False)

    def _unhearing(self, name: str, peer: Peer, mission_from_theirs: Transform | None, me: Self) -> list[PeerPlan] | None:
        """What is left to a drone that is heard, but does not hear this one; None where it does, as far as its plans tell."""
        plan, pose, status = peer.plan, peer.pose, peer.status
        if plan is None or not isinstance(plan.unheard, tuple) or self._id not in plan.unheard:
            if status is not None:
                self._while_heard[name] = status.stage, me.circle
            return None
        is_known = self._silent.is_unhearing(name)
        if not is_known and me.now_ns - plan.stamp_ns > RECENT_NS:
            return None
        if pose is None or status is None or mission_from_theirs is None:
            return [] if is_known else None
        stamp_ns = plan.stamp_ns - SILENT_NS  # it has noticed then
        poses = (one for one in peer.poses if one.epoch == pose.epoch)
        last = min(poses, key=lambda one: abs(one.stamp_ns - stamp_ns), default=pose)
        stage, circle = self._while_heard.get(name, (status.stage, me.circle))
        mine = me.motion_at(last.stamp_ns)
        contact = self._silent.contact(name, peer, last, bare(mission_from_theirs), stage, circle, mine)
        sigma_m = _between_sigma_m(pose, mission_from_theirs, me)
        viewer = me.viewer(me.local_from_mission) if me.local_from_mission is not None else None
        return self._silent.unhearing(name, contact, sigma_m, viewer)

    def obeys(self, name: str, now_ns: int) -> None:
        """It is revoked, and on its way home."""
        self._silent.obeys(name, now_ns)

    def _is_unheard(self, name: str, now_ns: int) -> bool:
        """Whether one that may fly was not heard for long enough; its measurements may come before its first pose does."""
        return not 0 <= now_ns - self._unheard_ns.setdefault(name, now_ns) < SILENT_NS

    def follow(self, peers: Peers) -> None:
        """Keep the frames of the others while this drone plans nothing: a jump is bridged only as it happens."""
        for name in peers.names:
            peer = peers[name]
            if peer.pose is not None and not peer.sources.is_on_ground(peer.pose.stamp_ns):
                self.frames.of(name, peer.pose)

    def _of_unknown(self, name: str, peer: Peer, viewer: Viewer, me: Self) -> Iterator[Neighbour]:
        """One that was never heard: where it is seen to fly, or where it may come down; also if it was revoked before this agent
        was started, on the ground.
        """
        seen = placed_by_sightings(name, peer.sightings, self._fastest_mps, me.epoch, me.now_ns, former=True)
        if seen is not None and self._silent.seen(name, None, seen, viewer):
            yield Neighbour(name, replace(seen, blind=True), False)
            return
        excluded = name in me.excluded
        plans = self._silent.unknown(name, viewer, excluded=excluded) if excluded or me.may_fly(name) else []
        yield from (Neighbour(name, plan, False) for plan in (*plans, *self._silent.hidden(name, viewer)))

    def _of_silent(
        self, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform | None, me: Self
    ) -> Iterator[Neighbour]:
        """A drone not heard any more: by sightings since then, or wherever it may be, at first also where its last plan leads."""
        recent = [one for one in peer.sightings if one.stamp_ns > pose.stamp_ns + _STOPPED_NS]
        fastest_mps = max(self._fastest_mps, speed_of_mps(pose))
        if (seen := placed_by_sightings(name, recent, fastest_mps, me.epoch, me.now_ns, former=True)) is not None:
            self._heard_again.forget(name)
            viewer = me.viewer(me.local_from_mission) if me.local_from_mission is not None else None
            if viewer is None or self._silent.seen(name, pose.stamp_ns, seen, viewer):
                yield Neighbour(name, replace(seen, blind=True), False)
        elif peer.status is None and not me.may_fly(name):
            return
        elif mission_from_theirs is not None and me.local_from_mission is not None:
            other, viewer = self.frames.elsewhere(name, pose, mission_from_theirs), me.viewer(me.local_from_mission)
            frames = [bare(one) for one in (mission_from_theirs, other) if one is not None]
            sigma_m = min(hypot(me.place_sigma_m, self._sigma_m(name, pose, mission_from_theirs)), WORST_SIGMA_M)
            plans = self._silent.plans(name, peer, pose, frames, sigma_m, viewer)
            circled = peer.status is not None and peer.status.stage in CIRCLING
            oldest_ns = LEAVING_NS if circled else OLDEST_NS
            if (last := self._following.plan(name, peer, pose, me.now_ns, oldest_ns)) is not None:
                plans += [planned(name, last, viewer.local_from_mission @ frame, sigma_m, me.now_ns) for frame in frames]
            yield from (Neighbour(name, plan, False) for plan in plans)
            yield from self._of_unplaced(name, sigma_m, me)

    def _elsewhere(self, name: str, pose: Pose, mission_from_theirs: Transform | None, me: Self) -> PeerPlan | None:
        """Where a drone of an exactly known frame is if its localisation that has jumped is right; None without that doubt."""
        other = self.frames.elsewhere(name, pose, mission_from_theirs)
        if other is None or me.local_from_mission is None:
            return None
        return blind(name, pose, bare(me.local_from_mission) @ other, me.now_ns)

    def _sigma_m(self, name: str, pose: Pose, mission_from_theirs: Transform) -> float:
        """1 sigma of either of the places where it may be."""
        other = self.frames.elsewhere(name, pose, mission_from_theirs)
        doubt_theirs_m = 0.0 if other is None else doubt_between_m(pose, mission_from_theirs, other)
        return unexplained_m(sigma_of_m(pose, mission_from_theirs), doubt_theirs_m)

    def _stop(self, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform | None, me: Self) -> PeerPlan | None:
        """Where one comes to rest if its agent is gone; None as long as its poses come."""
        if mission_from_theirs is None or me.local_from_mission is None:
            return None
        if me.now_ns - pose.stamp_ns < QUIET_NS + peer.usual_delay_ns:
            return None
        return self._silent.stop(name, peer, pose, bare(mission_from_theirs), me.viewer(me.local_from_mission))

    def _second_place(self, name: str, peer: Peer, me: Self) -> PeerPlan | None:
        """Where it is by the news of a second source (``sources``)."""
        pose = peer.sources.second_place(me.now_ns)
        if pose is None or me.local_from_mission is None:
            return None
        frame = self.frames.told(name, pose.epoch) or self.frames.told(name, LAUNCH_EPOCH)
        return None if frame is None else blind(name, pose, bare(me.local_from_mission) @ bare(frame), me.now_ns)

    def _as_planned(self, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform | None, me: Self) -> PeerPlan | None:
        """Where it is by its plan if that is right, and not its poses, which contradict it."""
        plan = self._following.contradicted(name, peer, pose, me.now_ns)
        if plan is None or mission_from_theirs is None or me.local_from_mission is None:
            return None
        local_from_theirs = bare(me.local_from_mission) @ bare(mission_from_theirs)
        return planned(name, plan, local_from_theirs, _between_sigma_m(pose, mission_from_theirs, me), me.now_ns)

    def _placed_by_frames(
        self, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform, local_from_mission: Transform, me: Self
    ) -> PeerPlan:
        if mission_from_theirs.covariance is None and local_from_mission.covariance is None:
            sigma_m = min(hypot(me.place_sigma_m, pose.position_sigma_m), WORST_SIGMA_M)
            return self._plan(name, peer, pose, local_from_mission @ mission_from_theirs, sigma_m, me.now_ns)
        local_from_theirs = bare(local_from_mission) @ bare(mission_from_theirs)
        sigma_m = hypot(me.sigma_m, sigma_of_m(pose, mission_from_theirs))
        there = partial(expected, peer, pose.epoch, local_from_theirs)
        seen = offset(places(peer.sightings, me.epoch, me.now_ns, there), there)
        if seen is None:
            alone = placed_by_sightings(name, peer.sightings, speed_of_mps(pose), me.epoch, me.now_ns)
            if alone is not None and contradicts(alone, blind(name, pose, local_from_theirs, me.now_ns), sigma_m):
                return replace(alone, blind=self._following.is_blind(name, peer, pose, me.now_ns))
            sigma_m = hypot(me.place_sigma_m, self._sigma_m(name, pose, mission_from_theirs))
        else:
            far = hypot(*seen.vector[:2]) > SIGMAS * hypot(sigma_m, seen.sigma_m)  # then the frames are wrong, not the sightings
            share = 1.0 if far else sigma_m**2 / (sigma_m**2 + seen.sigma_m**2)
            dx, dy, dz = (share * part for part in seen.vector)
            x, y, z = local_from_theirs.translation
            local_from_theirs = Transform(local_from_theirs.yaw_rad, (x + dx, y + dy, z + dz))
            sigma_m = seen.sigma_m if far else share**0.5 * seen.sigma_m
        return self._plan(name, peer, pose, local_from_theirs, min(sigma_m, WORST_SIGMA_M), me.now_ns, doubt_m(sigma_m))

    def _plan(
        self,
        name: str,
        peer: Peer,
        pose: Pose,
        local_from_theirs: Transform,
        sigma_m: float,
        now_ns: int,
        doubt_m: float = 0.0,
    ) -> PeerPlan:
        """Its published plan; without a recent one that it follows, its pose extrapolated by its velocity."""
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

    def _placed_by_layout(self, name: str, pose: Pose, me: Self) -> PeerPlan | None:
        member = self._members[name]
        gone_m = hypot(*pose.position_m[:2])
        if me.local_from_mission is None or gone_m > NEAR_LAUNCH_M or pose.epoch != 0:
            return None
        state = PeerState(me.local_from_mission.apply_point(member.origin_m), age_s=(me.now_ns - pose.stamp_ns) * 1e-9)
        return held(name, me.now_ns, state, hypot(me.sigma_m, member.origin_sigma_m, gone_m))


def _is_same(one: Neighbour, other: Neighbour, now_ns: int) -> bool:
    """Whether both are the same drone at the same place, as one that is seen: it lies there wherever this drone is."""
    if one.id != other.id or one.plan.away is not None or other.plan.away is not None:
        return False
    return dist(one.plan.at(now_ns), other.plan.at(now_ns)) < _SAME_M


def _between_sigma_m(pose: Pose, mission_from_theirs: Transform, me: Self) -> float:
    """1 sigma of the distance between a drone and this one, as far as separation grows with it."""
    return min(hypot(me.place_sigma_m, sigma_of_m(pose, mission_from_theirs)), WORST_SIGMA_M)
