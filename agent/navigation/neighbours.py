"""Predicted positions of the other drones, in this drone's local frame: the obstacles for separation. They depend on the link:

- Heard: the position follows from the drone's local frame, its messages, and this drone's sightings of it (``heard``).
- One-way link: as heard. But the other drone does not hear this one: it gives no way, and has no share of area and circle.
- Link lost in flight: the position by sightings, or else all possible positions (``silent``). For two seconds, also the positions
  of its last plan, because messages may only be late. If it circled, it is assumed to stop on that plan, until it has left.
- Never heard: it may fly if this agent was started in flight, or the log holds its measurements. Then it counts as missing, like
  a peer with a lost link. It may be revoked, or out of radio range. A sighting gives its position.

A drone may have two possible positions, and separation is kept from both:

- Its frame is given by the mission, and its localisation has jumped without an announcement. If this drone has jumped so itself,
  separation is kept as seen from both its positions (``TheirFrames.elsewhere``).
- Its poses contradict its plan although its agent steers it: one of the two is false. After its landing it may stand at the end
  of its last plan.
- Its localisation jumped while its link was lost: it may have returned meanwhile (``heardagain``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import dist, hypot, inf

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.heard import Heard, Other, between_sigma_m
from radron.agent.navigation.myself import Self
from radron.agent.navigation.peers.following import Following
from radron.agent.navigation.peers.newest import OLDEST_NS, Peer, Peers
from radron.agent.navigation.peers.placing import (
    WORST_SIGMA_M,
    bare,
    placed_by_sightings,
    planned,
    sigma_of_either_m,
    speed_of_mps,
)
from radron.agent.navigation.peers.theirframes import TheirFrames
from radron.agent.navigation.unheard.absence import Absence
from radron.agent.navigation.unheard.contact import QUIET_NS, SILENT_NS, LinkState, link_state
from radron.agent.navigation.unheard.heardagain import follow, further_plans
from radron.agent.navigation.unheard.lastnews import LastNews
from radron.agent.navigation.unheard.relayed import LEAVING_NS
from radron.agent.navigation.unheard.silent import Silent
from radron.agent.navigation.unheard.viewer import Viewer
from radron.protocol.stages import CIRCLING

# Two possible positions of a drone nearer to each other than this count as one, because steering uses only three half-planes in
# each step.
_SAME_M = 0.3
_STOPPED_NS = 2_000_000_000  # after this time a vehicle whose agent is lost has stopped; earlier sightings show it in motion


class Neighbour(Struct, frozen=True):
    """Possible position of another drone in flight, as an obstacle. A drone may have several of them.

    ``takes_part``: the drone searches or tracks with a two-way link, and gets a share of area and circle.
    """

    id: str
    plan: PeerPlan
    takes_part: bool


class Neighbourhood:
    """Predictions of all other drones for one drone.

    absence: consequences of missing drones, as of the last ``around``; None if no drone is missing (and, while this drone
        returns, no lost peer was returning).
    listens: this drone has known for less than a second that a drone never heard may fly. It waits for its first pose.
    """

    def __init__(self, mission: MissionConfig, frames: FrameGraph, drone: str) -> None:
        """``drone``: the own id."""
        self.frames = TheirFrames(mission, frames)
        self._following = Following()
        self._heard = Heard(mission, self.frames, self._following)
        self._silent = Silent(mission, drone)
        self._beliefs = self._silent.beliefs
        self._id, self._fastest_mps = drone, mission.limits.speed_mps
        self.absence: Absence | None = None
        self.listens = False

    def last_news(self, peers: Peers, now_ns: int) -> dict[str, LastNews]:
        """Return the last pose and separation line of each drone that flies or may fly, by id, to be stored for a restart of this
        agent in flight.
        """
        found = {}
        for name in peers.names:
            pose = peers[name].last_pose(now_ns)
            line, before = self._beliefs[name].line, self._beliefs[name].before
            news = LastNews.of(pose, None if line is None else line.wall) if pose is not None else None
            if (kept := news or before) is not None:
                found[name] = kept
        return found

    def remember(self, before: Mapping[str, LastNews]) -> None:
        """Restore the data of ``last_news`` from before a restart of this agent."""
        for name, belief in self._beliefs.items():
            belief.before = before.get(name)

    def around(self, peers: Peers, me: Self) -> list[Neighbour]:
        """Return the possible positions of all drones in flight, in the order of the ids, and update ``absence``.

        If this drone has an alternative position hypothesis, the positions as seen from there follow, where they differ.
        """
        found, missing, links = self._seen_from(peers, me)
        self.listens = any(link is LinkState.NEVER_HEARD and self._is_expected(name, me.now_ns) for name, link in links.items())
        partners = [one.id for one in found if one.takes_part]
        misses = missing or (me.returning_s is not None and self._silent.returning(peers, links, me.now_ns))
        self.absence = self._silent.absence(missing, partners, peers, links, me.now_ns) if misses else None
        if (elsewhere := me.elsewhere()) is not None:
            others, _, _ = self._seen_from(peers, elsewhere)
            new = [one for one in others if not any(_is_same(one, known, me.now_ns) for known in found)]
            found += [replace(one, takes_part=False) for one in new]
            if self.absence is not None and me.local_from_mission is not None and elsewhere.local_from_mission is not None:
                moved = bare(me.local_from_mission).inverse() @ bare(elsewhere.local_from_mission)
                self.absence = self.absence.with_homes(self._silent.homes, moved)
        return found

    def _seen_from(self, peers: Peers, me: Self) -> tuple[list[Neighbour], list[str], dict[str, LinkState]]:
        """Return, for one frame of this drone: the possible positions of the others, the ids of the missing drones, and the state
        of each link.
        """
        found: list[Neighbour] = []
        missing = []
        links: dict[str, LinkState] = {}
        for name in peers.names:
            links[name] = self._link(name, peers[name], me)
            others, is_missing = self._one(name, peers[name], me, links[name])
            found += others
            missing += [name] if is_missing else []
        return found, missing, links

    def _link(self, name: str, peer: Peer, me: Self) -> LinkState:
        """Return the state of the link to a drone. If it is not heard after a restart of this agent in flight, its last pose from
        before the restart is restored.
        """
        belief, link = self._beliefs[name], link_state(peer, self._id, me.now_ns, revoked=me.revoked)
        if link is LinkState.NEVER_HEARD and belief.before is not None and me.resumed and self._is_missing(name, me):
            self._recall(name, peer, belief.before, me.now_ns)
            return link_state(peer, self._id, me.now_ns, revoked=me.revoked)
        return link

    def _one(self, name: str, peer: Peer, me: Self, link: LinkState) -> tuple[list[Neighbour], bool]:
        """Return the possible positions of one drone, and whether it is missing."""
        belief = self._beliefs[name]
        if link is not LinkState.NEVER_HEARD or not me.resumed:
            belief.before = None
        if link is LinkState.ON_GROUND or peer.pose is None:
            belief.forget()
            belief.silence = None
        if link is LinkState.ON_GROUND:
            return [], False
        if peer.pose is None:
            return list(self._of_unknown(name, peer, me)), self._is_missing(name, me)
        self._following.compare(name, peer, peer.pose)
        other = Other(name, peer, peer.pose, self.frames.of(name, peer.pose))
        if link is not LinkState.LOST:
            return self._of_heard(other, me, is_one_way=link is LinkState.ONE_WAY)
        is_missing = other.may_take_part or (peer.stage is None and me.may_fly(name))
        return list(self._of_silent(other, me)), is_missing

    def _of_heard(self, other: Other, me: Self, *, is_one_way: bool) -> tuple[list[Neighbour], bool]:
        """Return the possible positions of a heard drone, and whether it is missing, because it does not hear this drone."""
        name, pose = other.name, other.pose
        belief = self._beliefs[name]
        follow(belief, pose.stamp_ns, is_carried=name in self.frames.epochs)
        found: list[Neighbour] = []
        if not is_one_way:
            belief.forget()
        else:
            belief.heard()
            found += [] if me.revoked else self._beyond_line(other, me)  # a return needs no separation line
        plan = self._heard.by_frames(other, me)
        takes_part = other.took_part and plan is not None and not is_one_way
        plan = plan or self._heard.without_frames(other, me)
        if plan is not None:
            followed = replace(plan, deviation_m=self._following.deviation_m(name), blind=plan.blind or is_one_way)
            found.append(Neighbour(name, followed, takes_part))
        found += self._of_unplaced(name, inf if plan is None else plan.sigma_m, me)
        found += (Neighbour(name, place, False) for place in (*self._heard.elsewhere(other, me), *self._stop(other, me)))
        return found, other.may_take_part and is_one_way

    def _of_unplaced(self, name: str, sigma_m: float, me: Self) -> Iterator[Neighbour]:
        """Return further possible positions of a peer whose localisation jumped while its link was lost (``heardagain``). Each
        has the position uncertainty ``sigma_m`` (1 sigma).
        """
        if me.local_from_mission is not None and sigma_m >= WORST_SIGMA_M:
            for one in further_plans(self._beliefs[name], name, me.viewer(me.local_from_mission)):
                yield Neighbour(name, one, False)

    def _beyond_line(self, other: Other, me: Self) -> list[Neighbour]:
        """Return, as an obstacle, the other side of the separation line to a one-way peer, which belongs to that peer."""
        name, pose, frame = other.name, other.pose, other.mission_from_theirs
        sigma_m = WORST_SIGMA_M if frame is None else between_sigma_m(pose, frame, me)
        viewer = me.viewer(me.local_from_mission) if me.local_from_mission is not None else None
        plans = self._silent.beyond_line(name, other.peer, pose, None if frame is None else bare(frame), sigma_m, viewer)
        return [Neighbour(name, plan, False) for plan in plans]

    def silences_ns(self, peers: Peers, stamp_ns: int) -> dict[str, int]:
        """Return the time (ns) without a pose of each other drone at a stamp, by id, as this drone publishes it. For a drone
        never heard that may fly: since this drone has known that.
        """
        poses = {name: peers[name].pose for name in peers.names}
        since_ns = {name: self._beliefs[name].expected_ns if pose is None else pose.stamp_ns for name, pose in poses.items()}
        return {name: max(0, stamp_ns - one_ns) for name, one_ns in since_ns.items() if one_ns is not None}

    def obeys(self, name: str, now_ns: int) -> None:
        """Note that a revoked drone has reported that it obeys, and is on its way home."""
        belief = self._beliefs.get(name)
        if belief is not None and belief.obeys_ns is None:
            belief.obeys_ns = now_ns

    def _is_missing(self, name: str, me: Self) -> bool:
        """Whether a drone never heard counts as missing: this drone has known for a second or more that it may fly. Before that
        its first pose may still arrive, after its measurements.
        """
        if not me.may_fly(name):
            return False
        belief = self._beliefs[name]
        belief.expected_ns = me.now_ns if belief.expected_ns is None else belief.expected_ns
        return not self._is_expected(name, me.now_ns)

    def _is_expected(self, name: str, now_ns: int) -> bool:
        """Whether this drone has known for less than a second that a drone never heard may fly."""
        expected_ns = self._beliefs[name].expected_ns
        return expected_ns is not None and now_ns - expected_ns < SILENT_NS

    def _recall(self, name: str, peer: Peer, news: LastNews, now_ns: int) -> None:
        """Restore the last pose of a drone that has not been heard since a restart of this agent, and the separation line to it;
        if its frame is known from before.
        """
        if self.frames.of(name, news.pose) is not None:
            pose = news.pose_before(now_ns - SILENT_NS - 1)
            peer.recall(pose)
            self._silent.recall(name, pose, news.wall)

    def follow(self, peers: Peers) -> None:
        """Update the frames of the other drones while this drone makes no plans. A frame can be continued over a jump of a
        drone's localisation only with the poses right before and after the jump.
        """
        for name in peers.names:
            peer = peers[name]
            if peer.pose is not None and not peer.is_on_ground(peer.pose.stamp_ns):
                self.frames.of(name, peer.pose)

    def _of_unknown(self, name: str, peer: Peer, me: Self) -> Iterator[Neighbour]:
        """Return the possible positions of a drone never heard: by sightings, or else over its home, where it may descend."""
        if me.local_from_mission is None:
            return
        viewer = me.viewer(me.local_from_mission)
        seen = placed_by_sightings(name, peer.sightings, self._fastest_mps, me.epoch, me.now_ns, former=True)
        if seen is not None and self._silent.seen(name, None, seen, viewer):
            yield Neighbour(name, replace(seen, blind=True), False)
            return
        excluded = name in me.excluded
        plans = self._silent.unknown(name, viewer, excluded=excluded) if excluded or me.may_fly(name) else []
        yield from (Neighbour(name, plan, False) for plan in (*plans, *self._silent.hidden(name, viewer)))

    def _of_silent(self, other: Other, me: Self) -> Iterator[Neighbour]:
        """Return the possible positions of a lost peer: by sightings two seconds or more after its last pose, or else all that
        follow from that pose.
        """
        name, peer, pose = other.name, other.peer, other.pose
        viewer = me.viewer(me.local_from_mission) if me.local_from_mission is not None else None
        recent = [one for one in peer.sightings if one.stamp_ns > pose.stamp_ns + _STOPPED_NS]
        fastest_mps = max(self._fastest_mps, speed_of_mps(pose))
        if (seen := placed_by_sightings(name, recent, fastest_mps, me.epoch, me.now_ns, former=True)) is not None:
            self._beliefs[name].silence = None
            if viewer is None or self._silent.seen(name, pose.stamp_ns, seen, viewer):
                yield Neighbour(name, replace(seen, blind=True), False)
        elif (peer.stage is not None or me.may_fly(name)) and viewer is not None:
            yield from self._of_unseen(other, viewer, me)

    def _of_unseen(self, other: Other, viewer: Viewer, me: Self) -> Iterator[Neighbour]:
        """Return the possible positions of a lost peer without sightings; at first also those of its last plan."""
        name, peer, pose, frame = other.name, other.peer, other.pose, other.mission_from_theirs
        if frame is None:
            return
        otherwise = self.frames.elsewhere(name, pose)
        frames = [bare(one) for one in (frame, otherwise) if one is not None]
        sigma_m = min(hypot(me.place_sigma_m, sigma_of_either_m(pose, frame, otherwise)), WORST_SIGMA_M)
        plans = self._silent.plans(name, peer, pose, frames, sigma_m, viewer)
        oldest_ns = LEAVING_NS if peer.stage in CIRCLING else OLDEST_NS
        if (last := self._following.plan(name, peer, pose, me.now_ns, oldest_ns)) is not None:
            plans += [planned(name, last, viewer.local_from_mission @ one, sigma_m, me.now_ns) for one in frames]
        yield from (Neighbour(name, plan, False) for plan in plans)
        yield from self._of_unplaced(name, sigma_m, me)

    def _stop(self, other: Other, me: Self) -> Iterator[PeerPlan]:
        """Return, as an obstacle, the stretch on which a quiet peer stops if its agent is lost; nothing while poses arrive."""
        if other.mission_from_theirs is None or me.local_from_mission is None:
            return
        if me.now_ns - other.pose.stamp_ns >= QUIET_NS + other.peer.usual_delay_ns:
            frame, viewer = bare(other.mission_from_theirs), me.viewer(me.local_from_mission)
            yield self._silent.stop(other.name, other.peer, other.pose, frame, viewer)


def _is_same(one: Neighbour, other: Neighbour, now_ns: int) -> bool:
    """Whether both are the same drone at the same position. Two entries by sightings of one drone are, because sightings do not
    depend on the own position estimate.
    """
    if one.id != other.id or one.plan.away is not None or other.plan.away is not None:
        return False
    return dist(one.plan.at(now_ns), other.plan.at(now_ns)) < _SAME_M
