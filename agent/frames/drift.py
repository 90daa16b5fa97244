"""The mission file's localisation settings as numbers: initial placement and drift rate of each drone's frame."""

from __future__ import annotations

import math

import numpy as np

from radron.agent.config.frames import FramesConfig
from radron.agent.config.mission import DroneInMission, MissionConfig
from radron.agent.frames.residuals import Ints
from radron.agent.frames.tracks import LONGEST_SLOPE_S, Track
from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array, Vector3

_LONGEST_S = 60.0  # longest interval without data with drift added in one step
_GAP_S = 10.0  # the same for the gap of a jump
_SPEED_MPS, _TURNING_RPS = 3.0, 0.5  # of a vehicle, while its motion is not known
_EXACT = 1e-3  # metres and radians: sigma of poses configured as exact
_HEADING_KNOWN = math.radians(60.0)  # a heading with a larger sigma counts as unknown


class Drift:
    """Initial error and growth of the error of each drone's local frame, by the mission file.

    Drones are given by their index in the mission. Variances are arrays (4,) for x, y, z (m^2) and yaw (rad^2).
    """

    def __init__(self, mission: MissionConfig) -> None:
        frames = mission.frames
        self._frames = frames
        self._drones = mission.drones
        self._numbers = {drone.id: number for number, drone in enumerate(mission.drones)}
        self._per_s = np.array([_per_second(drone, frames) for drone in mission.drones])  # (N, 2) position, heading
        slam = np.array([drone.localization == "slam" for drone in mission.drones])
        level, climb = frames.slam_drift_m**2, frames.slam_climb_m**2
        self._adrift_per_m = np.array([level, level, climb, math.radians(frames.slam_turn_deg) ** 2])
        self._per_m = np.outer(slam, self._adrift_per_m)

    def follows_satellites(self, number: int) -> bool:
        """Return whether a drone's autopilot uses satellites at the start."""
        return self._drones[number].localization in ("gnss", "rtk")

    def layout(self, number: int) -> tuple[Array, Array, bool]:
        """Return the origin of a drone's frame by the mission file: position (3,) m, variances (4,), and whether the heading is
        known.
        """
        drone = self._drones[number]
        sigma_m = _EXACT if drone.is_exact else max(drone.origin_sigma_m, _EXACT)
        sigma_rad = _EXACT if drone.is_exact else max(math.radians(drone.yaw_sigma_deg), _EXACT)
        known = sigma_rad < _HEADING_KNOWN
        return np.array(drone.origin_m), np.array([sigma_m**2] * 3 + [sigma_rad**2]), known

    def yaw_rad(self, number: int) -> float:
        """Return the heading (rad) of a drone's local frame in the mission frame, by the mission file."""
        return math.radians(self._drones[number].yaw_deg)

    def over(self, number: int, seconds: float, metres: float, adrift: bool = False) -> Array:
        """Return the variances (4,) that are added in a time (s) and on a distance flown (m).

        adrift: whether the drone has lost its satellites and continues by SLAM.
        """
        place, heading = self._per_s[number] * min(seconds, _LONGEST_S)
        per_m = self._adrift_per_m if adrift else self._per_m[number]
        drift: Array = per_m * metres + np.array([place, place, place, heading])
        return drift

    def aged(self, drone: str, mission_from_local: Transform, seconds: float, place_m: Vector3) -> Transform:
        """Return a drone's frame with the larger error that it has after a time without measurements.

        seconds: length of that time. place_m: position (local frame) that the drone may have reached, where the error is needed.
        """
        seconds = min(max(seconds, 0.0), _LONGEST_S)
        variances = self.over(self._numbers[drone], seconds, seconds * _SPEED_MPS)
        return mission_from_local.blurred(place_m, variances) if variances.any() else mission_from_local

    def over_jumps(self, track: Track, after_ns: int, until_ns: int) -> Array:
        """Return the variances (4,) added by the jumps of a drone's localisation between two times (ns).

        At a jump the track's segments before and after are joined by the motion before the jump.
        """
        total = np.zeros(4)
        for gap_s in track.gaps_s(after_ns, until_ns):
            total[:3] += (self._frames.jump_m * (1.0 + min(gap_s, _GAP_S))) ** 2
            total[3] += math.radians(self._frames.jump_yaw_deg) ** 2
            if gap_s > LONGEST_SLOPE_S:  # then the motion is unknown
                total[:2] += (_SPEED_MPS * min(gap_s, _GAP_S)) ** 2
                total[3] += min(_TURNING_RPS * gap_s, math.pi) ** 2
        return total

    def since(self, numbers: Ints, seconds: Array, speed_mps: float) -> Array:
        """Return the variance (M,), m^2 per horizontal axis, by which the frames of M drones drift within a time.

        numbers: (M,) indices of the drones. seconds: (M,) times. speed_mps: speed at which they fly.
        """
        place: Array = (self._per_s[numbers, 0] + self._per_m[numbers, 0] * speed_mps) * np.abs(seconds)
        return place

    def compass_var(self, number: int, seconds: float) -> float | None:
        """Return the variance (rad^2) of an autopilot's heading as a measurement that is used once every ``seconds``; None
        without a compass.

        The heading wanders around the value in the mission file within its sigma. With random-walk variance q per second, a
        measurement variance of sigma^4 / (q dt) yields sigma^2 in the steady state.
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
    # A Gauss-Markov error of sigma and tau initially grows by a variance of 2 sigma^2 / tau per second.
    return frames.wander_m**2 + 2.0 * sigma_m**2 / frames.gnss_correlation_s, math.radians(frames.compass_drift_deg) ** 2
