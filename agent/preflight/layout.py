"""The launch place reported by the autopilot against the mission's launch layout: a wrong datum or layout shows here."""

from __future__ import annotations

from math import degrees, hypot, remainder

from radron.agent.config.mission import DatumConfig, MissionConfig
from radron.agent.frames.geodesy import mission_from_launch
from radron.agent.vehicle.interface import Finding, LaunchPlace

NAME = "launch layout"
_SIGMAS = 3.0
_SATELLITES_M = 5.0  # occasional error of a receiver without corrections
_COMPASS_DEG = 15.0


def layout_finding(mission: MissionConfig, drone: str, place: LaunchPlace | None) -> Finding | None:
    """Compare the launch place that the autopilot reports, in the mission frame, with the place in the mission file.

    ``place``: as the autopilot reports it. Return None if there is nothing to compare: a mission without a datum, or a vehicle
    without satellites or without a reported origin.
    """
    member = next(member for member in mission.drones if member.id == drone)
    if mission.datum is None or member.localization == "slam" or place is None or place.origin is None:
        return None
    latitude_deg, longitude_deg, altitude_m = place.origin
    origin = DatumConfig(latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=altitude_m)
    found, _ = mission_from_launch(mission.datum, origin, (place.east_m, place.north_m, -place.down_m))
    x, y, _ = found.translation
    away_m = hypot(x - member.origin_m[0], y - member.origin_m[1])
    turned_deg = remainder(degrees(found.yaw_rad) - member.yaw_deg, 360.0)
    where = f"({x:.1f}, {y:.1f}) m in the mission frame, {away_m:.1f} m from the mission's place"
    if away_m > _SATELLITES_M + _SIGMAS * member.origin_sigma_m:
        return Finding(NAME, "failed", f"{where}: correct drones.origin_m or datum, or put the drone there")
    if abs(turned_deg) > _COMPASS_DEG + _SIGMAS * member.yaw_sigma_deg:
        return Finding(NAME, "failed", f"its frame is turned by {turned_deg:.0f} degrees from drones.yaw_deg: correct it")
    return Finding(NAME, "ok", where)
