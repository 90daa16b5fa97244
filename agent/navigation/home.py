"""Home of one drone: the place of its takeoff, which is the destination of its return, and the progress of a return."""

from __future__ import annotations

from math import hypot, inf, isfinite

from msgspec import Struct

from radron.agent.geometry import Vector3
from radron.agent.localization.ownpose import OwnPose
from radron.agent.vehicle.interface import VehicleState

AT_HOME_M = 0.5
AT_HOME_MPS = 0.8  # a hovering vehicle's velocity estimate shows up to 0.5
SETTLED_NS = 2_000_000_000  # home is reached after this time at home
NEAR_M = 1.5
LONGEST_NS = 5_000_000_000  # or after this time near home: a position estimate that wanders by 0.4 m may never stay at home
_GAP_NS = 1_000_000_000  # after a longer gap in telemetry, all times start again
NO_NEARER_S = 60.0  # a return without a metre of progress for this long ends where the drone is
REVOKED_NO_NEARER_S = 20.0  # the same for a revoked drone
_NEARER_M = 1.0
_ARRIVED_M = 3.0  # nearer to home than this, progress no longer counts: the time of the descent begins


class Launch(Struct, frozen=True):
    """Place of a takeoff, m in the local frame of ``epoch``, and its stamp in the log (UTC)."""

    epoch: int
    stamp_ns: int
    position_m: Vector3


class KeptHome(Struct, frozen=True):
    """Home, as stored for a restart of the agent in flight.

    place_m: mission frame; None if it was not known. sigma_m: its 1 sigma by the log; None if the log did not give it.
    launch: place of the takeoff in its local frame; None if it was not known.
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
        self._nearest_m, self._nearest_ns = inf, 0  # least distance of the return so far, and its stamp

    def took_off(self, vehicle: VehicleState) -> None:
        """Note the takeoff of the drone: home is where it stands now."""
        self._launch = Launch(vehicle.epoch, self._own.utc.of(vehicle.stamp_ns), vehicle.position_m)
        self._remembered = KeptHome()

    def remember(self, kept: KeptHome) -> None:
        """Restore the home that was stored before a restart of the agent."""
        self._remembered, self._launch = kept, kept.launch

    @property
    def kept(self) -> KeptHome:
        """The home to be stored, without numbers that are not finite, which JSON cannot hold."""
        place_m, launch = self.in_mission, self._launch
        known = self._own.surest(launch.epoch, launch.stamp_ns, launch.position_m) if launch is not None else None
        sigma_m = self._remembered.sigma_m if known is None or known[0] != place_m else round(known[1], 2)
        is_finite = place_m is not None and all(map(isfinite, place_m))
        return KeptHome(place_m if is_finite else None, sigma_m if sigma_m is not None and isfinite(sigma_m) else None, launch)

    @property
    def in_mission(self) -> Vector3 | None:
        """Home in the mission frame; None while it is not known.

        After a restart of the agent the stored position counts until the log gives the place of the takeoff with less
        uncertainty, because a log that fills again holds less than before at first.
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
        """Home in the present local frame; None while it is not known. If the drone took off in this frame, home is known in it
        even while the frame is not.
        """
        place, frame, vehicle = self.in_mission, self._own.frame, self._own.vehicle
        if frame is not None and place is not None:
            return frame.local_from_mission.apply_point(place)
        launch = self._launch
        return launch.position_m if launch is not None and vehicle is not None and launch.epoch == vehicle.epoch else None

    @property
    def is_reached(self) -> bool:
        """Whether the drone has hovered over home for long enough to land there, by the telemetry of ``watch``."""
        settled = _lasts(self._there_since_ns, self._watched_ns, SETTLED_NS)
        return settled or _lasts(self._near_since_ns, self._watched_ns, LONGEST_NS)

    @property
    def is_near(self) -> bool:
        """Whether the drone is near home, by the last ``watch``."""
        return self._near_since_ns is not None

    @property
    def no_nearer_s(self) -> float:
        """Time (s) in which the return made no progress: home is not known, or other drones or the fence keep the drone away."""
        return (self._watched_ns - self._nearest_ns) * 1e-9

    def watch(self, vehicle: VehicleState) -> None:
        """Process the newest telemetry of a return: update its progress, and the times at home and near it."""
        place, now_ns = self.in_local, vehicle.stamp_ns
        interrupted = now_ns - self._watched_ns > _GAP_NS
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
    """Return the stamp since which a condition has held; None while it does not hold. ``before_ns``: the result so far."""
    if not holds:
        return None
    return now_ns if before_ns is None else before_ns


def _lasts(since_ns: int | None, now_ns: int, long_ns: int) -> bool:
    return since_ns is not None and now_ns - since_ns >= long_ns
