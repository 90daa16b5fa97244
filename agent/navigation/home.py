"""Where a return leads: the place of the takeoff, in the drone's present local frame."""

from __future__ import annotations

from math import hypot, inf, isfinite

from msgspec import Struct

from agent.geometry import Vector3
from agent.localization.ownpose import OwnPose
from agent.vehicle.interface import VehicleState

AT_HOME_M = 0.5
AT_HOME_MPS = 0.8  # the estimate of a vehicle that stands still shows up to 0.5
SETTLED_NS = 2_000_000_000  # the drone must have been at home for this long
NEAR_M = 1.5
LONGEST_NS = 5_000_000_000  # being near for this long counts too: an estimate that wanders by 0.4 m may never settle
_GAP_NS = 1_000_000_000  # after a longer gap in the approach, all times start again
NO_NEARER_S = 60.0  # a return that has not come a metre nearer for this long ends where the drone is
REVOKED_NO_NEARER_S = 20.0  # that of one that is revoked
_NEARER_M = 1.0
_ARRIVED_M = 3.0  # from here on it has that time to come down, whether it gets nearer or is driven away again by others


class Launch(Struct, frozen=True):
    """Where the drone took off, in the local frame of that epoch, and when (UTC)."""

    epoch: int
    stamp_ns: int
    position_m: Vector3


class KeptHome(Struct, frozen=True):
    """For an agent that is restarted in flight. ``place_m``: mission frame, None where it was not known; ``sigma_m``: 1 sigma of
    it as the log told it, None where it did not; ``launch``: None where that was not known.
    """

    place_m: Vector3 | None = None
    sigma_m: float | None = None
    launch: Launch | None = None


class Home:
    """Home of one drone, and how long the drone has been there."""

    def __init__(self, own: OwnPose) -> None:
        self._own = own
        self._launch: Launch | None = None
        self._remembered = KeptHome()
        self._watched_ns = 0
        self._near_since_ns: int | None = None
        self._there_since_ns: int | None = None
        self._nearest_m, self._nearest_ns = inf, 0  # how near the return has come, and when

    def took_off(self, vehicle: VehicleState) -> None:
        """The drone takes off here."""
        self._launch = Launch(vehicle.epoch, vehicle.stamp_ns, vehicle.position_m)
        self._remembered = KeptHome()

    def remember(self, kept: KeptHome) -> None:
        """Take what was stored before the agent was restarted."""
        self._remembered, self._launch = kept, kept.launch

    @property
    def kept(self) -> KeptHome:
        """What to store; not what JSON cannot hold."""
        place_m, launch = self.in_mission, self._launch
        known = self._own.surest(launch.epoch, launch.stamp_ns, launch.position_m) if launch is not None else None
        sigma_m = self._remembered.sigma_m if known is None or known[0] != place_m else round(known[1], 2)
        is_finite = place_m is not None and all(map(isfinite, place_m))
        return KeptHome(place_m if is_finite else None, sigma_m if sigma_m is not None and isfinite(sigma_m) else None, launch)

    @property
    def in_mission(self) -> Vector3 | None:
        """The place in the mission frame; None while that is not known. After a restart the stored one counts until the log tells
        that of the launch more surely: while it fills again it tells less than was known.
        """
        launch, before = self._launch, self._remembered
        if launch is None:
            return before.place_m
        if before.place_m is None:
            return self._own.in_mission(launch.epoch, launch.stamp_ns, launch.position_m)
        known = self._own.surest(launch.epoch, launch.stamp_ns, launch.position_m)
        is_surer = known is not None and known[1] < (inf if before.sigma_m is None else before.sigma_m)
        return known[0] if known is not None and is_surer else before.place_m

    @property
    def in_local(self) -> Vector3 | None:
        """The place in the present local frame; also where only that frame is known, if the drone took off in it."""
        place, frame, vehicle = self.in_mission, self._own.frame, self._own.vehicle
        if frame is not None and place is not None:
            return frame.local_from_mission.apply_point(place)
        launch = self._launch
        return launch.position_m if launch is not None and vehicle is not None and launch.epoch == vehicle.epoch else None

    @property
    def is_reached(self) -> bool:
        """Whether the drone hovers over home, near enough to land there, by what ``watch`` has seen."""
        settled = _lasts(self._there_since_ns, self._watched_ns, SETTLED_NS)
        return settled or _lasts(self._near_since_ns, self._watched_ns, LONGEST_NS)

    @property
    def is_near(self) -> bool:
        """Whether the drone is near home, by what ``watch`` has seen last."""
        return self._near_since_ns is not None

    @property
    def no_nearer_s(self) -> float:
        """For how long a return has got no nearer: home is not known, or others or the fence keep the drone away from it."""
        return (self._watched_ns - self._nearest_ns) * 1e-9

    def watch(self, vehicle: VehicleState) -> None:
        """Take the newest telemetry of a return: note since when the drone has been near home, and over it."""
        place, now_ns = self.in_local, vehicle.stamp_ns
        interrupted = not 0 <= now_ns - self._watched_ns <= _GAP_NS  # or the clock was set back
        self._watched_ns = now_ns
        if interrupted:
            self._nearest_m, self._nearest_ns = inf, now_ns
        if interrupted or place is None or not vehicle.position_trusted:
            self._near_since_ns = self._there_since_ns = None
        if place is None or not vehicle.position_trusted:
            return
        away_m = hypot(vehicle.position_m[0] - place[0], vehicle.position_m[1] - place[1])
        if away_m < self._nearest_m - _NEARER_M and self._nearest_m > _ARRIVED_M:
            self._nearest_m, self._nearest_ns = away_m, now_ns
        there = away_m < AT_HOME_M and hypot(*vehicle.velocity_mps[:2]) < AT_HOME_MPS
        self._near_since_ns = _since(self._near_since_ns, now_ns, away_m < NEAR_M)
        self._there_since_ns = _since(self._there_since_ns, now_ns, there)


def _since(before_ns: int | None, now_ns: int, holds: bool) -> int | None:
    """Since when a condition has held; None while it does not."""
    if not holds:
        return None
    return now_ns if before_ns is None else before_ns


def _lasts(since_ns: int | None, now_ns: int, long_ns: int) -> bool:
    return since_ns is not None and now_ns - since_ns >= long_ns
