"""Newest pose, plan and status of every other drone, and this drone's relative observations of it."""

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
_MOST_DELAYS = 8  # of the last messages of a second: ten poses, and as many plans
_MOST_SIGHTINGS = 256  # maximum number, whatever their stamps
FUTURE_NS = 100_000_000  # limit of a stamp ahead of now: beyond, it is forged, or of a clock not yet known to be wrong
_LONGEST_MISSION_NS = 86_400_000_000_000  # a start longer ago than this comes from a wrong clock


M = TypeVar("M", Plan, Status)


@dataclass(slots=True)
class Peer:
    """Newest message of each kind, stamped in own time; None until heard. ``sources``: all stories of its position;
    ``sightings`` (by this drone): of the last seconds.
    ``ahead_ns``: lead of its clock over own time, as corrected in its stamps; ``delays_ns``: apparent delays of the last
    messages that were kept, without that correction.
    """

    plan: Plan | None = None
    status: Status | None = None
    sources: Sources = field(default_factory=Sources)
    ahead_ns: int = 0
    delays_ns: deque[int] = field(default_factory=partial(deque, maxlen=_MOST_DELAYS))
    sightings: deque[Sighting] = field(default_factory=partial(deque, maxlen=_MOST_SIGHTINGS))

    @property
    def poses(self) -> deque[Pose]:
        """Poses of the last seconds, by the first story; empty until one is heard."""
        return self.sources.stories[0].poses if self.sources.stories else deque()

    @property
    def pose(self) -> Pose | None:
        """The newest pose; None until heard."""
        return self.sources.stories[0].newest if self.sources.stories else None

    @property
    def stage(self) -> Stage | None:
        """The stage by the newest pose or status; None if never published. A stage on the ground in contradiction to the poses
        does not count: a restarted agent does not know of its flight yet.
        """
        pose, status = self.pose, self.status
        if pose is None or (status is not None and status.stamp_ns >= pose.stamp_ns):
            return status.stage if status is not None else None
        if isinstance(pose.stage, Stage) and (pose.stage not in ON_GROUND or self.sources.rests(pose.stamp_ns)):
            return pose.stage
        return status.stage if status is not None else None

    def is_on_ground(self, now_ns: int) -> bool:
        """Whether statuses and poses say so, without a plan since: a status may be lost."""
        flies = self.plan is not None and self.status is not None and self.plan.stamp_ns > self.status.stamp_ns
        return not flies and self.sources.is_on_ground(now_ns)

    def last_pose(self, now_ns: int) -> Pose | None:
        """Return the last pose, with the newest stage; None if one of these was never heard, or the drone is on the ground."""
        if self.pose is None or self.stage is None or self.is_on_ground(now_ns):
            return None
        return replace(self.pose, stage=self.stage)

    def recall(self, pose: Pose) -> None:
        """Restore the pose from before a restart of this agent; none has been heard since."""
        self.sources.stories.append(Story.of(pose))

    @property
    def usual_delay_ns(self) -> int:
        """Median delay of the newest messages, by their stamps; 0 without any."""
        if not self.delays_ns:
            return 0
        return max(0, sorted(self.delays_ns)[len(self.delays_ns) // 2] + self.ahead_ns)

    def reckon_clock(self, ahead_ns: int, delay_ns: int, now_ns: int) -> None:
        """Apply a new lead of its clock, from a message with this apparent delay, at ``now_ns``.

        Two causes: a new estimate of the same clock, or a step of that clock. After a new estimate, its earlier messages move
        along, or its next pose would seem to be a jump. After a step they stay: their stamps were right by the former clock. A
        step changes the apparent delays by as much as the estimate; a new estimate alone does not. The smallest earlier delay
        counts, because queueing only ever makes a message later. Nothing moves into the future: all later messages would be older
        than known.
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
        """Correct the stamps of its messages by a new estimate of its clock."""
        self.plan, self.status = _restamped(self.plan, by_ns), _restamped(self.status, by_ns)
        self.sources.restamp(by_ns)

    def take(self, message: Pose | Plan | Status, now_ns: int) -> str | None:
        """Keep a message if it is newer than known; an older one still counts for ``sources``. Return the reason of a refusal."""
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
        """Whether a status on the ground is in contradiction to its poses.

        Causes: a landing just now; a restart of its agent in flight, before it knows of the flight; or a second source.
        """
        flew = self.stage is not None and self.stage not in ON_GROUND
        return flew and status.stage in ON_GROUND and not self.sources.rests(status.stamp_ns)


def is_present(stamp_ns: int, now_ns: int) -> bool:
    """Whether a stamp is neither too old nor in the future."""
    return now_ns - OLDEST_NS <= stamp_ns <= now_ns + FUTURE_NS


def _restamped(message: M | None, by_ns: int) -> M | None:
    return replace(message, stamp_ns=message.stamp_ns + by_ns) if message is not None else None


class Peers:
    """The other drones of the mission, by id; all stamps in own time."""

    def __init__(self, ids: list[str]) -> None:
        self._peers = {name: Peer() for name in ids}

    def __getitem__(self, drone: str) -> Peer:
        return self._peers[drone]

    @property
    def names(self) -> list[str]:
        """Ids of all, heard or not, sorted."""
        return sorted(self._peers)

    def receive(self, message: Pose | Plan | Status, now_ns: int, ahead_ns: int | None = None) -> str | None:
        """Keep a message, stamped in own time, if its stamp is newer. Return the reason of a refusal, or None.

        ahead_ns: the correction in that stamp, the lead of the sender's clock over own time; None: as before.
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
        """Keep this drone's own sighting of another one."""
        sightings = self._peers[sighting.target].sightings
        sightings.append(sighting)
        newest_ns = max(sightings[0].stamp_ns, sighting.stamp_ns)
        while sightings[0].stamp_ns < newest_ns - RECENT_NS:
            sightings.popleft()

    def disowned(self, drone: str, now_ns: int) -> None:
        """Note a drone's statement that some messages under its id are not its own."""
        if drone in self._peers:
            self._peers[drone].sources.disowned(now_ns)

    def are_two(self, drone: str, now_ns: int) -> bool:
        """Whether two sources have lately sent under a drone's id."""
        return drone in self._peers and self._peers[drone].sources.are_two(now_ns)

    def problems(self, now_ns: int) -> tuple[CodedText, ...]:
        """Problems of drones with two sources under one id, as texts."""
        told = (self._peers[name].sources.problem(name, now_ns) for name in self.names)
        return tuple(text for text in told if text is not None)

    def statuses(self, now_ns: int) -> dict[str, Status]:
        """The newest status of each drone that has sent one recently."""
        return {
            name: peer.status
            for name, peer in self._peers.items()
            if peer.status is not None and now_ns - peer.status.stamp_ns < STATUS_AGE_NS
        }

    def begun_ns(self, mission: str, now_ns: int, utc_ns: int) -> int | None:
        """Return the begin of that mission: the stamp (UTC) of a start command reported by most drones in it, the earliest of
        several; None: no drone reports one. A majority, because one false start would change which entries a restarted drone
        counts. ``now_ns``, ``utc_ns``: the present, in own time and by the own clock.
        """
        told = (status.started_ns for status in self.statuses(now_ns).values() if status.mission == mission)
        known = Counter(began for began in told if began is not None and utc_ns - began < _LONGEST_MISSION_NS)
        return min(known, key=lambda began: (-known[began], began), default=None)
