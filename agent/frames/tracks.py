"""A drone's own track: its localisation's positions as a continuous path across epochs.

At a jump of the localisation a new epoch begins, while the vehicle itself continues at its velocity. The stretches between jumps,
here *segments*, are therefore joined to a *continuous* track in the frame of the first segment. Within an epoch the frame stays
constant, even at a jump of the samples. A drone begins a new epoch at every jump that it detects
(``radron.agent.localization.jumps``). Other jumps are false samples, as a malicious drone's, or the correction of a drifted
position. Everything is a function of the samples alone, for any order of arrival.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left, bisect_right
from dataclasses import dataclass

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Vector3

_FASTEST_MPS = 25.0  # faster than any vehicle of the swarm
_LONGEST_GAP_NS = 1_000_000_000  # longest gap between samples across which positions are interpolated
ALWAYS = 2**63  # later than any stamp
LONGEST_SLOPE_S = 0.5  # samples further apart give no velocity
_SLOPE_NS = round(LONGEST_SLOPE_S * 1e9)


@dataclass(frozen=True, slots=True, order=True)
class Sample:
    """A drone's position and body heading at ``stamp_ns`` by its own localisation, in its local frame of that epoch.

    An epoch is a period without a jump of the localisation.
    """

    stamp_ns: int
    epoch: int
    position_m: Vector3
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class Segment:
    """A part of a drone's track between two jumps of its localisation, which lies in one epoch.

    ``first``: index of the first sample; ``joined``: transform from the local frame to the continuous frame; ``gap_s``: time
    since the previous segment.
    """

    first: int
    stamp_ns: int
    epoch: int
    joined: Transform  # continuous frame from local frame
    gap_s: float


class Track:
    """A drone's path by its own localisation, made continuous over jumps of the localisation.

    Positions are in the continuous frame, which is the local frame of the first segment (part between two jumps). The samples are
    kept in order of time, in columns of numbers, 8 bytes each: a track grows by ten samples a second, and a sample as an object
    takes 300 bytes.
    """

    def __init__(self) -> None:
        self._stamps = array("Q")
        self._epochs = array("Q")
        self._local = _Rows()  # position and heading, in the sample's own frame
        self._places = _Rows()  # in the continuous frame, and metres along the track; as far as computed
        self._segments: list[Segment] = []
        self._changed_ns = ALWAYS

    def insert(self, sample: Sample) -> int | None:
        """Add a sample to the track. Return the time stamp after which the track has changed; None if it has not changed.

        Of two samples with equal stamp and epoch (period without a jump) the lesser one is kept, for any order of arrival.
        """
        index = self._index(sample)
        held = self._sample(index) if index < len(self._stamps) else None
        if held is not None and (held.stamp_ns, held.epoch) == (sample.stamp_ns, sample.epoch):
            if held <= sample:
                return None
            self._delete(index)
        self._stamps.insert(index, sample.stamp_ns)
        self._epochs.insert(index, sample.epoch)
        self._local.insert(index, (*sample.position_m, sample.yaw_rad))
        self._forget(index)
        return self._before_ns(index, sample.stamp_ns)

    def remove(self, sample: Sample) -> int | None:
        """Remove a sample from the track. Return the time stamp after which the track has changed; None if the sample was not in
        it.
        """
        index = self._index(sample)
        if index == len(self._stamps) or self._sample(index) != sample:
            return None
        self._delete(index)
        self._forget(index)
        return self._before_ns(index, sample.stamp_ns)

    def any_within(self, after_ns: int, until_ns: int) -> bool:
        """Return whether the track has samples in the interval (after_ns, until_ns]."""
        return bisect_right(self._stamps, after_ns) < bisect_right(self._stamps, until_ns)

    def content(self, after_ns: int, until_ns: int) -> tuple[bytes, bytes, bytes]:
        """Return all inputs of the track in (after_ns, until_ns], and the next sample, as one value that can be compared and
        hashed.

        Simulations use the value to share results between agents: equal inputs give equal results. Earlier inputs are not
        included.
        """
        first, end = bisect_right(self._stamps, after_ns), bisect_right(self._stamps, until_ns) + 1
        return self._stamps[first:end].tobytes(), self._epochs[first:end].tobytes(), self._local.content(first, end)

    def drop_before(self, stamp_ns: int) -> None:
        """Discard the track's samples from before a time stamp (ns)."""
        count = bisect_left(self._stamps, stamp_ns)
        if count:
            self._delete(0, count)
            self._forget(0)

    def taken_changed_ns(self) -> int:
        """Return the earliest time stamp from which segments have changed since the last call (``ALWAYS``: no change)."""
        self._join()
        changed, self._changed_ns = self._changed_ns, ALWAYS
        return changed

    @property
    def first_ns(self) -> int | None:
        """Time stamp (ns) of the track's first sample; None without samples."""
        return self._stamps[0] if self._stamps else None

    @property
    def segments(self) -> list[Segment]:
        """All segments of the track (parts between two jumps of the localisation), in order of time."""
        self._join()
        return self._segments

    def reference(self, stamp_ns: int) -> tuple[Vector3, float] | None:
        """Return the drone's position in the continuous frame, and the metres flown until then, at a time stamp.

        If no sample follows soon after the stamp, the values are those of the last sample before it. None before the first
        sample.
        """
        after = bisect_right(self._stamps, stamp_ns)
        if not after:
            return None
        self._join()
        before = after - 1
        if after == len(self._stamps) or self._stamps[after] - self._stamps[before] > _LONGEST_GAP_NS:
            return self._places.vector(before), self._places.last(before)
        share = (stamp_ns - self._stamps[before]) / (self._stamps[after] - self._stamps[before])
        flown = self._places.last(before) + share * (self._places.last(after) - self._places.last(before))
        return _between(self._places.vector(before), self._places.vector(after), share), flown

    def at(self, stamp_ns: int) -> Vector3 | None:
        """Return the drone's position in the continuous frame at a time stamp; None if no samples lie close enough around it."""
        after = bisect_left(self._stamps, stamp_ns)
        if after == len(self._stamps) or (after == 0 and self._stamps[0] != stamp_ns):
            return None
        self._join()
        if self._stamps[after] == stamp_ns:
            return self._places.vector(after)
        gap = self._stamps[after] - self._stamps[after - 1]
        if gap > _LONGEST_GAP_NS:
            return None
        share = (stamp_ns - self._stamps[after - 1]) / gap
        return _between(self._places.vector(after - 1), self._places.vector(after), share)

    def joined(self, epoch: int, stamp_ns: int) -> Transform | None:
        """Return the transform from the local frame of an epoch to the continuous frame; None if the drone was not in that epoch
        at the stamp.

        The next segment counts only after the last sample before it, and so never for a stamp that ``insert`` does not name.
        """
        self._join()
        index = bisect_right(self._segments, stamp_ns, key=lambda segment: segment.stamp_ns)
        following = bisect_left(self._stamps, stamp_ns)
        for near in (index - 1, index, index - 2):
            segment = self._segments[near] if 0 <= near < len(self._segments) else None
            if segment is not None and segment.epoch == epoch and (near < index or segment.first == following):
                return segment.joined
        return None

    def epoch_ns(self, stamp_ns: int) -> int:
        """Return the first time stamp of the segment (part between two jumps) that contains a stamp; 0 before the first
        segment.
        """
        self._join()
        index = bisect_right(self._segments, stamp_ns, key=lambda segment: segment.stamp_ns)
        return self._segments[index - 1].stamp_ns if index else 0

    def gaps_s(self, after_ns: int, until_ns: int) -> list[float]:
        """Return the time gaps (s) at the jumps in the interval (after_ns, until_ns], each before the segment that follows the
        jump.
        """
        self._join()
        first = bisect_right(self._segments, after_ns, key=lambda segment: segment.stamp_ns)
        last = bisect_right(self._segments, until_ns, key=lambda segment: segment.stamp_ns)
        return [segment.gap_s for segment in self._segments[max(first, 1) : last]]

    def _index(self, sample: Sample) -> int:
        """Place of the sample of that stamp and epoch, or where it belongs."""
        index = bisect_left(self._stamps, sample.stamp_ns)
        while index < len(self._stamps) and self._stamps[index] == sample.stamp_ns and self._epochs[index] < sample.epoch:
            index += 1
        return index

    def _before_ns(self, index: int, stamp_ns: int) -> int:
        """Stamp after which a change of the sample at ``index`` matters: also the track at its own stamp."""
        return min(self._stamps[index - 1], stamp_ns - 1) if index else stamp_ns - 1

    def _sample(self, index: int) -> Sample:
        position_m, yaw_rad = self._local.vector(index), self._local.last(index)
        return Sample(self._stamps[index], self._epochs[index], position_m, yaw_rad)

    def _delete(self, index: int, count: int = 1) -> None:
        """Delete samples from ``index`` on, but no derived results."""
        del self._stamps[index : index + count], self._epochs[index : index + count]
        self._local.delete(index, index + count)

    def _forget(self, index: int) -> None:
        """Discard results derived from the sample at ``index`` and later ones."""
        self._places.delete(index, len(self._places))
        while self._segments and self._segments[-1].first >= index:
            self._note(self._segments.pop().stamp_ns)

    def _note(self, stamp_ns: int) -> None:
        self._changed_ns = min(stamp_ns, self._changed_ns)

    def _join(self) -> None:
        for index in range(len(self._places), len(self._stamps)):
            sample = self._sample(index)
            if index == 0 or sample.epoch != self._epochs[index - 1]:
                joined, gap_s = (Transform(), 0.0) if index == 0 else self._onward(index)
                self._segments.append(Segment(index, sample.stamp_ns, sample.epoch, joined, gap_s))
                self._note(sample.stamp_ns)
            place = self._segments[-1].joined.apply_point(sample.position_m)
            flown = self._places.last(index - 1) + math.dist(place, self._places.vector(index - 1)) if index else 0.0
            self._places.insert(index, (*place, flown))

    def _onward(self, index: int) -> tuple[Transform, float]:
        """Join of the segment that begins at ``index``, by assuming that the vehicle kept its velocity and turn rate, and its gap
        (s).
        """
        before, after = self._sample(index - 1), self._sample(index)
        gap_ns = after.stamp_ns - before.stamp_ns
        place = self._places.vector(index - 1)
        heading = before.yaw_rad + self._segments[-1].joined.yaw_rad
        if gap_ns <= _SLOPE_NS and self._has_slope(index - 1):
            share = gap_ns / (before.stamp_ns - self._stamps[index - 2])
            place = _between(self._places.vector(index - 2), place, 1.0 + share)
            heading += share * math.remainder(before.yaw_rad - self._local.last(index - 2), math.tau)
        yaw_rad = math.remainder(heading - after.yaw_rad, math.tau)
        x, y, z = Transform(yaw_rad).rotate_direction(after.position_m)
        return Transform(yaw_rad, (place[0] - x, place[1] - y, place[2] - z)), 1e-9 * gap_ns

    def _has_slope(self, index: int) -> bool:
        """Whether the sample and its predecessor in the segment give a velocity within a vehicle's limits. Two samples a
        microsecond apart may differ by a correction of the autopilot, which is no motion to extrapolate.
        """
        if index <= self._segments[-1].first:
            return False
        apart_ns = self._stamps[index] - self._stamps[index - 1]
        return apart_ns <= _SLOPE_NS and self._places.last(index) - self._places.last(index - 1) <= _FASTEST_MPS * 1e-9 * apart_ns


class _Rows:
    """A vector and a further number in each row."""

    def __init__(self) -> None:
        self._numbers = array("d")

    def __len__(self) -> int:
        return len(self._numbers) // 4

    def vector(self, index: int) -> Vector3:
        x, y, z = self._numbers[4 * index : 4 * index + 3]
        return x, y, z

    def last(self, index: int) -> float:
        return self._numbers[4 * index + 3]

    def insert(self, index: int, row: tuple[float, float, float, float]) -> None:
        self._numbers[4 * index : 4 * index] = array("d", row)

    def content(self, first: int, end: int) -> bytes:
        return self._numbers[4 * first : 4 * end].tobytes()

    def delete(self, first: int, end: int) -> None:
        del self._numbers[4 * first : 4 * end]


def _between(a: Vector3, b: Vector3, share: float) -> Vector3:
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))
