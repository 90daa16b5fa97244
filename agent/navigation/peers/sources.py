"""Check whether the messages under one drone's id come from one sender, and all its possible positions if they may not.

A sender is called a source in names and in the problem for the operator. A second one may hold a copy of the drone's key, or be
the drone's agent, started twice. No message proves its sender: any holder of the key can write anything, also the source ids of
Zenoh. So no message makes another one invalid, whatever its stamp. It can add a possible position, or an end of the flight that
all other messages allow.

A *story* is a sequence of poses through which one vehicle can have flown. A pose that continues no known story begins a new one.
Each story is a possible position until it has had no pose for two seconds. A drone is on the ground when no status and no pose of
the last seconds says that it flies.

A new story is no proof of a second sender: a localisation jumps, or a clock is stepped. Proofs are poses that go back and forth
between two stories, statuses of two boots (starts of the agent) that both continue, and the drone's own report of messages that
it never sent. Only a second sender can forge that report.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, field
from functools import partial
from math import dist, hypot
from operator import mul

from msgspec.structs import replace

from radron.protocol.codes import Code
from radron.protocol.messages import Pose, Status
from radron.protocol.stages import ON_GROUND
from radron.protocol.texts import CodedText

FASTEST_MPS = 20.0  # faster than any vehicle of the swarm, also in a failsafe or under a safety pilot
SLACK_M, SIGMAS, MAX_DOUBT_M = 1.5, 3.0, 5.0  # tolerance for localisation errors of two poses: 1.5 m and 3 sigma, at most 5 m
# Deviation of a pose from the motion of the pose before it: with a larger one, the pose belongs to another story.
SAME_M, SAME_MPS, MAX_ACCELERATION_MPS2 = 0.5, 2.0, 10.0
RECENT_NS = 3_000_000_000  # poses are kept for this long
RIVAL_NS = 2_000_000_000  # separation is kept from the position of another story for this long after its last pose
SILENT_NS = 500_000_000  # after this time without poses of the first story, a story with newer poses becomes the first
SHOWN_NS = 10_000_000_000  # for this long after a proof, two senders are reported and assumed
FRESH_NS = 2_500_000_000  # a status in flight counts for this long beside later ones: two periods and a half
REST_NS = 2_000_000_000  # a drone is on the ground after this time with poses at rest alone
DOWN_NS = 120_000_000_000  # by then a vehicle on a failsafe return has landed
MAX_REST_MPS = 1.0  # greatest apparent speed of a drone on the ground
MAX_BOOTS = 4  # number of boots that are remembered
MAX_STORIES = 4
MIN_TURNS = 3  # changes between contradictory stories that prove two senders: a localisation that jumps and back makes two


def contradict(one: Pose, other: Pose) -> bool:
    """Whether no vehicle can have had both poses: it would be too fast. For poses of two epochs: the later one has the earlier
    epoch.
    """
    if one.epoch != other.epoch:
        return (one.epoch < other.epoch) != (one.stamp_ns <= other.stamp_ns)
    doubt_m = min(SLACK_M + SIGMAS * max(map(_sigma_m, (one, other))), MAX_DOUBT_M)
    return dist(one.position_m, other.position_m) > doubt_m + FASTEST_MPS * 1e-9 * abs(one.stamp_ns - other.stamp_ns)


@dataclass(slots=True)
class Story:
    """Poses of the last seconds through which one vehicle can have flown, in the order of their stamps; never empty.

    ``began_ns``: stamp of the first pose of the story, also if that is older and not kept.
    """

    poses: deque[Pose]
    began_ns: int

    @classmethod
    def of(cls, *poses: Pose) -> Story:
        """Return a story that consists of these poses, given in the order of their stamps."""
        return cls(deque(poses), poses[0].stamp_ns)

    @property
    def newest(self) -> Pose:
        """The pose with the latest stamp."""
        return self.poses[-1]

    def fits(self, pose: Pose) -> bool:
        """Whether one vehicle can have flown through a pose and the poses before and after it in this story."""
        place = bisect_right(self.poses, pose.stamp_ns, key=_stamp)
        before = place == 0 or _leads(self.poses[place - 1], pose)
        return before and (place == len(self.poses) or _leads(pose, self.poses[place]))

    def take(self, pose: Pose) -> bool:
        """Add a pose that fits, if it is newer than all others. Return whether it was added."""
        if pose.stamp_ns <= self.newest.stamp_ns:
            return False
        self.poses.append(pose)
        while self.poses[0].stamp_ns < pose.stamp_ns - RECENT_NS:
            self.poses.popleft()
        return True

    def split(self, pose: Pose) -> Story | None:
        """Divide this story if a pose continues an earlier epoch of it beside a later one. Keep the poses up to the epoch of
        ``pose``, and return the poses of later epochs as a story of their own.

        None, without any change, if there is nothing to divide, or if the pose does not fit the earlier part either.
        """
        earlier = [one for one in self.poses if one.epoch <= pose.epoch]
        later = [one for one in self.poses if one.epoch > pose.epoch]
        if not earlier or not later or not Story.of(*earlier).fits(pose):
            return None
        self.poses = deque(earlier)
        return Story.of(*later)


@dataclass(slots=True)
class Sources:
    """Stories under one drone's id. The first of ``stories`` counts as the drone's own flight, until it has no poses any more."""

    stories: list[Story] = field(default_factory=list)
    _told: Story | None = None  # the story of the last pose
    _turns_ns: deque[int] = field(default_factory=partial(deque, maxlen=MIN_TURNS))
    _shown_ns: int | None = None  # stamp of the last proof of two senders
    _boots_ns: dict[str, int] = field(default_factory=dict)  # stamp of the first status of each boot, in the order of the boots
    _aloft_ns: int | None = None  # stamp of the last pose of a vehicle in flight
    _rests_ns: int | None = None  # stamp of the first pose at rest since then
    _flew_ns: int | None = None  # stamp of the last status in flight
    _down_ns: int | None = None  # stamp of the last status on the ground

    def hear_pose(self, pose: Pose, now_ns: int) -> bool:
        """Add a pose, whatever its stamp, to the story that it fits, or to a new one. Return whether it is the newest of its
        story.
        """
        if pose.in_air or hypot(*pose.velocity_mps) > MAX_REST_MPS:
            self._aloft_ns, self._rests_ns = max(pose.stamp_ns, self._aloft_ns or 0), None
        elif self._rests_ns is None:
            self._rests_ns = pose.stamp_ns
        fitting = (one for one in self.stories if one.fits(pose))
        story = min(fitting, key=lambda one: one.newest.epoch != pose.epoch, default=None) or self._divided(pose)
        if story is not None and not story.take(pose):
            return False
        story = story or self._begun(pose)
        self._note_turn(story, pose, now_ns)
        if story is not self.stories[0] and pose.stamp_ns - self.stories[0].newest.stamp_ns > SILENT_NS:
            self.stories.remove(story)
            self.stories.insert(0, story)
        return True

    def hear_status(self, status: Status, now_ns: int) -> None:
        """Note the boot and the stage (in flight or on the ground) of a status, whatever its stamp."""
        newest = next(reversed(self._boots_ns), status.boot)
        if status.boot != newest and status.boot in self._boots_ns and status.stamp_ns > self._boots_ns[newest]:
            self._shown_ns = now_ns  # a boot that continues after a later one
        self._boots_ns.setdefault(status.boot, status.stamp_ns)
        if len(self._boots_ns) > MAX_BOOTS:
            del self._boots_ns[next(iter(self._boots_ns))]
        if status.stage in ON_GROUND:
            self._down_ns = max(status.stamp_ns, self._down_ns or 0)
        else:
            self._flew_ns = max(status.stamp_ns, self._flew_ns or 0)

    def disowned(self, now_ns: int) -> None:
        """Note that the drone reports messages under its id that it did not send. The report counts for ``FRESH_NS``, until the
        next statuses are due.
        """
        self._shown_ns = max(self._shown_ns or 0, now_ns - SHOWN_NS + FRESH_NS)

    def second_places(self, now_ns: int) -> list[Pose]:
        """Return the newest pose of each other story: further possible positions of the drone."""
        return [one.newest for one in self.stories[1:] if now_ns - one.newest.stamp_ns < RIVAL_NS]

    def are_two(self, now_ns: int) -> bool:
        """Whether two senders were proven in the last 10 s."""
        return self._shown_ns is not None and now_ns - self._shown_ns < SHOWN_NS

    def is_on_ground(self, now_ns: int) -> bool:
        """Whether the drone is on the ground: a status says so, no later status and no status of the last 2.5 s reports a flight,
        and its poses are at rest (``rests``).
        """
        if self._down_ns is None or not self.rests(now_ns):
            return False
        flew_ns = self._flew_ns
        return flew_ns is None or (self._down_ns > flew_ns and now_ns - flew_ns >= FRESH_NS)

    def rests(self, now_ns: int) -> bool:
        """Whether all poses of the last two seconds or more were at rest, or the last pose in flight is so old that the vehicle
        must have landed. True without any pose in flight.
        """
        if self._aloft_ns is None or now_ns - self._aloft_ns >= DOWN_NS:
            return True
        if self._rests_ns is None:
            return False
        return max(one.newest.stamp_ns for one in self.stories) - self._rests_ns >= REST_NS

    def problem(self, drone: str, now_ns: int) -> CodedText | None:
        """Return the problem for the operator that two senders publish under this id; None without that."""
        if not self.are_two(now_ns):
            return None
        text = f"{drone}: two sources send under its id (a copied key, or an agent started twice); both are kept clear of"
        return CodedText(Code.TWO_SOURCES, text, drone)

    def restamp(self, by_ns: int) -> None:
        """Move all stamps of the drone's messages by ``by_ns``, for a better estimate of its clock."""
        for story in self.stories:
            story.poses = deque(replace(one, stamp_ns=one.stamp_ns + by_ns) for one in story.poses)
            story.began_ns += by_ns
        self._turns_ns = deque((one_ns + by_ns for one_ns in self._turns_ns), MIN_TURNS)
        self._boots_ns = {boot: one_ns + by_ns for boot, one_ns in self._boots_ns.items()}
        self._shown_ns, self._aloft_ns = _moved(self._shown_ns, by_ns), _moved(self._aloft_ns, by_ns)
        self._rests_ns = _moved(self._rests_ns, by_ns)
        self._flew_ns, self._down_ns = _moved(self._flew_ns, by_ns), _moved(self._down_ns, by_ns)

    def _divided(self, pose: Pose) -> Story | None:
        """Return the story that a pose continues once the poses of later epochs are split off it as a story of their own; None if
        no story can be divided so.
        """
        for place, story in enumerate(self.stories):
            if (later := story.split(pose)) is not None:
                self.stories.insert(place + 1, later)
                self._told = later if self._told is story else self._told
                return story
        return None

    def _begun(self, pose: Pose) -> Story:
        """Begin a new story with a pose, and return it. Stories without poses for two seconds end; beyond the maximum number, the
        story with the fewest poses ends, too.
        """
        story = Story.of(pose)
        self.stories[1:] = [one for one in self.stories[1:] if pose.stamp_ns - one.newest.stamp_ns < RIVAL_NS]
        if len(self.stories) >= MAX_STORIES:
            self.stories.remove(min(self.stories, key=lambda one: (len(one.poses), one.newest.stamp_ns)))
        self.stories.append(story)
        return story

    def _note_turn(self, story: Story, pose: Pose, now_ns: int) -> None:
        """Note that a pose belongs to another story than the pose before it. Frequent changes between contradictory stories prove
        two senders.

        A pose from before the begin of the other story is only late, and no change.
        """
        before, self._told = self._told, story
        if before is None or before is story or pose.stamp_ns <= before.began_ns:
            return
        if before.newest.epoch <= pose.epoch and not contradict(before.newest, pose):
            return
        self._turns_ns.append(now_ns)
        if len(self._turns_ns) == MIN_TURNS and now_ns - self._turns_ns[0] < RIVAL_NS:
            self._shown_ns = now_ns


def _leads(before: Pose, after: Pose) -> bool:
    """Whether a vehicle can have flown from one pose to the next: the later one lies near the straight way given by the velocity
    of the earlier one, with a similar velocity. Poses of two epochs only have to be in the order of the epochs.

    It may lie anywhere along that way, because after a step of a clock the elapsed time is not known exactly.
    """
    if before.epoch != after.epoch:
        return before.epoch < after.epoch
    elapsed_s = 1e-9 * (after.stamp_ns - before.stamp_ns)
    if dist(before.velocity_mps, after.velocity_mps) > SAME_MPS + MAX_ACCELERATION_MPS2 * elapsed_s:
        return False  # a second sender with the right position, but another velocity, would shift the prediction
    moved = [x - y for x, y in zip(after.position_m, before.position_m, strict=True)]
    way = [elapsed_s * v for v in before.velocity_mps]
    share = min(1.0, max(0.0, sum(map(mul, moved, way)) / (sum(map(mul, way, way)) or 1.0)))
    return dist(moved, [share * part for part in way]) <= SAME_M + 0.5 * MAX_ACCELERATION_MPS2 * elapsed_s**2


def _moved(stamp_ns: int | None, by_ns: int) -> int | None:
    return None if stamp_ns is None else stamp_ns + by_ns


def _stamp(pose: Pose) -> int:
    return pose.stamp_ns


def _sigma_m(pose: Pose) -> float:
    """Return the 1 sigma (m) of a pose's position at its stamp, including the error by a wrong clock, whose size may not be known
    yet just after a clock step.
    """
    return hypot(pose.position_sigma_m, pose.clock_sigma_m)
