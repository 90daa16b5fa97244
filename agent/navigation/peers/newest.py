"""Newest pose, plan and status of every other drone, and this drone's sightings of it."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

from msgspec.structs import replace

from radron.agent.navigation.peers.sources import RECENT_NS, Sources, Story
from radron.protocol.entries import Sighting
from radron.protocol.messages import Plan, Pose, Stage, Status
from radron.protocol.stages import ON_GROUND
from radron.protocol.texts import CodedText

NEWS = (Pose, Plan, Status)
OLDEST_NS = 2_000_000_000  # an older message is dropped
STATUS_AGE_NS = 10_000_000_000  # an older status does not count: the drone is switched off
_MOST_DELAYS = 8  # delays kept of a drone's last messages, about half a second of them
_MOST_SIGHTINGS = 256  # maximum number of sightings kept, whatever their stamps
FUTURE_NS = 100_000_000  # limit of a stamp ahead of now: a later one is forged, or of a clock not yet known to be wrong
_LONGEST_MISSION_NS = 86_400_000_000_000  # a start longer ago than this is stamped by a wrong clock


M = TypeVar("M", Plan, Status)


@dataclass(slots=True)
class Peer:
    """Newest messages of one other drone, with stamps in own time; None until one is heard.

    sources: its poses, by the sender that they seem to come from (``peers.sources``).
    ahead_ns: lead of its clock over own time; the stamps are corrected by it.
    delays_ns: delays of its last messages, own time at the arrival minus the stamp without that correction.
    sightings: of it by this drone, in the last seconds.
    """

    plan: Plan | None = None
    status: Status | None = None
    sources: Sources = field(default_factory=Sources)
    ahead_ns: int = 0
    delays_ns: deque[int] = field(default_factory=partial(deque, maxlen=_MOST_DELAYS))
    sightings: deque[Sighting] = field(default_factory=partial(deque, maxlen=_MOST_SIGHTINGS))

    @property
    def poses(self) -> deque[Pose]:
        """Poses of the last seconds, oldest first, of the sender that counts as the drone itself; empty until one is heard."""
        return self.sources.stories[0].poses if self.sources.stories else deque()

    @property
    def pose(self) -> Pose | None:
        """The newest pose; None until heard."""
        return self.sources.stories[0].newest if self.sources.stories else None

    @property
    def stage(self) -> Stage | None:
        """The stage by the newest pose or status; None if never published. A pose's stage on the ground does not count while
        the poses show a flight: a restarted agent does not know yet that its vehicle flies.
        """
        pose, status = self.pose, self.status
        if pose is None or (status is not None and status.stamp_ns >= pose.stamp_ns):
            return status.stage if status is not None else None
        if isinstance(pose.stage, Stage) and (pose.stage not in ON_GROUND or self.sources.rests(pose.stamp_ns)):
            return pose.stage
        return status.stage if status is not None else None

    def is_on_ground(self, now_ns: int) -> bool:
        """Whether the drone is on the ground by its statuses and poses, and has published no plan since (a status of its takeoff
        may be lost).
        """
        flies = self.plan is not None and self.status is not None and self.plan.stamp_ns > self.status.stamp_ns
        return not flies and self.sources.is_on_ground(now_ns)

    def last_pose(self, now_ns: int) -> Pose | None:
        """Return the last pose, with the newest stage in it; None if no pose or no stage was heard, or the drone is on the
        ground.
        """
        if self.pose is None or self.stage is None or self.is_on_ground(now_ns):
            return None
        return replace(self.pose, stage=self.stage)

    def recall(self, pose: Pose) -> None:
        """Restore the drone's last pose from before a restart of this agent; no pose may have been heard since."""
        self.sources.stories.append(Story.of(pose))

    @property
    def usual_delay_ns(self) -> int:
        """Median delay (ns) of the newest messages; 0 without any."""
        if not self.delays_ns:
            return 0
        return max(0, sorted(self.delays_ns)[len(self.delays_ns) // 2] + self.ahead_ns)

    def reckon_clock(self, ahead_ns: int, delay_ns: int, now_ns: int) -> None:
        """Apply a new lead of its clock over own time, and correct the stamps of its earlier messages if they were wrong.

        ``delay_ns``: delay of the message that arrives now, as in ``delays_ns``. There are two causes of a new lead. With a
        better estimate of the same clock, the stamps of earlier messages are corrected, or its next pose would seem to be a jump.
        After a step of its clock they stay, because they were right by the former clock. A step changes the delay by as much as
        the lead; a better estimate does not. The delay is compared with the smallest earlier one, because queueing only makes
        messages later. No stamp moves into the future: then all later messages would count as older than known.
        """
        by_ns = self.ahead_ns - ahead_ns
        if by_ns == 0:
            return
        grown_ns = delay_ns - min(self.delays_ns, default=delay_ns)
        newest_ns = max((one.stamp_ns for one in (self.pose, self.plan, self.status) if one is not None), default=now_ns - by_ns)
        if abs(grown_ns) <= abs(grown_ns - by_ns) and newest_ns + by_ns <= now_ns + FUTURE_NS:
            self._restamp(by_ns)
        else:
            self.delays_ns.clear()
        self.ahead_ns = ahead_ns

    def _restamp(self, by_ns: int) -> None:
        """Move the stamps of all its messages by ``by_ns``, for a better estimate of its clock."""
        self.plan, self.status = _restamped(self.plan, by_ns), _restamped(self.status, by_ns)
        self.sources.restamp(by_ns)

    def take(self, message: Pose | Plan | Status, now_ns: int) -> str | None:
        """Keep a message, stamped in own time, if it is newer than the known one. Return the reason of a refusal, or None.

        An older message still counts as a sign of another sender (``sources``).
        """
        if isinstance(message, Pose):
            return None if self.sources.hear_pose(message, now_ns) else "older_than_known"
        if isinstance(message, Status):
            self.sources.hear_status(message, now_ns)
        known = self.plan if isinstance(message, Plan) else self.status
        if known is not None and known.stamp_ns >= message.stamp_ns:
            return "older_than_known"
        if isinstance(message, Plan):
            self.plan = message
        elif self.is_refuted(message):
            return "refuted_by_poses"
        else:
            self.status = message
        return None

    def is_refuted(self, status: Status) -> bool:
        """Whether a status says "on the ground" while the poses show a flight.

        Causes: a landing just now; a restart of its agent in flight, which does not know yet that it flies; or a second sender
        under its id.
        """
        flew = self.stage is not None and self.stage not in ON_GROUND
        return flew and status.stage in ON_GROUND and not self.sources.rests(status.stamp_ns)


def is_present(stamp_ns: int, now_ns: int) -> bool:
    """Whether a stamp is at most 2 s old, and not in the future (with a tolerance of 0.1 s)."""
    return now_ns - OLDEST_NS <= stamp_ns <= now_ns + FUTURE_NS


def _restamped(message: M | None, by_ns: int) -> M | None:
    return replace(message, stamp_ns=message.stamp_ns + by_ns) if message is not None else None


class Peers:
    """Newest messages of all other drones of the mission, by id; all stamps in own time."""

    def __init__(self, ids: list[str]) -> None:
        self._peers = {name: Peer() for name in ids}

    def __getitem__(self, drone: str) -> Peer:
        return self._peers[drone]

    @property
    def names(self) -> list[str]:
        """Ids of all other drones of the mission, heard or not, sorted."""
        return sorted(self._peers)

    def receive(self, message: Pose | Plan | Status, now_ns: int, ahead_ns: int | None = None) -> str | None:
        """Keep a message, stamped in own time, if it is newer than the known one. Return the reason of a refusal, or None.

        ``ahead_ns``: lead of the sender's clock over own time, by which the stamp is corrected; None: as before.
        """
        peer = self._peers.get(message.drone)
        if peer is None:
            return "unknown_drone"
        if message.stamp_ns < now_ns - OLDEST_NS:
            return "stale"
        if message.stamp_ns > now_ns + FUTURE_NS:
            return "from_the_future"
        delay_ns = now_ns - message.stamp_ns - (peer.ahead_ns if ahead_ns is None else ahead_ns)
        if ahead_ns is not None:
            peer.reckon_clock(ahead_ns, delay_ns, now_ns)
        dropped = peer.take(message, now_ns)
        if dropped is None:
            peer.delays_ns.append(delay_ns)
        return dropped

    def see(self, sighting: Sighting) -> None:
        """Keep a sighting of another drone by this one, and drop those that are 3 s older than the newest."""
        sightings = self._peers[sighting.target].sightings
        sightings.append(sighting)
        newest_ns = max(sightings[0].stamp_ns, sighting.stamp_ns)
        while sightings[0].stamp_ns < newest_ns - RECENT_NS:
            sightings.popleft()

    def disowned(self, drone: str, now_ns: int) -> None:
        """Note that a drone reports messages under its id that it did not send."""
        if drone in self._peers:
            self._peers[drone].sources.disowned(now_ns)

    def are_two(self, drone: str, now_ns: int) -> bool:
        """Whether two senders under a drone's id were proven in the last 10 s."""
        return drone in self._peers and self._peers[drone].sources.are_two(now_ns)

    def problems(self, now_ns: int) -> tuple[CodedText, ...]:
        """Return a problem for the operator for each drone under whose id two senders publish."""
        told = (self._peers[name].sources.problem(name, now_ns) for name in self.names)
        return tuple(text for text in told if text is not None)

    def statuses(self, now_ns: int) -> dict[str, Status]:
        """Return the newest status of each drone that has sent one in the last 10 s, by id."""
        return {
            name: peer.status
            for name, peer in self._peers.items()
            if peer.status is not None and now_ns - peer.status.stamp_ns < STATUS_AGE_NS
        }

    def begun_ns(self, mission: str, now_ns: int, utc_ns: int) -> int | None:
        """Return the begin of a mission: the stamp (UTC) of the start command that most drones in it report. Of equally many
        reports the earliest; None if no drone reports one.

        The majority counts, because a false begin would change which log entries a restarted drone counts. ``now_ns``,
        ``utc_ns``: the present, in own time and by the own clock.
        """
        told = (status.started_ns for status in self.statuses(now_ns).values() if status.mission == mission)
        known = Counter(began for began in told if began is not None and utc_ns - began < _LONGEST_MISSION_NS)
        return min(known, key=lambda began: (-known[began], began), default=None)
