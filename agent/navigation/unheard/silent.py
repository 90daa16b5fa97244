"""Possible positions of a lost peer that flew at the last contact. Separation covers them for as long as they are possible.

Two causes of the silence cannot be told apart:

- loss of its agent: its autopilot flies (``agentless``).
- loss of the radio alone: the peer flies on, and cannot hear this drone either. If both were on the circle, they leave for
  circles of different radius and height (``radron.agent.motion.orbit``). Otherwise both keep to their own sides of the separation
  line, half-way between the positions at which they notice the loss (``lines``).

If the peer was seen after its last pose, and is occluded now, all this begins at the last sighting (``lastseen``). The last
pose may be minutes old, and its prediction 20 m and more beside the flight.

A revoked peer that has reported obedience climbs on the spot and returns: its circle is free. Without that report it may circle
as before.

A one-way peer, heard but without reception of this drone, expects the same of it. Therefore this drone acts as after a loss in
both directions. It keeps to its side of the same line. On the circle it stands for as long as that peer does, and then leaves for
its own circle. It also gives way to the peer's published plans.

Positions are horizontal, mission frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array
from radron.agent.motion.reference import PeerState
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.peers.newest import Peer, Peers
from radron.agent.navigation.unheard.absence import Absence
from radron.agent.navigation.unheard.agentless import Agentless, Course, Stretch
from radron.agent.navigation.unheard.contact import SILENT_NS, Circle, Contact, Wall, motion_of
from radron.agent.navigation.unheard.crossing import is_over_m
from radron.agent.navigation.unheard.homes import Homes
from radron.agent.navigation.unheard.lastcourses import last_course, last_stage, possible_courses
from radron.agent.navigation.unheard.lastseen import LastSeen, LastSightings
from radron.agent.navigation.unheard.lines import Lines
from radron.agent.navigation.unheard.relayed import is_kept, relayed
from radron.agent.navigation.unheard.sides import ring_of, side
from radron.agent.navigation.unheard.viewer import Viewer
from radron.agent.navigation.unheard.wayaround import KeptPlace
from radron.protocol.messages import Pose, Stage
from radron.protocol.stages import CIRCLING, MAY_TAKE_PART

# Delay beyond the usual one: four poses are missing. The agent may be lost, and its vehicle stops soon. Behind it at 6 m/s, a
# drone that notices only after a second cannot stop any more.
QUIET_NS = 400_000_000
LEFT_S = 15.0  # a vehicle that hovers for longer than this is flown around
# A failsafe return this many times the separation above a drone, or higher, passes over it: the purpose of the altitude layers.
# Otherwise its way across the circle would keep drones from their places for a quarter of a minute.
_ABOVE = 2.0
_SIGMA_M = 0.3  # deviation from the failsafe course to the side
_LOW_M = 1.5  # a vehicle seen no higher may be on the ground


class Silent:
    """Lost and one-way peers of a mission."""

    def __init__(self, mission: MissionConfig, drone: str) -> None:
        """``drone``: the own id."""
        self._id, self._order = drone, [member.id for member in mission.drones]
        self._agentless = Agentless(mission)
        self._lines, self._homes = Lines(mission), Homes(mission, drone, self._agentless)
        self._above_m = _ABOVE * mission.limits.separation_m
        self._is_over_m = is_over_m(mission, drone)
        self._courses: dict[str, tuple[int, list[Course]]] = {}  # failsafe courses, with the stamp of the last contact
        self._unhearing: set[str] = set()  # one-way peers
        self._sights = LastSightings()
        self._excluded_ns: dict[str, int] = {}  # begin of the revocation, as known here, of drones never heard
        self._obeys_ns: dict[str, int] = {}  # first report of obedience by a revoked drone

    def recall(self, name: str, heard_ns: int, wall: Wall | None) -> None:
        """Restore the separation line from before a restart of this agent, if any; ``heard_ns``: stamp of the last contact."""
        if wall is not None:
            self._lines.recall(name, heard_ns, wall)

    def wall(self, name: str, heard_ns: int) -> Wall | None:
        """Return the separation line to a lost peer, valid at present or expired; None if a one-way link has existed since the
        last contact.
        """
        contact = self._lines.contact(name)
        return self._lines.wall(name) if contact is None or contact.stamp_ns == heard_ns else None

    def forget(self, name: str) -> None:
        """Forget the line, courses and home of a drone: it has a two-way link, is on the ground, or was never heard."""
        self._lines.forget(name)
        self._courses.pop(name, None)
        self._homes.forget(name)
        self._unhearing.discard(name)

    def agentless(self, name: str) -> tuple[int, list[Course]] | None:
        """Return the failsafe courses of a drone, and their begin; None if it is heard, or on the ground."""
        return self._courses.get(name)

    def obeys(self, name: str, now_ns: int) -> None:
        """Note that a revoked drone obeys, and is on its way home."""
        self._obeys_ns.setdefault(name, now_ns)

    def last_contact(self, name: str) -> Contact | None:
        """Return the last contact with a lost or one-way peer; None for a two-way link."""
        return self._lines.contact(name)

    def is_unhearing(self, name: str) -> bool:
        """Whether the drone is a one-way peer by the last messages."""
        return name in self._unhearing

    def seen(self, name: str, heard_ns: int | None, seen: PeerPlan, me: Viewer) -> bool:
        """Note a sighting, own local frame, of a peer without a pose since ``heard_ns`` (None: never heard), and return whether
        it may fly. Not near the ground after so long a silence that its vehicle must be down: there it would block neighbouring
        homes for good.
        """
        self._unhearing.discard(name)
        self._homes.forget(name)
        place = seen.positions[0]
        x, y, _ = me.local_from_mission.inverse().apply_point(place)
        if heard_ns is not None:
            self._courses[name] = heard_ns, [Course(Stretch((x, y), (x, y)), LEFT_S)]
        above_ground_m = place[2] - (float(me.ahead()[0, 2]) - me.height_m)
        may_fly = heard_ns is not None and me.now_ns - heard_ns < self._agentless.longest_s(name) * 1e9
        flies = above_ground_m > _LOW_M or may_fly
        self._sights.note(name, seen, me.epoch, flies=flies)
        return flies

    def returning(self, peers: Peers, now_ns: int) -> tuple[str, ...]:
        """Return the lost peers that returned at the last contact, and may still fly.

        They return low; this drone must not assume that they are in their altitude layers.
        """
        told = {name: news for name in peers.names if (news := peers[name].last_news(now_ns)) is not None}
        silent_ns = {name: now_ns - pose.stamp_ns for name, (pose, status) in told.items() if status.stage is Stage.RETURN}
        return tuple(name for name, for_ns in silent_ns.items() if SILENT_NS < for_ns < self._agentless.longest_s(name) * 1e9)

    def absence(self, missing: Sequence[str], partners: Sequence[str], peers: Peers, now_ns: int) -> Absence:
        """Return the consequences of the links to ``missing`` drones. ``partners``: two-way peers that take part."""
        unhearing = tuple(name for name in missing if name in self._unhearing)
        left = tuple(name for name in missing if self._has_left(name, now_ns))
        last_ns = {name: self._last_ns(name, peers[name]) for name in missing}
        heard_by_others = relayed(last_ns, partners, peers)
        ring = ring_of(side(self._id, missing, partners, peers, now_ns), self._order, missing, left)
        if any(self._order.index(name) < self._order.index(self._id) for name in heard_by_others):
            ring = self._order.index(self._id)  # the other one is in the same component, and stays
        kept = tuple(name for name in missing if is_kept(name, last_ns[name], partners, peers, now_ns))
        walls, alone = self._lines.at(now_ns), bool(missing) and not partners
        unparted = [name for name in missing if name not in left and name not in walls]
        cut_off = set(missing) if alone or (ring > 0 and len(missing) - len(left) > 1) else heard_by_others
        anywhere = tuple(name for name in unparted if self._may_be_anywhere(name, peers[name], now_ns, cut_off=name in cut_off))
        stops, coming = self._stops(now_ns), self._coming_home(now_ns)
        return Absence(tuple(missing), unhearing, ring, kept, walls, alone, stops, coming, self.homes, left, anywhere)

    def _stops(self, now_ns: int) -> Array:
        """Both ends of each stretch on which a vehicle may hover before it flies home without its agent; (M, 2)."""
        contacts = [(name, self._lines.contact(name)) for name in sorted(self._unhearing)]
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
        """Missing drones that may be on a failsafe return, and not down yet."""
        return tuple(
            name
            for name, (stamp_ns, courses) in sorted(self._courses.items())
            if any((now_ns - stamp_ns) * 1e-9 < course.down_s for course in courses)
        )

    @property
    def homes(self) -> tuple[KeptPlace, ...]:
        """Keep-out places on the way home, because other drones may descend or hover there; mission frame."""
        courses = (course for _, (_, all_of_one) in sorted(self._courses.items()) for course in all_of_one)
        return (*self._homes.kept, *(KeptPlace(place, _SIGMA_M) for course in courses for place in course.hovers))

    def _has_left(self, name: str, now_ns: int) -> bool:
        """Whether a revoked drone that obeys has climbed from the circle."""
        since_ns = self._obeys_ns.get(name)
        return since_ns is not None and now_ns - since_ns >= LEFT_S * 1e9

    def _last_ns(self, name: str, peer: Peer) -> int | None:
        """Return the stamp of the last contact with a missing drone; None: never heard."""
        contact = self._lines.contact(name)
        return contact.stamp_ns if contact is not None else peer.pose.stamp_ns if peer.pose is not None else None

    def _may_be_anywhere(self, name: str, peer: Peer, now_ns: int, *, cut_off: bool) -> bool:
        """Whether a missing drone without a valid line to this one took part, or may have, and may still do so.

        By default the missing drone counts as down when its failsafe course, or a line to it, has ended. An isolated drone must
        not assume that (``cut_off``): its silent peers may fly on. The same holds for a network component without the first
        circle, if two or more missing drones may hear each other. It also holds for a missing drone with a link to a third drone.
        """
        if peer.status is None:  # it has measured, or may have taken off before a restart of this agent; or it is revoked
            since_ns = self._excluded_ns.get(name, now_ns)
            return cut_off and (now_ns - since_ns) * 1e-9 < self._agentless.longest_s(name)
        if name not in self._courses or peer.status.stage not in MAY_TAKE_PART:
            return False
        silent_s = (now_ns - self._courses[name][0]) * 1e-9
        return cut_off or (self._lines.wall(name) is None and silent_s < self._agentless.longest_s(name))

    def plans(self, name: str, peer: Peer, pose: Pose, frames: Sequence[Transform], sigma_m: float, me: Viewer) -> list[PeerPlan]:
        """Return the possible positions along the horizon, each nearest to this drone's own plan.

        ``frames``: mission from its own: the frame of its flight, and the frame of its alternative position hypothesis, if any
        (``peers.doubted``).
        """
        self._unhearing.discard(name)
        self._homes.forget(name)
        wall = self._wall_now(name, peer, pose, frames[0], me)
        found = [] if wall is None or me.height_m > self._is_over_m else [me.beyond(name, wall, sigma_m)]
        found += self._homes.coming_down(name, self._agentless.home(name, peer, frames[-1]), me)
        last = self._sights.of(name, pose.stamp_ns, me.epoch)
        moves = None if last is None else me.in_mission(last.moves)
        courses = possible_courses(self._agentless, name, peer, pose, frames, moves, excluded=name in me.excluded)
        return found + self._along(name, courses, pose.stamp_ns, last, sigma_m, me)

    def _along(
        self, name: str, courses: list[Course], heard_ns: int, last: LastSeen | None, sigma_m: float, me: Viewer
    ) -> list[PeerPlan]:
        """Return the possible positions on these courses since the last pose or sighting."""
        since_ns = heard_ns if last is None else last.stamp_ns
        self._courses[name] = since_ns, courses
        own_way, silent_s = me.way(), (me.now_ns - since_ns) * 1e-9
        ahead, below_m = own_way[:, :2], float(own_way[:, 2].max()) + self._above_m
        times: Array = silent_s + me.step_s * np.arange(float(len(ahead)))
        found = []
        stops: list[Stretch] = []  # each once: steering has room for three half-planes in each step
        for course in courses:
            # Homes are apart. This drone, if revoked, ignores the peer's uncertainty once the peer must be at home. Otherwise
            # that would keep it from its own home until the other drones take it to have landed.
            is_late = me.revoked and me.now_ns - heard_ns >= course.arrives_s * 1e9
            doubt_m = 0.0 if is_late else hypot(sigma_m, _SIGMA_M)
            if course.way is not None and silent_s < course.down_s:
                self._homes.keep(name, course.way[1], doubt_m)
            for stretch in course.stretches(times, below_m):
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
        """Return the stop of a quiet peer in failsafe, nearest to this drone's own plan."""
        ahead = me.way()[:, :2]
        times: Array = (me.now_ns - pose.stamp_ns) * 1e-9 + me.step_s * np.arange(float(len(ahead)))
        course = last_course(self._agentless, name, peer, pose, mission_from_theirs)
        return me.expects(name, course.stops(times).nearest(ahead), _SIGMA_M)

    def contact(
        self,
        name: str,
        peer: Peer,
        pose: Pose,
        mission_from_theirs: Transform,
        stage: Stage,
        circle: Circle | None,
        mine: PeerState | None,
    ) -> Contact:
        """Return a contact at this pose. ``stage``: its own then; ``circle``: of this drone; ``mine``: motion of this drone."""
        course = last_course(self._agentless, name, peer, pose, mission_from_theirs)
        theirs = motion_of(pose, mission_from_theirs)
        tracked = circle is not None and stage in CIRCLING
        circled = tracked and circle is not None and mine is not None and circle.has(theirs) and circle.has(mine)
        return Contact(pose.stamp_ns, course, stage, theirs, tracked, circled)

    def unhearing(self, name: str, contact: Contact, sigma_m: float, me: Viewer | None) -> list[PeerPlan]:
        """Return the side beyond the separation line, left to a one-way peer. ``contact``: the last one, unless an earlier one is
        known; ``me``: None while the own frame is not known.
        """
        self.ignores(name)
        known = self._lines.noted(name, contact)
        if me is None or me.height_m > self._is_over_m:
            return []
        wall = self._lines.of(name, known, me)
        return [] if wall is None else [me.beyond(name, wall, sigma_m)]

    def ignores(self, name: str) -> None:
        """Note a one-way peer, heard without reception of this drone: neither courses nor a home are kept for it."""
        self._courses.pop(name, None)
        self._homes.forget(name)
        self._unhearing.add(name)

    def unknown(self, name: str, me: Viewer, *, excluded: bool) -> list[PeerPlan]:
        """Return the possible positions of a drone never heard: revoked before the start of this agent, or out of reach since.

        ``excluded``: revoked; it returns whatever this drone does, and waits over home if other drones hinder it.
        """
        home = self._agentless.launch(name)
        self._homes.forget(name)
        found = self._homes.coming_down(name, home, me)
        if excluded:
            silent_s = (me.now_ns - self._excluded_ns.setdefault(name, me.now_ns)) * 1e-9
            found = [self._homes.over(name, home, me)] if silent_s < self._agentless.longest_s(name) else found
        return found

    def hidden(self, name: str, me: Viewer) -> list[PeerPlan]:
        """Return the possible positions of a drone that was never heard, but was seen in flight."""
        if (last := self._sights.of(name, 0, me.epoch)) is None:
            return []
        course = self._agentless.course(name, me.in_mission(last.moves), Stage.SURVEY, self._agentless.launch(name))
        return self._along(name, [course], last.stamp_ns, last, 0.0, me)

    def _wall_now(self, name: str, peer: Peer, pose: Pose, mission_from_theirs: Transform, me: Viewer) -> Wall | None:
        """Return the separation line between this drone and a lost peer, while valid."""
        contact = self._lines.contact(name)
        if contact is None:
            mine = me.motion_at(pose.stamp_ns)
            contact = self._lines.noted(
                name, self.contact(name, peer, pose, mission_from_theirs, last_stage(peer), me.circle, mine)
            )
        if me.revoked:  # no line during a return: a wait over home for its end would end among returning drones
            self._lines.drop(name)
            return None
        contact = replace(contact, circled=contact.circled and me.circle is not None)
        return self._lines.of(name, contact, me)
