"""What the mission file says of the drones' localisation, as numbers: how each frame drifts, and where it lies at the start."""

from __future__ import annotations

import math

import numpy as np

from agent.config import DroneInMission, FramesConfig, MissionConfig
from agent.frames.sightings import Array, Ints
from agent.frames.tracks import Track

_LONGEST_S = 60.0  # for which a frame's drift without data is counted at once
_GAP_S = 10.0  # the same of a jump
_EXACT = 1e-3  # metres and radians: what is told to be known exactly
_HEADING_KNOWN = math.radians(60.0)  # with a larger sigma it is not


class Drift:
    """Of each of the mission's drones, by its number: variances, each a (4,) of (x, y, z, yaw) in m^2 and rad^2."""

    def __init__(self, mission: MissionConfig) -> None:
        frames = mission.frames
        self._frames = frames
        self._drones = mission.drones
        self._per_s = np.array([_per_second(drone, frames) for drone in mission.drones])  # (N, 2) place, heading
        slam = np.array([drone.localization == "slam" for drone in mission.drones])
        level, climb = frames.slam_drift_m**2, frames.slam_climb_m**2
        self._adrift_per_m = np.array([level, level, climb, math.radians(frames.slam_turn_deg) ** 2])
        self._per_m = np.outer(slam, self._adrift_per_m)

    def follows_satellites(self, number: int) -> bool:
        """Whether a drone's autopilot does at the start."""
        return self._drones[number].localization in ("gnss", "rtk")

    def layout(self, number: int) -> tuple[Array, Array, bool]:
        """Where the origin of a drone's frame was put: (3,) metres, (4,) variances, and whether its heading is known."""
        drone = self._drones[number]
        sigma_m = _EXACT if drone.is_exact else max(drone.origin_sigma_m, _EXACT)
        sigma_rad = _EXACT if drone.is_exact else max(math.radians(drone.yaw_sigma_deg), _EXACT)
        known = sigma_rad < _HEADING_KNOWN
        return np.array(drone.origin_m), np.array([sigma_m**2] * 3 + [sigma_rad**2]), known

    def yaw_rad(self, number: int) -> float:
        """The heading of the layout."""
        return math.radians(self._drones[number].yaw_deg)

    def over(self, number: int, seconds: float, metres: float, adrift: bool = False) -> Array:
        """What a time and a distance flown add; ``adrift``: to one that has lost its satellites, and goes on by SLAM."""
        place, heading = self._per_s[number] * min(seconds, _LONGEST_S)
        per_m = self._adrift_per_m if adrift else self._per_m[number]
        drift: Array = per_m * metres + np.array([place, place, place, heading])
        return drift

    def over_jumps(self, track: Track, after_ns: int, until_ns: int) -> Array:
        """What the joints between a track's segments add."""
        total = np.zeros(4)
        for gap_s in track.gaps_s(after_ns, until_ns):
            total[:3] += (self._frames.jump_m * (1.0 + min(gap_s, _GAP_S))) ** 2
            total[3] += math.radians(self._frames.jump_yaw_deg) ** 2
        return total

    def since(self, numbers: Ints, seconds: Array, speed_mps: float) -> Array:
        """m^2 of each axis of place by which drones (M,) drifted in (M,) seconds at that speed."""
        place: Array = (self._per_s[numbers, 0] + self._per_m[numbers, 0] * speed_mps) * np.abs(seconds)
        return place

    def compass_var(self, number: int, seconds: float) -> float | None:
        """Variance with which an autopilot's own heading counts once in so many seconds; None without a compass.

        The heading wanders about the layout's within its sigma: with the variance q that it wanders by in a second, sigma^4 /
        (q dt) makes sigma^2 of it in the long run.
        """
        drone = self._drones[number]
        per_s = self._per_s[number, 1]
        if not self.follows_satellites(number) or per_s <= 0.0 or not self.layout(number)[2]:
            return None
        return float(max(math.radians(drone.yaw_sigma_deg), _EXACT) ** 4 / (per_s * max(seconds, 1e-3)))


def _per_second(drone: DroneInMission, frames: FramesConfig) -> tuple[float, float]:
    if drone.is_exact:
        return 0.0, 0.0
    if drone.localization == "slam":
        return frames.wander_m**2, math.radians(frames.slam_yaw_drift_deg) ** 2
    sigma_m = frames.gnss_sigma_m if drone.localization == "gnss" else frames.rtk_sigma_m
    # A Gauss-Markov error of sigma and tau begins to wander by 2 sigma^2 / tau in a second.
    return frames.wander_m**2 + 2.0 * sigma_m**2 / frames.gnss_correlation_s, math.radians(frames.compass_drift_deg) ** 2
