"""Conditions on the drones' estimates of their own positions, the basis of separation, fence and all measurements."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees, hypot, inf, remainder, tau

from radron.sim.geometry import Array
from radron.sim.scoring.invariants.base import AT_HOME_M, EXCLUDED_S, EXCLUDED_SIGMAS, LOOK_TICKS, Breach, Invariant, Setting
from radron.sim.scoring.moment import Moment

MISPLACED_M, MISTURNED_RAD = 1.0, 0.15
UNPLACED_S = 40.0  # a drone among others has been seen many times by then
SEEN_M = 30.0  # range of sightings
CALIBRATED = 9.0  # mean squared error over variance; 1 is expected, and the errors of a flight are hardly independent
CALIBRATED_S = 20.0  # a mean over less has no meaning
FLOOR_M, FLOOR_RAD = 0.3, 0.03  # smaller errors of a vehicle's own localisation are no errors of its frame
HOMELESS_S = 5.0  # renewal interval of the stored state
HEARS_S = 0.5  # telemetry comes 20 times a second
NEW_S = 0.06  # at 8 m/s a vehicle is within twice FLOOR_M of its newest telemetry


class _Placed(Invariant[Moment]):
    """An invariant of drones in the air whose own positions can be known.

    Exempt are drones with a fault of their own position, or without telemetry; and, with estimated frames, all drones from
    the first fault with wrong observations in every log on.
    """

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.estimated = not all(drone.is_exact for drone in setting.mission.drones)
        self._until_s = setting.misled_s() if self.estimated else inf

    def placeable(self, moment: Moment) -> Iterator[int]:
        """Yield the drones that are not exempt."""
        if moment.time_s < self._until_s:
            for drone in range(len(moment.pilots)):
                hears = moment.time_s - moment.told_s[drone] < HEARS_S
                if hears and moment.airborne(drone) and not self.setting.struck_unannounced(drone, moment.time_s):
                    yield drone


class OwnPlace(_Placed):
    """Requires that no drone excludes its own true position or heading for 5 s.

    A position is excluded if it is 6 sigma and a metre away, a heading if it is 6 sigma and 0.15 rad away.
    """

    name = "own-place"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._since_s: dict[int, float] = {}

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that have been wrong about their own position or heading for too long."""
        wrong = {drone: text for drone in self.placeable(moment) if (text := excluded(moment, drone))}
        self._since_s = {drone: self._since_s.get(drone, moment.time_s) for drone in wrong}
        for drone, since_s in self._since_s.items():
            if moment.time_s - since_s > EXCLUDED_S:
                yield Breach((drone,), wrong[drone])


class Calibrated(_Placed):
    """Requires that, over a flight, a drone's errors of position and heading agree with the stated variances.

    The mean squared errors must be at most 9 times the variances. A frame that follows one receiver's error closely, with a sigma
    of a fraction of it, excludes the truth too seldom at 6 sigma. Counted with fresh telemetry only: on a bad link a vehicle is
    metres ahead of the newest telemetry at its agent.
    """

    name = "calibrated"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.sums = [0.0] * len(setting.names)
        self.turned = [0.0] * len(setting.names)
        self.counts = [0] * len(setting.names)
        self._ticks = 0

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Record the normalised errors twice a second; yield nothing in flight."""
        self._ticks += 1
        if self.estimated and self._ticks % LOOK_TICKS == 0:
            for drone in self.placeable(moment):
                pilot = moment.pilots[drone]
                placed = pilot.whereabouts if pilot is not None else None
                hears = moment.time_s - moment.told_s[drone] < NEW_S
                if hears and placed is not None and placed.sigma_m > 0.0:
                    off_m = max(0.0, _off_m(moment, drone, placed.place_m) - FLOOR_M)
                    off_rad = max(0.0, _off_rad(moment, drone, placed.yaw_rad) - FLOOR_RAD)
                    self.sums[drone] += (off_m / placed.sigma_m) ** 2
                    self.turned[drone] += (off_rad / max(placed.yaw_sigma_rad, FLOOR_RAD)) ** 2
                    self.counts[drone] += 1
        yield from ()

    def at_end(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that were overconfident about their position or heading."""
        for drone, count in enumerate(self.counts):
            for what, total in (("position", self.sums[drone]), ("heading", self.turned[drone])):
                if count >= CALIBRATED_S * 20 / LOOK_TICKS and total / count > CALIBRATED:
                    yield Breach((drone,), f"its squared {what} error is {total / count:.0f} times the variance that it states")


class KnowsItsPlace(_Placed):
    """Requires that a drone in the air, with two other drones near for 40 s, knows its position in the mission frame.

    Such a drone must not wait for ever. Revoked drones have no links to other drones.
    """

    name = "placed"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._unplaced_s = [0.0] * len(setting.names)
        self._last_s = 0.0

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that have not known their position for too long."""
        step_s, self._last_s = moment.time_s - self._last_s, moment.time_s
        for drone in self.placeable(moment) if self.estimated else ():
            pilot = moment.pilots[drone]
            if pilot is None or pilot.whereabouts is not None:
                self._unplaced_s[drone] = 0.0
            elif not self._is_revoked(moment, drone) and self._is_seen(moment, drone):
                self._unplaced_s[drone] += step_s
            if self._unplaced_s[drone] > UNPLACED_S:
                yield Breach((drone,), f"it does not know where it is, {UNPLACED_S:g} s among others")

    def _is_revoked(self, moment: Moment, drone: int) -> bool:
        return moment.time_s >= self.setting.revoked_s.get(drone, inf)

    def _is_seen(self, moment: Moment, drone: int) -> bool:
        x, y, _ = moment.position_m[drone].tolist()
        near = [
            other
            for other, pilot in enumerate(moment.pilots)
            if other != drone
            and pilot is not None
            and not self._is_revoked(moment, other)
            and moment.airborne(other)
            and hypot(moment.position_m[other, 0] - x, moment.position_m[other, 1] - y) < SEEN_M
        ]
        return len(near) >= 2


class KnowsHome(Invariant[Moment]):
    """Requires that the state a drone has saved for a restart contains a home within 10 m of its launch place.

    Judged are drones in the air. Exempt are drones with an unknown own position; drones that may land elsewhere (``Setting``) may
    have a home at another place.
    """

    name = "home"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._launch: Array | None = None
        self._since_s: dict[int, float] = {}

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones whose saved home has been missing or wrong for too long."""
        if self._launch is None:
            self._launch = moment.position_m.copy()
        wrong = {drone: text for drone in range(len(moment.pilots)) if (text := self._wrong(moment, drone, self._launch[drone]))}
        self._since_s = {drone: self._since_s.get(drone, moment.time_s) for drone in wrong}
        for drone, since_s in self._since_s.items():
            if moment.time_s - since_s > HOMELESS_S:
                yield Breach((drone,), wrong[drone])

    def _wrong(self, moment: Moment, drone: int, launch_m: Array) -> str:
        pilot = moment.pilots[drone]
        if pilot is None or pilot.memory is None or not moment.airborne(drone):
            return ""
        home_m = pilot.memory.home_m
        off_m = inf if home_m is None else hypot(home_m[0] - float(launch_m[0]), home_m[1] - float(launch_m[1]))
        if off_m <= AT_HOME_M or pilot.whereabouts is None:
            return ""
        if home_m is None:
            return "it knows no home"
        elsewhere = self.setting.may_land_elsewhere(drone, moment.time_s)
        return "" if elsewhere else f"it takes a place {off_m:.1f} m away for its home"


def excluded(moment: Moment, drone: int) -> str:
    """Return a text that tells how far a drone's own estimate excludes its true position or heading; empty if it does not."""
    pilot = moment.pilots[drone]
    placed = pilot.whereabouts if pilot is not None else None
    if placed is None:
        return ""
    off_m = _off_m(moment, drone, placed.place_m)
    if off_m > max(MISPLACED_M, EXCLUDED_SIGMAS * placed.sigma_m):
        return f"{off_m:.1f} m from where it takes itself to be, sigma {placed.sigma_m:.2f} m"
    off_rad = _off_rad(moment, drone, placed.yaw_rad)
    if off_rad > max(MISTURNED_RAD, EXCLUDED_SIGMAS * placed.yaw_sigma_rad):
        sigma_deg = degrees(placed.yaw_sigma_rad)
        return f"{degrees(off_rad):.0f} degrees from where it takes itself to point, sigma {sigma_deg:.1f}"
    return ""


def _off_rad(moment: Moment, drone: int, yaw_rad: float) -> float:
    return abs(remainder(yaw_rad - float(moment.heading_rad[drone]), tau))


def _off_m(moment: Moment, drone: int, place_m: tuple[float, float, float]) -> float:
    x, y, _ = moment.position_m[drone].tolist()
    return hypot(place_m[0] - x, place_m[1] - y)
