"""Predicted motion of the other drones, in this drone's local frame: the input of separation.

A heard peer is placed by its frame, its messages and the own sightings of it (``heard``).

A peer never heard may fly, too: it was revoked before, or is out of reach. Conditions: an in-flight start of this agent, or
measurements of that peer in the log. It counts as missing, like a lost peer, or a peer with a few poses, but never a status. A
sighting of its flight gives its position.

A peer with an exactly known frame and an unannounced jump of its localisation has two position hypotheses. Separation is kept
from both; and as seen from both, if this drone has jumped (``doubted``). The same holds for a steered peer with a contradiction
between poses and plans: one of them is false. After landing, it may stand at the end of its last plan. A peer with a jump during
a lost link may have returned meanwhile (``heardagain``).

For a flying peer with a lost link, separation is kept from its position by sightings, or else from all possible ones
(``silent``). Its plan of up to two seconds ago counts as well: messages may only be lost, or late. If it circled, it stands at
the end of that plan until it leaves. A one-way peer lists this drone as not heard in its plans; it never gives way, and does not
take part.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import dist, hypot, inf

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.localization.clocks import HEARD_NS
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.heard import Heard, Other, between_sigma_m, sigma_of_either_m
from radron.agent.navigation.myself import Self
from radron.agent.navigation.peers.following import Following
from radron.agent.navigation.peers.newest import OLDEST_NS, Peer, Peers
from radron.agent.navigation.peers.placing import WORST_SIGMA_M, bare, placed_by_sightings, planned, speed_of_mps
from radron.agent.navigation.peers.sources import RECENT_NS
from radron.agent.navigation.peers.theirframes import TheirFrames
from radron.agent.navigation.unheard.absence import Absence
from radron.agent.navigation.unheard.contact import SILENT_NS, Circle, Contact
from radron.agent.navigation.unheard.heardagain import HeardAgain
from radron.agent.navigation.unheard.lastnews import LastNews
from radron.agent.navigation.unheard.relayed import LEAVING_NS
from radron.agent.navigation.unheard.silent import QUIET_NS, Silent
from radron.agent.navigation.unheard.viewer import Viewer
from radron.protocol.messages import Stage
from radron.protocol.stages import CIRCLING

# Distance below which two positions of a drone are one: steering has room for three half-planes in each step.
_SAME_M = 0.3
_STOPPED_NS = 2_000_000_000  # time to the stop of a vehicle whose agent is lost: older sightings show it still in flight


class Neighbour(Struct, frozen=True):
    """Another drone in the air. ``takes_part``: it searches and tracks too, and gets a share of area and circle."""

    id: str
    plan: PeerPlan
    takes_part: bool


class Neighbourhood:
    """Drones that fly around one drone.

    ``absence``: consequences of missing drones, as of the last ``around``; None without missing drones, and without a lost peer
    that returns while this drone does. ``listens``: for less than a second this drone has known of drones that may fly, and were
    never heard. ``unheard``: drones with a lost link that may fly, also on their way home.
    """

    def __init__(self, mission: MissionConfig, frames: FrameGraph, drone: str) -> None:
        """``drone``: the own id."""
        self.frames = TheirFrames(mission, frames)
        self._following = Following()
        self._heard = Heard(mission, self.frames, self._following)
        self._silent, self._heard_again = Silent(mission, drone), HeardAgain()
        self._id, self._fastest_mps = drone, mission.limits.speed_mps
        # Stage of each peer with a two-way link, and the circle of this drone then.
        self._while_heard: dict[str, tuple[Stage, Circle | None]] = {}
        self._unheard_ns: dict[str, int] = {}  # drones never heard: first stamp at which they may fly
        self._before: dict[str, LastNews] = {}  # messages from before a restart of this agent, of drones without a link since
        self.absence: Absence | None = None
        self.listens, self.unheard = False, tuple[str, ...]()

    def last_news(self, peers: Peers, now_ns: int) -> dict[str, LastNews]:
        """Return the knowledge about flying drones, certain or possible, for a restart of this agent in flight."""
        found = {}
        for name in peers.names:
            told = peers[name].last_news(now_ns)
            if told is None:
                continue
            pose, status = told
            news = LastNews.of(pose, status, self._silent.wall(name, pose.stamp_ns), peers[name].launch)
            if news is not None:
                found[name] = news
        return self._before | found

    def remember(self, before: Mapping[str, LastNews]) -> None:
        """Restore the knowledge about the other drones from before a restart of this agent."""
        self._before = dict(before)

    def around(self, peers: Peers, me: Self) -> list[Neighbour]:
        """Return all drones in the air with a known position, by id; then as seen from the alternative position of this drone."""
        if not me.resumed:
            self._before.clear()
        found, missing = self._seen_from(peers, me)
        unheard = [name for name in self._unheard_ns if peers[name].pose is None and not peers[name].is_on_ground(me.now_ns)]
        self.listens = any(0 <= me.now_ns - self._unheard_ns[name] < SILENT_NS for name in unheard)
        partners = [one.id for one in found if one.takes_part]
        returning = self._silent.returning(peers, me.now_ns)
        misses = missing or (me.returning_s is not None and returning)
        self.absence = self._silent.absence(missing, partners, peers, me.now_ns) if misses else None
        self.unheard = (*(self.absence.unheard if self.absence is not None else ()), *returning)
        if (elsewhere := me.elsewhere()) is not None:
            others, _ = self._seen_from(peers, elsewhere)
            new = [one for one in others if not any(_is_same(one, known, me.now_ns) for known in found)]
            found += [replace(one, takes_part=False) for one in new]
            if self.absence is not None and me.local_from_mission is not None and elsewhere.local_from_mission is not None:
                moved = bare(me.local_from_mission).inverse() @ bare(elsewhere.local_from_mission)
                self.absence = self.absence.with_homes(self._silent.homes, moved)
        return found

    def _seen_from(self, peers: Peers, me: Self) -> tuple[list[Neighbour], list[str]]:
        """Return all drones relative to this one, if its frame is right; and the missing drones."""
        found: list[Neighbour] = []
        missing = []
        for name in peers.names:
            others, is_missing = self._one(name, peers[name], me)
            found += others
            missing += [name] if is_missing else []
        return found, missing

    def _one(self, name: str, peer: Peer, me: Self) -> tuple[list[Neighbour], bool]:
        """Return one drone, at each possible position; and whether it is missing."""
        if peer.is_on_ground(me.now_ns):
            self._before.pop(name, None)
            self._forget(name)
            return [], False
        if peer.launch is None and name in self._before:
            peer.launch = self._before[name].launch
        if peer.pose is None and name in self._before and self._is_missing(name, me):
            self._recall(name, peer, me.now_ns)
        if peer.pose is None:
            self._forget(name)
            return list(self._of_unknown(name, peer, me)), self._is_missing(name, me)
        self._before.pop(name, None)
        self._following.compare(name, peer, peer.pose)
        other = Other(name, peer, peer.pose, self.frames.of(name, peer.pose))
        if me.now_ns - peer.pose.stamp_ns <= SILENT_NS:
            return self._of_heard(other, me)
        is_missing = other.may_take_part or (peer.status is None and me.may_fly(name))
        return list(self._of_silent(other, me)), is_missing

    def _forget(self, name: str) -> None:
        """Forget a drone on the ground, or without a position so far."""
        self._silent.forget(name)
        self._heard_again.forget(name)

    def _of_heard(self, other: Other, me: Self) -> tuple[list[Neighbour], bool]:
        """Return a heard drone at each possible position; it is missing if it does not hear this drone."""
        name, pose = other.name, other.pose
        is_carried = name in self.frames.epochs
        self._heard_again.follow(name, pose.stamp_ns, self._silent.agentless(name), is_carried=is_carried)
        apart: list[PeerPlan] | None = []
        if me.revoked:  # a return needs no separation line
            self._silent.ignores(name)
        else:
            apart = self._unhearing(other, me)
        if apart is None:
            self._silent.forget(name)
        found = [Neighbour(name, one, False) for one in apart or ()]
        plan = self._heard.by_frames(other, me)
        takes_part = other.took_part and plan is not None and apart is None
        plan = plan or self._heard.without_frames(other, me)
        if plan is not None:
            followed = replace(plan, deviation_m=self._following.deviation_m(name), blind=plan.blind or apart is not None)
            found.append(Neighbour(name, followed, takes_part))
        found += self._of_unplaced(name, inf if plan is None else plan.sigma_m, me)
        found += (Neighbour(name, place, False) for place in (*self._heard.elsewhere(other, me), *self._stop(other, me)))
        return found, other.may_take_part and apart is not None

    def _of_unplaced(self, name: str, sigma_m: float, me: Self) -> Iterator[Neighbour]:
        """Return further positions of a peer with a new link and an uncertain place (``heardagain``), by its error (1 sigma)."""
        if me.local_from_mission is not None and sigma_m >= WORST_SIGMA_M:
            for one in self._heard_again.plans(name, me.viewer(me.local_from_mission)):
                yield Neighbour(name, one, False)

    def _unhearing(self, other: Other, me: Self) -> list[PeerPlan] | None:
        """Return the side left to a one-way peer; None for a two-way link, according to its plans."""
        name, pose, plan, status = other.name, other.pose, other.peer.plan, other.peer.status
        known = self._silent.last_contact(name)
        if known is not None and not _hears(other.peer, self._id, known.stamp_ns):
            return self._apart(other, known, me)
        if known is not None or plan is None or not isinstance(plan.unheard, tuple) or self._id not in plan.unheard:
            if status is not None:
                self._while_heard[name] = status.stage, me.circle
            return None
        is_known = self._silent.is_unhearing(name)
        if not is_known and me.now_ns - plan.stamp_ns > RECENT_NS:
            return None
        if status is None or other.mission_from_theirs is None:
            return [] if is_known else None
        stamp_ns = plan.stamp_ns - SILENT_NS  # the stamp at which it noticed, less the delay of noticing
        poses = (one for one in other.peer.poses if one.epoch == pose.epoch)
        last = min(poses, key=lambda one: abs(one.stamp_ns - stamp_ns), default=pose)
        stage, circle = self._while_heard.get(name, (status.stage, me.circle))
        mine = me.motion_at(last.stamp_ns)
        contact = self._silent.contact(name, other.peer, last, bare(other.mission_from_theirs), stage, circle, mine)
        return self._apart(other, contact, me)

    def _apart(self, other: Other, contact: Contact, me: Self) -> list[PeerPlan]:
        """Return the side left to a peer that has not heard this drone since this contact."""
        frame = other.mission_from_theirs
        sigma_m = WORST_SIGMA_M if frame is None else between_sigma_m(other.pose, frame, me)
        viewer = me.viewer(me.local_from_mission) if me.local_from_mission is not None else None
        return self._silent.unhearing(other.name, contact, sigma_m, viewer)

    def obeys(self, name: str, now_ns: int) -> None:
        """Note that a revoked drone obeys, and is on its way home."""
        self._silent.obeys(name, now_ns)

    def _is_missing(self, name: str, me: Self) -> bool:
        """Whether a drone never heard has been able to fly for long enough: its measurements may precede its first pose."""
        return me.may_fly(name) and not 0 <= me.now_ns - self._unheard_ns.setdefault(name, me.now_ns) < SILENT_NS

    def _recall(self, name: str, peer: Peer, now_ns: int) -> None:
        """Restore the last messages of a drone without a link since a restart of this agent; its frame is known from before."""
        news = self._before[name]
        if self.frames.of(name, news.pose) is not None:
            pose, status = news.told_before(now_ns - SILENT_NS - 1)
            peer.recall(pose, status)
            self._silent.recall(name, pose.stamp_ns, news.wall)

    def follow(self, peers: Peers) -> None:
        """Update the frames of the other drones while this drone plans nothing: a jump is bridged only as it happens."""
        for name in peers.names:
            peer = peers[name]
            if peer.pose is not None and not peer.is_on_ground(peer.pose.stamp_ns):
                self.frames.of(name, peer.pose)

    def _of_unknown(self, name: str, peer: Peer, me: Self) -> Iterator[Neighbour]:
        """Return a drone never heard, or revoked on the ground before the start of this agent: in flight at its sightings, or
        descending over its home.
        """
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
        """Return a lost peer: by sightings since the last pose, or at all possible positions."""
        name, peer, pose = other.name, other.peer, other.pose
        viewer = me.viewer(me.local_from_mission) if me.local_from_mission is not None else None
        recent = [one for one in peer.sightings if one.stamp_ns > pose.stamp_ns + _STOPPED_NS]
        fastest_mps = max(self._fastest_mps, speed_of_mps(pose))
        if (seen := placed_by_sightings(name, recent, fastest_mps, me.epoch, me.now_ns, former=True)) is not None:
            self._heard_again.forget(name)
            if viewer is None or self._silent.seen(name, pose.stamp_ns, seen, viewer):
                yield Neighbour(name, replace(seen, blind=True), False)
        elif (peer.status is not None or me.may_fly(name)) and viewer is not None:
            yield from self._of_unseen(other, viewer, me)

    def _of_unseen(self, other: Other, viewer: Viewer, me: Self) -> Iterator[Neighbour]:
        """Return a lost peer without sightings: at all possible positions, at first also along its last plan."""
        name, peer, pose, frame = other.name, other.peer, other.pose, other.mission_from_theirs
        if frame is None:
            return
        otherwise = self.frames.elsewhere(name, pose, frame)
        frames = [bare(one) for one in (frame, otherwise) if one is not None]
        sigma_m = min(hypot(me.place_sigma_m, sigma_of_either_m(pose, frame, otherwise)), WORST_SIGMA_M)
        plans = self._silent.plans(name, peer, pose, frames, sigma_m, viewer)
        circled = peer.status is not None and peer.status.stage in CIRCLING
        oldest_ns = LEAVING_NS if circled else OLDEST_NS
        if (last := self._following.plan(name, peer, pose, me.now_ns, oldest_ns)) is not None:
            plans += [planned(name, last, viewer.local_from_mission @ one, sigma_m, me.now_ns) for one in frames]
        yield from (Neighbour(name, plan, False) for plan in plans)
        yield from self._of_unplaced(name, sigma_m, me)

    def _stop(self, other: Other, me: Self) -> Iterator[PeerPlan]:
        """Return the stop of a quiet peer in failsafe; nothing while its poses arrive."""
        if other.mission_from_theirs is None or me.local_from_mission is None:
            return
        if me.now_ns - other.pose.stamp_ns >= QUIET_NS + other.peer.usual_delay_ns:
            frame, viewer = bare(other.mission_from_theirs), me.viewer(me.local_from_mission)
            yield self._silent.stop(other.name, other.peer, other.pose, frame, viewer)


def _hears(peer: Peer, me: str, contact_ns: int) -> bool:
    """Whether a drone has reported since the last contact that it hears this one, ``me``. Source: its newest plan, or its status
    if it publishes no plans any more.

    After a silence the first pose arrives before any newer plan or status. An older report proves nothing. If it counted, only
    this side would forget the last contact, and with it the separation line. A plan lists the drones not heard for a second, a
    status the drones heard in the last three.
    """
    plan, status = peer.plan, peer.status
    newest_ns = contact_ns if plan is None else max(contact_ns, plan.stamp_ns)
    if status is not None and status.stamp_ns > newest_ns + HEARD_NS:
        return me in status.delays_ns
    if plan is None or plan.stamp_ns <= contact_ns + SILENT_NS:
        return False
    return not isinstance(plan.unheard, tuple) or me not in plan.unheard


def _is_same(one: Neighbour, other: Neighbour, now_ns: int) -> bool:
    """Whether both are the same drone at the same position, as with sightings: independent of the own position estimate."""
    if one.id != other.id or one.plan.away is not None or other.plan.away is not None:
        return False
    return dist(one.plan.at(now_ns), other.plan.at(now_ns)) < _SAME_M
