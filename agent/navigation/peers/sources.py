"""News under one id from two sources: a copied key, or an agent started twice.

Nothing in a message tells its source: whoever has the key writes what it likes, and Zenoh's source ids are its own words too.
But one agent is in one place, and one boot follows another: poses between which no vehicle can have flown, or statuses of a boot
that another one has followed, show two. Which of them is right cannot be known: the one heard first keeps its place, and the
other one's place is kept clear of as well.

A single jump of a localisation shows two places too, but never the first one again: both are kept clear of for a moment, and
nothing is told.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import dist, hypot

from msgspec.structs import replace

from protocol.messages import GROUND_STAGES, Pose, Status

FASTEST_MPS = 20.0  # faster than any vehicle of the swarm, also in a failsafe or under a human pilot
SLACK_M, SIGMAS, MOST_DOUBT_M = 1.5, 3.0, 5.0  # errors of a localisation between two poses
RIVAL_NS = 2_000_000_000  # for how long a second place is kept clear of
SILENT_NS = 500_000_000  # a place from which nothing has come for so long gives way to the other one
SHOWN_NS = 10_000_000_000  # two sources are told for this long, and believed to be two
FRESH_NS = 2_500_000_000  # a status counts for this long beside those of another boot: two periods and a half
MOST_BOOTS = 4  # that are remembered


def contradict(one: Pose, other: Pose) -> bool:
    """Whether no vehicle can have been in both poses. Of epochs it is only known that no older one follows."""
    if one.epoch != other.epoch:
        return (one.epoch < other.epoch) != (one.stamp_ns <= other.stamp_ns)
    doubt_m = min(SLACK_M + SIGMAS * max(map(_sigma_m, (one, other))), MOST_DOUBT_M)
    return dist(one.position_m, other.position_m) > doubt_m + FASTEST_MPS * 1e-9 * abs(one.stamp_ns - other.stamp_ns)


@dataclass(slots=True)
class Sources:
    """The sources of one drone's news. ``rival``: the newest pose of a second one, or the last one before a jump."""

    rival: Pose | None = None
    _since_ns: int | None = None  # stamp of the first pose of the second source
    _shown_ns: int | None = None  # when two places, or two boots, were last seen
    _boots: dict[str, Status] = field(default_factory=dict)  # the newest status of each, in the order of their first ones

    def is_second(self, known: Pose | None, pose: Pose, now_ns: int) -> bool:
        """Whether a pose is of a second source beside the one of the ``known`` pose, and is kept as such."""
        if known is None or not contradict(known, pose):
            if known is not None and self._since_ns is not None and pose.stamp_ns > max(known.stamp_ns, self._since_ns):
                self._shown_ns, self._since_ns = now_ns, None
            return False
        if pose.stamp_ns - known.stamp_ns > SILENT_NS:
            self.rival, self._since_ns = known, None
            return False
        if self.rival is None or pose.stamp_ns > self.rival.stamp_ns or contradict(self.rival, pose):
            self.rival = pose
            self._since_ns = pose.stamp_ns if self._since_ns is None else self._since_ns
        return True

    def shift(self, by_ns: int) -> None:
        """Move all stamps of the drone's news."""
        if self.rival is not None:
            self.rival = replace(self.rival, stamp_ns=self.rival.stamp_ns + by_ns)
        if self._since_ns is not None:
            self._since_ns += by_ns
        if self._shown_ns is not None:
            self._shown_ns += by_ns
        self._boots = {boot: replace(status, stamp_ns=status.stamp_ns + by_ns) for boot, status in self._boots.items()}

    def boot(self, status: Status, now_ns: int) -> None:
        """Take a status that is newer than all before."""
        newest = next(reversed(self._boots), status.boot)
        if status.boot in self._boots and status.boot != newest:
            self._shown_ns = now_ns
        self._boots[status.boot] = status
        if len(self._boots) > MOST_BOOTS:
            del self._boots[next(iter(self._boots))]

    def second_place(self, now_ns: int) -> Pose | None:
        """Where the drone may be as well; None: nowhere."""
        rival = self.rival
        return rival if rival is not None and now_ns - rival.stamp_ns < RIVAL_NS else None

    def are_two(self, now_ns: int) -> bool:
        """Whether two sources have shown themselves lately."""
        return self._shown_ns is not None and now_ns - self._shown_ns < SHOWN_NS

    def is_on_ground(self, now_ns: int) -> bool:
        """Whether all who have told a stage lately are on the ground."""
        newest = max(self._boots.values(), key=_stamp, default=None)
        told = [one for one in self._boots.values() if one is newest or now_ns - one.stamp_ns < FRESH_NS]
        return bool(told) and all(one.stage in GROUND_STAGES for one in told)

    def problem(self, drone: str, now_ns: int) -> str | None:
        """What is told to the operator."""
        if not self.are_two(now_ns):
            return None
        return f"{drone}: two sources send under its id (a copied key, or an agent started twice); both are kept clear of"


def _stamp(status: Status) -> int:
    return status.stamp_ns


def _sigma_m(pose: Pose) -> float:
    """1 sigma of its position, with what a wrong clock adds: by how much a clock was set is known only a moment later."""
    return hypot(pose.position_sigma_m, pose.clock_sigma_m)
