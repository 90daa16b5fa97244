"""From satellite fixes and relative observations of other drones, in own time, to log entries in UTC, with the own pose then."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from math import sqrt

from radron.agent.geometry import Vector3, turned
from radron.agent.localization.history import PoseHistory
from radron.agent.owntime import Utc
from radron.agent.vehicle.interface import GnssFix, SeenDrone
from radron.protocol.entries import Fix, Sighting

NOT_LOGGED = 0  # sequence number of a sighting that is for this drone alone; no entry of a sensor has it
_OVERLAP_NS = 1_000_000_000  # sensors may report late; a larger step back is a clock step
MOST_PER_S = 20  # observations of one drone, or fixes: a faulty sensor must not fill the logs of the whole swarm
_FINEST_M, _WIDEST_M = 1e-3, 1e3  # plausible sigmas
_FINEST_RAD, _WIDEST_RAD = 1e-4, 3.2
_FURTHEST_M = 1e4
_UNIT_TOLERANCE = 0.01  # of a direction's length; it is brought to 1


class PositionSensors:
    """Turns the measurements of one drone's satellite receiver and relative sensors into log entries, with the drone's pose at
    their time.

    Unusable measurements are counted and dropped.
    """

    def __init__(
        self,
        drone: str,
        others: Iterable[str],
        mission_id: str,
        boot: str,
        history: PoseHistory,
        numbers: Iterator[int],
        counters: Counter[str],
        utc: Utc,
    ) -> None:
        """Set up the sensors of one drone.

        ``history``: the drone's own poses; ``numbers``: sequence numbers of this run's entries; ``counters``: count dropped
        measurements.
        """
        self._drone, self._others = drone, frozenset(others)
        self._mission, self._boot = mission_id, boot
        self._history, self._numbers, self._counters = history, numbers, counters
        self._utc = utc
        self._newest_ns = 0  # of the sightings logged, UTC
        self._elsewhere_ns = 0  # until then this drone may have been elsewhere
        self._taken: dict[str, tuple[int, int]] = {}  # by target: a second, and the number taken in it

    def fix(self, fix: GnssFix) -> Fix | None:
        """Return the log entry of a satellite position; None if it is unusable."""
        pose = self._history.extrapolated(fix.stamp_ns)
        if pose is None or self._refuses("fixes", "fix", fix.stamp_ns, _is_plausible_fix(fix)):
            self._counters["fixes_without_pose"] += pose is None
            return None
        return Fix(
            stamp_ns=self._utc.of(fix.stamp_ns),
            drone=self._drone,
            mission=self._mission,
            boot=self._boot,
            sequence=next(self._numbers),
            epoch=pose.epoch,
            position_m=pose.position_m,
            latitude_deg=float(fix.latitude_deg),
            longitude_deg=float(fix.longitude_deg),
            altitude_m=float(fix.altitude_m),
            horizontal_sigma_m=float(fix.horizontal_sigma_m),
            vertical_sigma_m=float(fix.vertical_sigma_m),
        )

    def begin_anew(self) -> None:
        """Start again after a step of the clock: the log entries with wrong stamps are being taken back."""
        self._newest_ns = 0

    def drop_until(self, until_ns: int) -> None:
        """Log no sighting from before a time (ns), because this drone may have been at another place."""
        self._elsewhere_ns = until_ns

    def sighting(self, seen: SeenDrone) -> Sighting | None:
        """Return the log entry of a relative observation of another drone, its direction in the local frame; None if unusable.

        After a backward clock step the log already holds poses of this drone at these stamps. Present sightings of the other
        drones would contradict their former positions. Such a sighting is ``NOT_LOGGED``, until the poses are taken back
        (``begin_anew``). So is a sighting from a time at which this drone may have been at another place (``drop_until``).
        """
        if seen.target not in self._others:
            self._counters["sightings_of_nobody"] += 1
            return None
        pose = self._history.extrapolated(seen.stamp_ns)
        if pose is None or self._refuses("sightings", seen.target, seen.stamp_ns, _is_plausible_sighting(seen)):
            self._counters["sightings_without_pose"] += pose is None
            return None
        direction = None if seen.direction is None else _unit(turned(pose.quaternion, seen.direction))
        stamp_ns = self._utc.of(seen.stamp_ns)
        is_overlapping = stamp_ns < self._newest_ns - _OVERLAP_NS
        if is_overlapping:
            self._counters["sightings_overlapping"] += 1
        self._newest_ns = max(self._newest_ns, stamp_ns)
        return Sighting(
            stamp_ns=stamp_ns,
            drone=self._drone,
            mission=self._mission,
            boot=self._boot,
            sequence=NOT_LOGGED if is_overlapping or seen.stamp_ns < self._elsewhere_ns else next(self._numbers),
            epoch=pose.epoch,
            target=seen.target,
            position_m=pose.position_m,
            direction=direction,
            direction_sigma_rad=seen.direction_sigma_rad,
            range_m=seen.range_m,
            range_sigma_m=seen.range_sigma_m,
        )

    def _refuses(self, kind: str, what: str, stamp_ns: int, plausible: bool) -> bool:
        """Whether to drop an observation: implausible, or one too many of its kind in this second."""
        if not plausible:
            self._counters[f"{kind}_implausible"] += 1
            return True
        second = stamp_ns // 1_000_000_000
        known, taken = self._taken.get(what, (second, 0))
        self._taken[what] = second, taken + 1 if known == second else 1
        if self._taken[what][1] <= MOST_PER_S:
            return False
        self._counters[f"{kind}_too_many"] += 1
        return True


def _is_plausible_fix(fix: GnssFix) -> bool:
    """Finite, on Earth, and with plausible errors."""
    on_earth = abs(fix.latitude_deg) <= 90.0 and abs(fix.longitude_deg) <= 180.0 and abs(fix.altitude_m) <= _FURTHEST_M
    return on_earth and all(_FINEST_M <= sigma <= _WIDEST_M for sigma in (fix.horizontal_sigma_m, fix.vertical_sigma_m))


def _is_plausible_sighting(seen: SeenDrone) -> bool:
    """Direction or range is given, each with its error, and all values are plausible."""
    if (seen.direction is None) != (seen.direction_sigma_rad is None) or (seen.range_m is None) != (seen.range_sigma_m is None):
        return False
    if seen.direction is None and seen.range_m is None:
        return False
    if seen.direction is not None and seen.direction_sigma_rad is not None:
        length = sqrt(sum(part * part for part in seen.direction))
        if not abs(length - 1.0) < _UNIT_TOLERANCE or not _FINEST_RAD <= seen.direction_sigma_rad <= _WIDEST_RAD:
            return False
    if seen.range_m is not None and seen.range_sigma_m is not None:
        return 0.0 <= seen.range_m <= _FURTHEST_M and _FINEST_M <= seen.range_sigma_m <= _WIDEST_M
    return True


def _unit(direction: Vector3) -> Vector3:
    x, y, z = direction
    length = sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length
