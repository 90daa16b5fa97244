"""Sorts log entries into the inputs of the frame estimate: tracks, and sightings and fixes by keyframe."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right, insort
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.clockerrors import ClockErrors
from radron.agent.frames.geodesy import mission_from_geodetic
from radron.agent.frames.residuals import Fixes, Sightings
from radron.agent.frames.tracks import Sample, Track
from radron.agent.geometry import yaw_of
from radron.protocol.codec import decode_as
from radron.protocol.entries import MAX_READABLE_EXPOSURE_NS, Entry, EntryId, Exposure, Fix, Sighting

READS = (Exposure, Sighting, Fix)  # kinds of entries; others carry no information about frames
_MOST = 64  # measurements of a kind and drone that count in a keyframe: a member may publish a minute's for one moment
_OUTAGE_NS = 5_000_000_000  # time without a fix after which an autopilot is assumed to navigate by other means
_ATTITUDE_VAR = math.radians(0.5) ** 2  # of the observer's roll and pitch, which the sightings' sigmas do not include
# Of the other drone, if either clock is wrong. A sighting with a larger possible offset carries no information, and would count
# as a contradiction.
_SPEED_MPS, _FARTHEST_OFF_M = 3.0, 10.0


@dataclass(slots=True)
class _Bucket:
    """Measurements within one keyframe's interval, and the arrays built from them once the tracks are known.

    Held are the bytes that the log holds too: decoded, the entries would take more memory than all the rest.
    """

    sightings: dict[EntryId, bytes] = field(default_factory=dict)
    fixes: dict[EntryId, bytes] = field(default_factory=dict)
    seen: Sightings | None = None
    fixed: Fixes | None = None


class Intake:
    """Sorts the measurements in the observation log into the inputs of the frame estimate, by keyframe (time of an estimate).

    Keyframe k covers the interval ((k - 1) g, k g], with g the interval between keyframes. ``indices``: keyframes with any data,
    ascending. ``dirty``: the earliest keyframe affected by entries received since the last call of ``taken``.
    """

    def __init__(self, mission: MissionConfig) -> None:
        self._number = {drone.id: number for number, drone in enumerate(mission.drones)}
        self._slam = [drone.localization == "slam" for drone in mission.drones]
        self._datum = mission.datum
        self._correlation_ns = round(mission.frames.gnss_correlation_s * 1e9)
        self.grid_ns = round(mission.frames.keyframe_s * 1e9)
        self.tracks = [Track() for _ in mission.drones]
        self._clock_errors = [ClockErrors() for _ in mission.drones]
        self.indices: list[int] = []
        self.dirty: int | None = None
        self._buckets: dict[int, _Bucket] = {}
        self._fix_stamps: list[list[int]] = [[] for _ in mission.drones]
        self._exposures: dict[EntryId, bytes] = {}
        self._exposed: list[list[EntryId]] = [[] for _ in mission.drones]  # the same by drone, in order of time
        self._earliest_ns = 0

    def receive(self, entry: Entry, payload: bytes) -> None:
        """Add a log entry, together with the bytes from which it was decoded; each entry comes once.

        Kinds of entries that are not in ``READS`` carry no information about frames, and are ignored.
        """
        number = self._number.get(entry.drone)
        if number is None:
            return
        identity = entry.entry_id
        if isinstance(entry, Exposure):
            self._exposures[identity] = payload
            insort(self._exposed[number], identity)
            self._add_samples(number, entry)
            if entry.end_ns >= self._earliest_ns:
                self._clock_errors[number].add(entry)
                self._touch_clock(number, entry)
        elif entry.stamp_ns < self._earliest_ns:
            return
        elif isinstance(entry, Sighting) and entry.target in self._number:
            self._bucket(entry.stamp_ns).sightings[identity] = payload
        elif isinstance(entry, Fix):
            self._bucket(entry.stamp_ns).fixes[identity] = payload
            insort(self._fix_stamps[number], entry.stamp_ns)

    def holds(self, identity: EntryId) -> bool:
        """Return whether a log entry was received, and has not been dropped since."""
        bucket = self._buckets.get(self._index(identity.stamp_ns))
        return identity in self._exposures or (bucket is not None and (identity in bucket.sightings or identity in bucket.fixes))

    def taken(self) -> int | None:
        """Return the earliest keyframe that must be computed again because of new entries; None without one.

        The call forgets this keyframe, and discards the prepared arrays of the affected keyframes.
        """
        dirty, self.dirty = self.dirty, None
        if dirty is not None:
            for index in self.indices[bisect_left(self.indices, dirty) :]:
                self._buckets[index].seen = self._buckets[index].fixed = None
        return dirty

    def drop_before(self, stamp_ns: int) -> None:
        """Discard measurements from before a time stamp (ns), and ignore measurements from before it that arrive later.

        The limit is the begin of the keyframe (interval of the estimate) that contains the stamp.
        """
        index = self._index(stamp_ns)
        stamp_ns = self._earliest_ns = (index - 1) * self.grid_ns + 1
        first = bisect_left(self.indices, index)
        for index in self.indices[:first]:
            del self._buckets[index]
        del self.indices[:first]
        for stamps in self._fix_stamps:
            del stamps[: bisect_left(stamps, stamp_ns)]
        for track, clock in zip(self.tracks, self._clock_errors, strict=True):
            track.drop_before(stamp_ns)
            clock.drop_before(stamp_ns)
        self._touch(0)

    def sightings(self, first: int, last: int) -> Sightings:
        """Return the relative observations between drones in the keyframes (intervals of the estimate) ``first`` to ``last``.

        Both drones' tracks must be known at the time of an observation.
        """
        return Sightings.joined([self._seen(index) for index in self._between(first, last)])

    def fixes(self, first: int, last: int) -> Fixes:
        """Return the satellite positions of drones in the keyframes (intervals of the estimate) ``first`` to ``last``."""
        return Fixes.joined([self._fixed(index) for index in self._between(first, last)])

    def content(self, after: int, until: int) -> tuple[object, ...]:
        """Return all inputs of the keyframes (times of a frame estimate) after ``after`` up to ``until`` as one value that can be
        compared and hashed.

        Simulations use the value to share results between agents: equal inputs give equal results. Inputs of earlier keyframes
        are not included. ``after``: -1: from the first keyframe on.
        """
        buckets = [self._buckets[index] for index in self._between(after + 1, until)]
        seen = frozenset(payload for bucket in buckets for payload in bucket.sightings.values())
        fixed = frozenset(payload for bucket in buckets for payload in bucket.fixes.values())
        span_ns = after * self.grid_ns, until * self.grid_ns
        tracks = tuple(track.content(*span_ns) for track in self.tracks)
        return seen, fixed, tracks, tuple(clock.content(*span_ns) for clock in self._clock_errors)

    def has_recent_fix(self, number: int, stamp_ns: int) -> bool:
        """Return whether a drone had a satellite position shortly before a time stamp, or has just started. number: index of the
        drone.
        """
        stamps, first_ns = self._fix_stamps[number], self.tracks[number].first_ns
        place = bisect_right(stamps, stamp_ns)
        latest_ns = stamps[place - 1] if place else first_ns
        return latest_ns is not None and stamp_ns - latest_ns < _OUTAGE_NS

    def _between(self, first: int, last: int) -> list[int]:
        return self.indices[bisect_left(self.indices, first) : bisect_right(self.indices, last)]

    def _index(self, stamp_ns: int) -> int:
        return -(-stamp_ns // self.grid_ns)

    def _touch(self, index: int) -> None:
        self.dirty = index if self.dirty is None else min(index, self.dirty)

    def _touch_clock(self, number: int, exposure: Exposure) -> None:
        """Mark the change from the earliest time with a clock error stated in this exposure."""
        from_ns = exposure.stamp_ns - self._clock_errors[number].reach_ns(exposure)
        self._touch(self._index(max(from_ns, self._earliest_ns)))

    def _bucket(self, stamp_ns: int) -> _Bucket:
        index = self._index(stamp_ns)
        self._touch(index)
        if index not in self._buckets:
            self._buckets[index] = _Bucket()
            insort(self.indices, index)
        return self._buckets[index]

    def forget(self, identities: Iterable[EntryId]) -> None:
        """Remove log entries that do not count any more; entries that were not received are ignored."""
        for identity in identities:
            self._displace(identity, self._number[identity.drone])

    def _displace(self, identity: EntryId, number: int) -> None:
        """Remove the entry with that identity, if there is one."""
        bucket = self._buckets.get(self._index(identity.stamp_ns))
        if bucket is not None and identity in bucket.sightings:
            del bucket.sightings[identity]
            self._leave(identity.stamp_ns)
        elif bucket is not None and identity in bucket.fixes:
            del bucket.fixes[identity]
            stamps = self._fix_stamps[number]
            del stamps[bisect_left(stamps, identity.stamp_ns)]
            self._leave(identity.stamp_ns)
        payload = self._exposures.pop(identity, None)
        if payload is None:
            return
        del self._exposed[number][bisect_left(self._exposed[number], identity)]
        exposure = decode_as(Exposure, payload)
        self._touch_clock(number, exposure)
        self._clock_errors[number].remove(exposure)
        for sample in _samples(exposure):
            before_ns = self.tracks[number].remove(sample)
            if before_ns is not None:
                self._touch(self._index(before_ns + 1))
                self._leave(sample.stamp_ns)
        for other in self._beside(exposure, number):  # may have samples that this exposure had masked
            self._add_samples(number, other)

    def _beside(self, exposure: Exposure, number: int) -> Iterator[Exposure]:
        """Other exposures of the same drone that overlap an exposure."""
        exposed = self._exposed[number]
        first = bisect_left(exposed, exposure.stamp_ns - MAX_READABLE_EXPOSURE_NS, key=_stamp_ns)
        for identity in exposed[first : bisect_right(exposed, exposure.end_ns, key=_stamp_ns)]:
            other = decode_as(Exposure, self._exposures[identity])
            if exposure.stamp_ns <= other.end_ns:
                yield other

    def _leave(self, stamp_ns: int) -> None:
        """Remove a measurement's stamp; a keyframe without any data is dropped."""
        index = self._index(stamp_ns)
        self._touch(index)
        bucket, until_ns = self._buckets.get(index), index * self.grid_ns
        if bucket is None or bucket.sightings or bucket.fixes:
            return
        if not any(track.any_within(until_ns - self.grid_ns, until_ns) for track in self.tracks):
            del self._buckets[index]
            del self.indices[bisect_left(self.indices, index)]

    def _add_samples(self, number: int, exposure: Exposure) -> None:
        for sample in _samples(exposure):
            if sample.stamp_ns < self._earliest_ns:
                continue
            before_ns = self.tracks[number].insert(sample)
            if before_ns is not None:
                self._bucket(sample.stamp_ns)
                self._touch(self._index(before_ns + 1))

    def _seen(self, index: int) -> Sightings:
        bucket = self._buckets[index]
        if bucket.seen is None:
            entries = (decode_as(Sighting, payload) for payload in _counted(bucket.sightings))
            rows = list(map(self._sighting, entries))
            columns = list(zip(*(row for row in rows if row is not None), strict=True))
            if not columns:
                bucket.seen = Sightings.empty()
            else:
                bucket.seen = Sightings(*map(_ints, columns[:3]), *map(_floats, columns[3:]))
        return bucket.seen

    def _sighting(self, entry: Sighting) -> tuple[object, ...] | None:
        """One row of ``Sightings``; None while a track is unknown at its time, or if wrong clocks make it void."""
        observer, target = self._number[entry.drone], self._number[entry.target]
        off_m = _SPEED_MPS * sum(self._clock_errors[drone].at(entry.stamp_ns) for drone in (observer, target))
        if off_m > _FARTHEST_OFF_M:
            return None
        joined = self.tracks[observer].joined(entry.epoch, entry.stamp_ns)
        at_target = self.tracks[target].at(entry.stamp_ns)
        if joined is None or at_target is None or self.tracks[observer].at(entry.stamp_ns) is None:
            return None
        direction, direction_var = (0.0, 0.0, 0.0), math.inf
        if entry.direction is not None and entry.direction_sigma_rad is not None:
            scale = 1.0 / math.hypot(*entry.direction)
            x, y, z = joined.rotate_direction(entry.direction)
            direction, direction_var = (scale * x, scale * y, scale * z), entry.direction_sigma_rad**2 + _ATTITUDE_VAR
        range_m, range_var = 0.0, math.inf
        if entry.range_m is not None and entry.range_sigma_m is not None:
            range_m, range_var = entry.range_m, entry.range_sigma_m**2
        own = joined.apply_point(entry.position_m)
        return observer, target, entry.stamp_ns, own, at_target, direction, direction_var, range_m, range_var, off_m**2

    def _fixed(self, index: int) -> Fixes:
        bucket = self._buckets[index]
        if bucket.fixed is None:
            rows = [self._fix(decode_as(Fix, payload)) for payload in _counted(bucket.fixes)]
            columns = list(zip(*(row for row in rows if row is not None), strict=True))
            if not columns:
                bucket.fixed = Fixes.empty()
            else:
                bucket.fixed = Fixes(*map(_ints, columns[:2]), *map(_floats, columns[2:]))
        return bucket.fixed

    def _fix(self, entry: Fix) -> tuple[object, ...] | None:
        """One row of ``Fixes``; None while the drone's track is unknown at its time, or without a datum."""
        number = self._number[entry.drone]
        joined = self.tracks[number].joined(entry.epoch, entry.stamp_ns)
        if joined is None or self._datum is None:
            return None
        place = mission_from_geodetic(self._datum, entry.latitude_deg, entry.longitude_deg, entry.altitude_m)
        axis_var = 0.5 * entry.horizontal_sigma_m**2
        at = joined.apply_point(entry.position_m)
        var = (axis_var, axis_var, entry.vertical_sigma_m**2)
        return number, entry.stamp_ns, at, place, var, self._inflation(number, entry.stamp_ns)

    def _inflation(self, number: int, stamp_ns: int) -> float:
        """Factor on the variance of a fix with an error correlated with the previous fix's.

        For an error with correlation time tau, the mean of fixes over T >> tau has the variance 2 sigma^2 tau / T whatever their
        rate, so a fix every dt counts with the factor 2 tau / dt. The track of an autopilot that follows its receiver has the
        same error; there the frame itself wanders (``Drift``), and tau / (2 dt) gives the filter the steady-state variance
        sigma^2.
        """
        stamps = self._fix_stamps[number]
        place = bisect_left(stamps, stamp_ns)
        if place == 0:
            return 1.0
        apart = max(stamp_ns - stamps[place - 1], 1) / self._correlation_ns
        return max(1.0, (2.0 if self._slam[number] else 0.5) / apart)


def _stamp_ns(identity: EntryId) -> int:
    return identity.stamp_ns


def _counted(held: dict[EntryId, bytes]) -> Iterator[bytes]:
    """Measurements that count, in the order of their identities: the first ``_MOST`` of each drone."""
    seen: Counter[str] = Counter()
    for identity in sorted(held):
        seen[identity.drone] += 1
        if seen[identity.drone] <= _MOST:
            yield held[identity]


def _samples(exposure: Exposure) -> Iterator[Sample]:
    for pose in exposure.poses:
        yield Sample(exposure.stamp_ns + pose.offset_ns, exposure.epoch, pose.position_m, yaw_of(pose.quaternion))


def _ints(column: object) -> Any:
    return np.array(column, dtype=np.int64)


def _floats(column: object) -> Any:
    return np.array(column, dtype=np.float64)
