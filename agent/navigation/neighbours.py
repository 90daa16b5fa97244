"""The predicted motion of the other drones, in this drone's local frame, as the input of separation.

One that is heard is placed by its frame, its news and the own sightings of it (``heard``).

One that was never heard may fly, too, where this agent was started in flight, or after that one had measured something: it was
revoked before, or is out of reach. It counts as missing, like one that is not heard any more; and so does one of which poses were
heard for a moment, but never a status. Where this drone sees it fly, that is where it is.

One whose exactly known localisation has jumped unannounced may be in either of two places, and separation is kept from both, and
as seen from both where this drone is the one (``doubted``); so it is from one whose poses and plans contradict each other,
although its agent steers it: one of them is false; once it lands, it may stand where its last plan led. One whose localisation
has jumped while it was not heard may have flown home meanwhile (``heardagain``).

From a flying drone that is not heard any more separation is kept where it is seen, or else wherever it may be (``silent``), and
where a plan of up to two seconds ago leads: messages may only be lost, or take as long; one that circled stands there then, until
it leaves. One that is heard, but whose plans tell that it does not hear this drone, never gives way, and does not take part.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import dist, hypot, inf

from msgspec import Struct
from msgspec.structs import replace

from agent.config.mission import MissionConfig
from agent.frames.graph import FrameGraph
from agent.localization.clocks import HEARD_NS
from agent.motion.separation import PeerPlan
from agent.navigation.heard import Heard, Other, between_sigma_m, sigma_of_either_m
from agent.navigation.myself import Self
from agent.navigation.peers.following import Following
from agent.navigation.peers.newest import OLDEST_NS, Peer, Peers
from agent.navigation.peers.placing import WORST_SIGMA_M, bare, placed_by_sightings, planned, speed_of_mps
from agent.navigation.peers.sources import RECENT_NS
from agent.navigation.peers.theirframes import TheirFrames
from agent.navigation.unheard.absence import Absence
from agent.navigation.unheard.contact import SILENT_NS, Circle, Contact
from agent.navigation.unheard.heardagain import HeardAgain
from agent.navigation.unheard.lastnews import LastNews
from agent.navigation.unheard.relayed import LEAVING_NS
from agent.navigation.unheard.silent import QUIET_NS, Silent
from agent.navigation.unheard.viewer import Viewer
from protocol.messages import Stage
from protocol.stages import CIRCLING

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

    ``absence``: of those that took part, or may do so, and are not heard, as of the last ``around``; None where there are none,
    and none returns unheard while this drone does. ``listens``: for less than a second it has known that others may fly that it
    has never heard. ``unheard``: those that are not heard, and may fly, also on their way home.
    """

    def __init__(self, mission: MissionConfig, frames: FrameGraph, drone: str) -> None:
        """``drone``: the own id."""
        self.frames = TheirFrames(mission, frames)
        self._following = Following()
        self._heard = Heard(mission, self.frames, self._following)
        self._silent, self._heard_again = Silent(mission, drone), HeardAgain()
        self._id, self._fastest_mps = drone, mission.limits.speed_mps
        # The stage of each that hears this drone, and the circle of this one then.
        self._while_heard: dict[str, tuple[Stage, Circle | None]] = {}
        self._unheard_ns: dict[str, int] = {}  # who was never heard: since when it may fly
        self._before: dict[str, LastNews] = {}  # the news of before a restart of this agent, of those not heard since
        self.absence: Absence | None = None
        self.listens, self.unheard = False, tuple[str, ...]()

    def last_news(self, peers: Peers, now_ns: int) -> dict[str, LastNews]:
        """What is known of the others that fly, or may, for an agent that is restarted in flight."""
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
        """Take what was known of the others before this agent was restarted."""
        self._before = dict(before)

    def around(self, peers: Peers, me: Self) -> list[Neighbour]:
        """All drones that are not on the ground and can be located, by id; then as they lie to it if it is elsewhere."""
        self._silent.keep_time(peers.set_ns)
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
        """All drones as they lie to this one if its frame is right; and who is missing."""
        found: list[Neighbour] = []
        missing = []
        for name in peers.names:
            others, is_missing = self._one(name, peers[name], me)
            found += others
            missing += [name] if is_missing else []
        return found, missing

    def _one(self, name: str, peer: Peer, me: Self) -> tuple[list[Neighbour], bool]:
        """One drone, at each place where it may be; and whether it is missing."""
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
        """It is on the ground, or has not told yet where it is."""
        self._silent.forget(name)
        self._heard_again.forget(name)

    def _of_heard(self, other: Other, me: Self) -> tuple[list[Neighbour], bool]:
        """One that is heard; it is missing if it does not hear this drone."""
        name, pose = other.name, other.pose
        is_carried = name in self.frames.epochs
        self._heard_again.follow(name, pose.stamp_ns, self._silent.agentless(name), is_carried=is_carried)
        apart: list[PeerPlan] | None = []
        if me.revoked:  # it returns: there is no side to keep to
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
        """Where else one may be that was heard again, and is not placed (``heardagain``), by its error (1 sigma)."""
        if me.local_from_mission is not None and sigma_m >= WORST_SIGMA_M:
            for one in self._heard_again.plans(name, me.viewer(me.local_from_mission)):
                yield Neighbour(name, one, False)

    def _unhearing(self, other: Other, me: Self) -> list[PeerPlan] | None:
        """What is left to a drone that is heard, but does not hear this one; None where it does, as far as its plans tell."""
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
        stamp_ns = plan.stamp_ns - SILENT_NS  # it has noticed then
        poses = (one for one in other.peer.poses if one.epoch == pose.epoch)
        last = min(poses, key=lambda one: abs(one.stamp_ns - stamp_ns), default=pose)
        stage, circle = self._while_heard.get(name, (status.stage, me.circle))
        mine = me.motion_at(last.stamp_ns)
        contact = self._silent.contact(name, other.peer, last, bare(other.mission_from_theirs), stage, circle, mine)
        return self._apart(other, contact, me)

    def _apart(self, other: Other, contact: Contact, me: Self) -> list[PeerPlan]:
        """The side that is left to a drone that does not hear this one since this contact."""
        frame = other.mission_from_theirs
        sigma_m = WORST_SIGMA_M if frame is None else between_sigma_m(other.pose, frame, me)
        viewer = me.viewer(me.local_from_mission) if me.local_from_mission is not None else None
        return self._silent.unhearing(other.name, contact, sigma_m, viewer)

    def obeys(self, name: str, now_ns: int) -> None:
        """It is revoked, and on its way home."""
        self._silent.obeys(name, now_ns)

    def _is_missing(self, name: str, me: Self) -> bool:
        """Whether one that was never heard may fly, for long enough; its measurements may come before its first pose does."""
        return me.may_fly(name) and not 0 <= me.now_ns - self._unheard_ns.setdefault(name, me.now_ns) < SILENT_NS

    def _recall(self, name: str, peer: Peer, now_ns: int) -> None:
        """It has not been heard since a restart of this agent, which knows of it, and of its frame, from before."""
        news = self._before[name]
        if self.frames.of(name, news.pose) is not None:
            pose, status = news.told_before(now_ns - SILENT_NS - 1)
            peer.recall(pose, status)
            self._silent.recall(name, pose.stamp_ns, news.wall)

    def follow(self, peers: Peers) -> None:
        """Keep the frames of the others while this drone plans nothing: a jump is bridged only as it happens."""
        for name in peers.names:
            peer = peers[name]
            if peer.pose is not None and not peer.is_on_ground(peer.pose.stamp_ns):
                self.frames.of(name, peer.pose)

    def _of_unknown(self, name: str, peer: Peer, me: Self) -> Iterator[Neighbour]:
        """One that was never heard: where it is seen to fly, or where it may come down; also if it was revoked before this agent
        was started, on the ground.
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
        """A drone not heard any more: by sightings since then, or wherever it may be."""
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
        """One that is neither heard nor seen: wherever it may be, at first also where its last plan leads."""
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
        """Where one comes to rest if its agent is gone; nowhere as long as its poses come."""
        if other.mission_from_theirs is None or me.local_from_mission is None:
            return
        if me.now_ns - other.pose.stamp_ns >= QUIET_NS + other.peer.usual_delay_ns:
            frame, viewer = bare(other.mission_from_theirs), me.viewer(me.local_from_mission)
            yield self._silent.stop(other.name, other.peer, other.pose, frame, viewer)


def _hears(peer: Peer, me: str, contact_ns: int) -> bool:
    """Whether a drone has told since the last contact that it hears this one, ``me``: by its newest plan, or where it publishes
    none any more, by its status.

    After a silence the first pose comes before a plan or status of after it. What it told before tells nothing: taken for word
    that it hears this drone, the last contact was forgotten, and the line that follows from it, on this side only (0.61 m). A
    plan lists whom it has not heard for a second, a status whom it has heard in the last three.
    """
    plan, status = peer.plan, peer.status
    newest_ns = contact_ns if plan is None else max(contact_ns, plan.stamp_ns)
    if status is not None and status.stamp_ns > newest_ns + HEARD_NS:
        return me in status.delays_ns
    if plan is None or plan.stamp_ns <= contact_ns + SILENT_NS:
        return False
    return not isinstance(plan.unheard, tuple) or me not in plan.unheard


def _is_same(one: Neighbour, other: Neighbour, now_ns: int) -> bool:
    """Whether both are the same drone at the same place, as one that is seen: it lies there wherever this drone is."""
    if one.id != other.id or one.plan.away is not None or other.plan.away is not None:
        return False
    return dist(one.plan.at(now_ns), other.plan.at(now_ns)) < _SAME_M
