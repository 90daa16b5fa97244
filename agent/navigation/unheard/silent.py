"""Possible positions of a peer with a lost link that flew at the last contact. Separation is kept from all that are possible.

Two causes of the silence cannot be distinguished:

- loss of its agent: the autopilot flies the vehicle alone (``agentless``).
- loss of the radio link alone: the peer flies on, and does not hear this drone either. If both were on the circle, they leave
  for circles of different radius and height (``radron.agent.motion.orbit``). Otherwise each keeps to its side of the separation
  line, half-way between the positions at which they notice the loss (``lines``).

If the peer was seen after its last pose, and is occluded now, its possible courses begin at the last sighting (``lastseen``). The
last pose may be minutes old, and its prediction wrong by 20 m and more.

A revoked peer that reports obedience climbs on the spot and returns: its circle becomes free. Without that report it may circle
as before.

A one-way peer (heard, but it does not hear this drone) expects the same of this drone. So this drone acts as after a loss in both
directions: it keeps to its side of the same line; on the circle it stops for as long as that peer does, and then leaves for its
own circle. It also gives way to the peer's published plans.

Positions are horizontal, mission frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot

import numpy as np
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array
from radron.agent.motion.reference import PeerState
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.others.belief import PeerBelief
from radron.agent.navigation.peers.newest import Peer, Peers
from radron.agent.navigation.unheard.absence import Absence
from radron.agent.navigation.unheard.agentless import Agentless, Course, Stretch
from radron.agent.navigation.unheard.contact import Contact, LinkState, Wall, last_contact_ns, motion_of
from radron.agent.navigation.unheard.crossing import is_over_m
from radron.agent.navigation.unheard.homes import Homes
from radron.agent.navigation.unheard.lastcourses import last_course, possible_courses, stage_at
from radron.agent.navigation.unheard.lastseen import LastSeen
from radron.agent.navigation.unheard.lines import APART_NS, Line, line_of, tracked_line_ns
from radron.agent.navigation.unheard.relayed import is_kept, relayed
from radron.agent.navigation.unheard.sides import ring_of, side
from radron.agent.navigation.unheard.viewer import Viewer
from radron.agent.navigation.unheard.wayaround import KeptPlace
from radron.protocol.messages import Pose, Stage
from radron.protocol.stages import CIRCLING, MAY_TAKE_PART

# Circling drones wait for at most this long until a hovering vehicle leaves; then they fly around it. Also the time after which a
# revoked drone that obeys has left the circle.
LEFT_S = 15.0
# A failsafe return this many times the separation above a drone, or higher, is no obstacle: altitude layers separate both.
# Otherwise its way across the circle would keep drones from their places for a quarter of a minute.
_ABOVE = 2.0
_SIGMA_M = 0.3  # 1 sigma of a vehicle's deviation from its failsafe course, to the side
_LOW_M = 1.5  # a vehicle that is seen no higher above the ground may have landed


Links = Mapping[str, LinkState]


class Silent:
    """Possible positions of the drones without a two-way link, and the consequences for this drone.

    ``beliefs``: the knowledge about each other drone, by id. In all methods, ``me``: state of this drone; ``frames`` and
    ``mission_from_theirs``: transforms from the peer's local frame.
    """

    def __init__(self, mission: MissionConfig, drone: str) -> None:
        """``drone``: the own id."""
        self._id, self._order = drone, [member.id for member in mission.drones]
        self._agentless = Agentless(mission)
        self.beliefs = {member.id: PeerBelief() for member in mission.drones if member.id != drone}
        self._homes = Homes(mission, drone, self.beliefs)
        self._tracked_ns = tracked_line_ns(mission)
        self._separation_m = mission.limits.separation_m
        self._is_over_m = is_over_m(mission, drone)

    def recall(self, name: str, pose: Pose, wall: Wall | None) -> None:
        """Restore the separation line to a peer from before a restart of this agent; ``pose``: the peer's last one. ``wall``
        None: no line.
        """
        if wall is not None:
            self.beliefs[name].line = Line(wall, last_contact_ns(pose, self._id), APART_NS)

    def seen(self, name: str, heard_ns: int | None, seen: PeerPlan, me: Viewer) -> bool:
        """Note that a drone without a link is seen, and return whether it may fly.

        ``heard_ns``: stamp of its last pose, None: never heard; ``seen``: its position by sightings, own local frame. It counts
        as landed if it is seen near the ground, and was never heard, or has been silent for longer than the longest return takes.
        Otherwise it would block neighbouring homes for good.
        """
        belief, place = self.beliefs[name], seen.positions[0]
        belief.kept.clear()
        x, y, _ = me.local_from_mission.inverse().apply_point(place)
        if heard_ns is not None:
            belief.courses_ns, belief.courses = heard_ns, [Course(Stretch((x, y), (x, y)), LEFT_S)]
        above_ground_m = place[2] - (float(me.ahead()[0, 2]) - me.height_m)
        may_fly = heard_ns is not None and me.now_ns - heard_ns < self._agentless.longest_s(name) * 1e9
        flies = above_ground_m > _LOW_M or may_fly
        measured = seen.measured if flies else None
        belief.seen = None if measured is None else LastSeen.by(seen, measured, me.epoch)
        return flies

    def returning(self, peers: Peers, links: Links, now_ns: int) -> tuple[str, ...]:
        """Return the lost peers that were returning at the last contact, and may still fly.

        They may return at low height; this drone must not assume that they are in their altitude layers.
        """
        poses = {name: pose for name, link in links.items() if link is LinkState.LOST and (pose := peers[name].pose) is not None}
        return tuple(
            name
            for name, pose in poses.items()
            if peers[name].stage is Stage.RETURN and now_ns - pose.stamp_ns < self._agentless.longest_s(name) * 1e9
        )

    def absence(self, missing: Sequence[str], partners: Sequence[str], peers: Peers, links: Links, now_ns: int) -> Absence:
        """Return the consequences of the missing drones for this one. ``partners``: peers with a two-way link that take part;
        ``links``: the state of the link to each other drone.
        """
        unhearing = tuple(name for name in missing if links[name] is LinkState.ONE_WAY)
        left = tuple(name for name in missing if self._has_left(name, now_ns))
        last_ns = {name: self._last_ns(name, peers[name]) for name in missing}
        heard_by_others = relayed(last_ns, partners, peers)
        ring = ring_of(side(self._id, missing, partners, peers, now_ns), self._order, missing, left)
        if any(self._order.index(name) < self._order.index(self._id) for name in heard_by_others):
            ring = self._order.index(self._id)  # that drone is in the same component, and keeps its circle; this one leaves it
        kept = tuple(name for name in missing if is_kept(name, last_ns[name], partners, peers, now_ns))
        lines = {name: belief.line for name, belief in sorted(self.beliefs.items())}
        walls = {name: line.wall for name, line in lines.items() if line is not None and line.holds(now_ns)}
        alone = bool(missing) and not partners
        unparted = [name for name in missing if name not in left and name not in walls]
        cut_off = set(missing) if alone or (ring > 0 and len(missing) - len(left) > 1) else heard_by_others
        anywhere = tuple(name for name in unparted if self._may_be_anywhere(name, peers[name], now_ns, cut_off=name in cut_off))
        stops, coming = self._stops(links, now_ns), self._coming_home(now_ns)
        return Absence(tuple(missing), unhearing, ring, kept, walls, alone, stops, coming, self.homes, left, anywhere)

    def _stops(self, links: Links, now_ns: int) -> Array:
        """Return both ends (M, 2) of each stretch on which a vehicle without its agent may hover before it leaves."""
        contacts = [(name, self.beliefs[name].contact) for name, link in links.items() if link is LinkState.ONE_WAY]
        last = {name: (one.stamp_ns, [one.course]) for name, one in contacts if one is not None}
        ends = [
            end
            for _, (stamp_ns, courses) in sorted({**self._courses, **last}.items())
            for course in courses
            if (now_ns - stamp_ns) * 1e-9 < min(LEFT_S, course.leaves_s)
            for end in (course.stop.start, course.stop.end)
        ]
        return np.array(ends).reshape(-1, 2)

    def _coming_home(self, now_ns: int) -> tuple[str, ...]:
        """Return the lost drones whose vehicles may be on a failsafe return, and need not have landed yet."""
        return tuple(
            name
            for name, (stamp_ns, courses) in self._courses.items()
            if any((now_ns - stamp_ns) * 1e-9 < course.down_s for course in courses)
        )

    @property
    def _courses(self) -> dict[str, tuple[int, Sequence[Course]]]:
        """Possible failsafe courses of each lost drone, with the stamp of their begin; by id, sorted."""
        known = sorted(self.beliefs.items())
        return {name: (belief.courses_ns, belief.courses) for name, belief in known if belief.courses is not None}

    @property
    def homes(self) -> tuple[KeptPlace, ...]:
        """Keep-out discs for the way home: other drones may descend or hover there; mission frame."""
        courses = (course for _, (_, all_of_one) in self._courses.items() for course in all_of_one)
        return (*self._homes.kept, *(KeptPlace(place, _SIGMA_M) for course in courses for place in course.hovers))

    def _has_left(self, name: str, now_ns: int) -> bool:
        """Whether a revoked drone reported 15 s ago or earlier that it obeys: it has climbed away from the circle."""
        since_ns = self.beliefs[name].obeys_ns
        return since_ns is not None and now_ns - since_ns >= LEFT_S * 1e9

    def _last_ns(self, name: str, peer: Peer) -> int | None:
        """Return the stamp of the last contact with a missing drone; None: never heard."""
        if (contact := self.beliefs[name].contact) is not None:
            return contact.stamp_ns
        return last_contact_ns(peer.pose, self._id) if peer.pose is not None else None

    def _may_be_anywhere(self, name: str, peer: Peer, now_ns: int, *, cut_off: bool) -> bool:
        """Whether a missing drone without a valid separation line may still fly, at an unknown position.

        ``cut_off``: this drone must not assume that it has landed; then only its last stage counts. This holds if this drone is
        isolated, if a third drone hears the missing drone, and in a network component without circle 0 that misses two
        drones or more, which may hear each other. Otherwise a missing drone counts as landed once its failsafe course, or a
        separation line to it, has ended.
        """
        belief = self.beliefs[name]
        if peer.stage is None:  # it has measured, or may have taken off before a restart of this agent; or it is revoked
            since_ns = now_ns if belief.excluded_ns is None else belief.excluded_ns
            return cut_off and (now_ns - since_ns) * 1e-9 < self._agentless.longest_s(name)
        if belief.courses is None or peer.stage not in MAY_TAKE_PART:
            return False
        silent_s = (now_ns - belief.courses_ns) * 1e-9
        return cut_off or (belief.line is None and silent_s < self._agentless.longest_s(name))

    def plans(self, name: str, peer: Peer, pose: Pose, frames: Sequence[Transform], sigma_m: float, me: Viewer) -> list[PeerPlan]:
        """Return the possible positions of a lost peer as obstacles, each by its points nearest to this drone's plan.

        ``pose``: its last one; ``frames``: transforms from its local frame to the mission frame: by its continuous motion, and,
        after a jump of its localisation, by that localisation (``TheirFrames.elsewhere``); ``sigma_m``: 1 sigma of its position
        relative to this drone.
        """
        self.beliefs[name].kept.clear()
        wall = self._wall_now(name, peer, pose, frames[0], me)
        found = [] if wall is None or me.height_m > self._is_over_m else [me.beyond(name, wall, sigma_m)]
        last, home = self._last_seen(name, pose.stamp_ns, me.epoch), self._agentless.home(name, pose)
        moves = None if last is None else me.in_mission(last.moves)
        steered = pose.steered and moves is None
        begins = [moves or motion_of(pose, frame) for frame in frames]
        returns = [self._agentless.return_of(name, begin, home, steered=steered) for begin in begins]
        since_ns = pose.stamp_ns if last is None else last.stamp_ns
        found += self._homes.coming_down(name, home, me, [(since_ns, course) for course in returns])
        courses = possible_courses(self._agentless, name, peer, pose, frames, moves, excluded=name in me.excluded)
        return found + self._along(name, courses, pose.stamp_ns, last, sigma_m, me)

    def _along(
        self, name: str, courses: list[Course], heard_ns: int, last: LastSeen | None, sigma_m: float, me: Viewer
    ) -> list[PeerPlan]:
        """Return the possible positions on these courses as obstacles. ``heard_ns``: stamp of the last pose; ``last``: the last
        sighting, if it is newer.
        """
        since_ns = heard_ns if last is None else last.stamp_ns
        self.beliefs[name].courses_ns, self.beliefs[name].courses = since_ns, courses
        own_way, times = me.way(), me.times_since(since_ns)
        ahead, heights_m, silent_s = own_way[:, :2], own_way[:, 2], float(times[0])
        below_m, above_m = heights_m + _ABOVE * self._separation_m, heights_m - self._separation_m
        found = []
        stops: list[Stretch] = []  # each stop counts once, because steering uses only three half-planes in each step
        for course in courses:
            # Once the peer must be at home, a revoked drone ignores the peer's position uncertainty, because homes are apart.
            # Otherwise it would be kept from its own home for longer than the other drones expect it to be in flight.
            is_late = me.revoked and me.now_ns - heard_ns >= course.arrives_s * 1e9
            doubt_m = 0.0 if is_late else hypot(sigma_m, _SIGMA_M)
            if course.way is not None and silent_s < course.down_s:
                self._homes.keep(name, course.way[1], doubt_m)
            for stretch in course.stretches(times, below_m, above_m):
                if course.is_stop(stretch):
                    if any(course.is_stop(known) for known in stops):
                        continue
                    stops.append(stretch)
                place_m = doubt_m
                if last is not None and course.is_stop(stretch) and not is_late:
                    place_m = last.sigma_after_m(silent_s if course.way is not None else 0.0)  # a vehicle in hold stays
                found.append(me.expects(name, stretch.nearest(ahead), place_m))
        return found

    def stop(self, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform, me: Viewer) -> PeerPlan:
        """Return, as an obstacle, the stretch on which a quiet peer comes to rest if its agent is lost: its points nearest to
        this drone's plan.
        """
        course = last_course(self._agentless, name, peer, pose, mission_from_theirs)
        return me.expects(name, course.stops(me.times_since(pose.stamp_ns)).nearest(me.way()[:, :2]), _SIGMA_M)

    def _contact(self, name: str, peer: Peer, newest: Pose, mission_from_theirs: Transform, me: Viewer) -> Contact:
        """Return the last contact with a lost or one-way peer: the stored one, or else by its newest pose."""
        belief = self.beliefs[name]
        if belief.contact is not None:
            return belief.contact
        stamp_ns = last_contact_ns(newest, self._id)
        poses = (one for one in peer.poses if one.epoch == newest.epoch)
        pose = min(poses, key=lambda one: abs(one.stamp_ns - stamp_ns), default=newest)
        course = last_course(self._agentless, name, peer, pose, mission_from_theirs)
        stage, theirs, mine = stage_at(pose, peer), motion_of(pose, mission_from_theirs), me.motion_at(stamp_ns)
        tracked = me.circle is not None and stage in CIRCLING
        circled = tracked and me.circle is not None and mine is not None and me.circle.has(theirs) and me.circle.has(mine)
        belief.contact = Contact(stamp_ns, course, stage, theirs, tracked, circled)
        return belief.contact

    def beyond_line(
        self, name: str, peer: Peer, pose: Pose, frame: Transform | None, sigma_m: float, me: Viewer | None
    ) -> list[PeerPlan]:
        """Return, as an obstacle, the other side of the separation line to a one-way peer; empty without a line, or above all low
        flight.

        ``frame``: transform from the peer's local frame to the mission frame, None while it is not known; ``sigma_m``: 1 sigma of
        the peer's position relative to this drone; ``me``: None while the frame of this drone is not known.
        """
        contact = self.beliefs[name].contact
        if me is not None and contact is None and frame is not None and peer.stage is not None:
            contact = self._contact(name, peer, pose, frame, me)
        if me is None or contact is None or me.height_m > self._is_over_m:
            return []
        wall = self._wall(name, contact, me)
        return [] if wall is None else [me.beyond(name, wall, sigma_m)]

    def unknown(self, name: str, me: Viewer, *, excluded: bool) -> list[PeerPlan]:
        """Return, as an obstacle, the home of a drone never heard, while it may descend there; else empty.

        Such a drone was revoked before the start of this agent, or has been out of radio range since. ``excluded``: it is
        revoked, returns whatever this drone does, and waits over home if other drones hinder its landing.
        """
        belief, home = self.beliefs[name], self._agentless.launch(name)
        belief.kept.clear()
        found = self._homes.coming_down(name, home, me, [(0, self._agentless.return_of(name, PeerState(home), home))])
        if excluded:
            belief.excluded_ns = me.now_ns if belief.excluded_ns is None else belief.excluded_ns
            silent_s = (me.now_ns - belief.excluded_ns) * 1e-9
            found = [self._homes.over(name, home, me)] if silent_s < self._agentless.longest_s(name) else found
        return found

    def hidden(self, name: str, me: Viewer) -> list[PeerPlan]:
        """Return, as obstacles, the possible positions since the last sighting of a drone that was never heard."""
        if (last := self._last_seen(name, 0, me.epoch)) is None:
            return []
        course = self._agentless.course(name, me.in_mission(last.moves), Stage.SURVEY, self._agentless.launch(name))
        return self._along(name, [course], last.stamp_ns, last, 0.0, me)

    def _wall_now(self, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform, me: Viewer) -> Wall | None:
        """Return the valid separation line between this drone and a lost peer; None without one, or if this drone is revoked."""
        contact = self._contact(name, peer, pose, mission_from_theirs, me)
        if me.revoked:  # it returns without a line: while it waited over home for the end of a line, other drones would return
            self.beliefs[name].line = None
            return None
        contact = replace(contact, circled=contact.circled and me.circle is not None)
        return self._wall(name, contact, me)

    def _wall(self, name: str, contact: Contact, me: Viewer) -> Wall | None:
        """Return the valid separation line by the last contact with a peer; None without one."""
        line = line_of(self.beliefs[name].line, contact, self._tracked_ns, me)
        if line is None:
            return None
        self.beliefs[name].line = line
        return line.wall if line.holds(me.now_ns) else None

    def _last_seen(self, name: str, heard_ns: int, epoch: int) -> LastSeen | None:
        """Return the last sighting of a drone; None without one since its last pose (``heard_ns``), or if this drone's local
        frame has changed since.
        """
        last = self.beliefs[name].seen
        return last if last is not None and last.epoch == epoch and last.stamp_ns > heard_ns else None
