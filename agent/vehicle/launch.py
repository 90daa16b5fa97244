"""Where the drone's local frame lies in the autopilot's: found on the ground, or remembered over a restart in flight."""

from __future__ import annotations

from collections import deque

from agent.vehicle.interface import LaunchPlace, Vector3
from agent.vehicle.messages import GlobalOrigin

WINDOW_S = 5.0
SHORTEST_S = 1.0  # of standing still, before the mean is believed
_SAME_DEG = 2e-7  # the origin comes in units of 1e-7 degrees
_SAME_M = 0.01


class LaunchSurvey:
    """The mean of the autopilot's local position over the last seconds on the ground, frozen as soon as it is armed.

    Once flown it stays for good, also after a landing elsewhere: what is measured there belongs to the same frame.

    An agent that starts with the vehicle armed has nothing to average: it goes by the place that was stored, provided that the
    autopilot's frame still has the same geodetic origin. An origin that moves sideways in flight takes the place away: by it
    the vehicle would be steered, and its cones placed, wrong by as much. (Of the origin's altitude the autopilot may think better
    without moving its frame: that is only told.)
    """

    def __init__(self, stored: LaunchPlace | None = None) -> None:
        self._place: LaunchPlace | None = None
        self._moved = False  # the autopilot's frame is no longer the place's
        self.problem: str | None = None
        self._stored = stored
        self._flown = False
        self._samples: deque[tuple[float, Vector3]] = deque()
        self._origin: tuple[float, float, float] | None = None

    @property
    def place(self) -> LaunchPlace | None:
        """Where the local frame lies in the autopilot's present one; None where that is not known."""
        return None if self._moved else self._place

    @property
    def to_keep(self) -> LaunchPlace | None:
        """What a restarted agent should be given: the place, or before it is known the one that this agent was given."""
        return self._place or self._stored

    def take_origin(self, origin: GlobalOrigin) -> None:
        """Take the geodetic origin of the autopilot's local frame."""
        self._origin = (origin.latitude * 1e-7, origin.longitude * 1e-7, origin.altitude * 1e-3)

    def observe(self, now_s: float, position_m: Vector3, armed: bool, in_air: bool) -> None:
        """Take the autopilot's local position (NED)."""
        if self._origin is None:
            self.problem = "the autopilot has not yet said where the origin of its local frame lies (no position fix?)"
        elif armed or in_air or self._flown:
            self._hold(self._origin)
            self._flown = self._flown or (in_air and self._place is not None)
        else:
            self._average(now_s, position_m, self._origin)

    def _average(self, now_s: float, position_m: Vector3, origin: tuple[float, float, float]) -> None:
        samples = self._samples
        if samples and now_s - samples[-1][0] > SHORTEST_S:
            samples.clear()
        samples.append((now_s, position_m))
        while samples[0][0] < now_s - WINDOW_S:
            samples.popleft()
        if now_s - samples[0][0] < SHORTEST_S:
            self.problem = "measuring the launch place"
            return
        north_m, east_m, down_m = (sum(axis) / len(samples) for axis in zip(*(sample for _, sample in samples), strict=True))
        self._place, self.problem = _launch_place((north_m, east_m, down_m), origin), None
        self._moved = False

    def _hold(self, origin: tuple[float, float, float]) -> None:
        self._samples.clear()
        if self._place is None and self._stored is not None and _same_origin(self._stored, origin):
            self._place = self._stored
        if self._place is None:
            self.problem = (
                "the vehicle is armed and this agent does not know where it was launched: land and disarm it"
                if self._stored is None
                else "the origin of the autopilot's local frame is not the one of the launch: land and disarm the vehicle"
            )
            return
        self._moved = not _same_spot(self._place, origin)
        same = _same_origin(self._place, origin)
        self.problem = None if same else "the autopilot has moved the origin of its local frame in flight: land"


def _launch_place(position_m: Vector3, origin: tuple[float, float, float]) -> LaunchPlace:
    north_m, east_m, down_m = position_m
    latitude_deg, longitude_deg, altitude_m = origin
    return LaunchPlace(
        north_m=north_m,
        east_m=east_m,
        down_m=down_m,
        origin_latitude_deg=latitude_deg,
        origin_longitude_deg=longitude_deg,
        origin_altitude_m=altitude_m,
    )


def _same_origin(place: LaunchPlace, origin: tuple[float, float, float]) -> bool:
    return _same_spot(place, origin) and abs(place.origin_altitude_m - origin[2]) < _SAME_M


def _same_spot(place: LaunchPlace, origin: tuple[float, float, float]) -> bool:
    latitude_deg, longitude_deg, _ = origin
    return (
        abs(place.origin_latitude_deg - latitude_deg) < _SAME_DEG and abs(place.origin_longitude_deg - longitude_deg) < _SAME_DEG
    )
