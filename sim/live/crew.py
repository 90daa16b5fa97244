"""PX4 parameters that a crew sets before a mission; all other parameters keep their defaults."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, hypot
from typing import NamedTuple

from radron.agent.config.mission import MissionConfig
from radron.sim.world.localizers import VehicleTruth

_FENCE_SPARE_M = 10.0  # radius of the autopilot's fence, a circle around its home, beyond the mission's fence
_BY_VISION = 1 + 2 + 8  # bits of EKF2_EV_CTRL: position, height, heading
_VISION_LOST_US = 2_000_000  # PX4's default of 5 s lets its inertial sensors drift by metres
_LAND, _LAND_WITHOUT_REMOTE = 4, 3  # values of COM_OBL_RC_ACT and NAV_RCL_ACT


class Guidance(NamedTuple):
    """How a vehicle localises: by satellites, by SLAM on board, or by one after the other."""

    gnss: bool = True
    vision: bool = False

    @classmethod
    def of(cls, truth: VehicleTruth | None) -> Guidance:
        """Return how a vehicle localises according to the scenario. None: the scenario does not mention the vehicle."""
        if truth is None:
            return cls()
        switches = any(event.switch_to == "slam" for event in truth.events)
        return cls(gnss=truth.kind != "slam", vision=truth.kind == "slam" or switches)


def crew_parameters(mission: MissionConfig, place: Sequence[float], guidance: Guidance = Guidance()) -> dict[str, float]:  # noqa: B008
    """Return the PX4 parameters of a vehicle for a mission. ``place``: its launch place in the mission frame."""
    area = mission.area
    farthest_m = max(hypot(x - place[0], y - place[1]) for x, y in area.polygon_m) + area.fence_margin_m
    parameters: dict[str, float] = {
        "COM_OBL_RC_ACT": 3.0,  # return when the agent is lost
        "EKF2_NOAID_TOUT": 2_000_000.0,  # us: descend when satellites are lost
        "RTL_RETURN_ALT": min(10.0, 0.8 * area.ceiling_m),
        "RTL_DESCEND_ALT": min(10.0, 0.8 * area.ceiling_m),
        "GF_MAX_HOR_DIST": ceil(farthest_m + _FENCE_SPARE_M),
    }
    if guidance.vision:
        parameters |= {"EKF2_EV_CTRL": _BY_VISION, "EKF2_NOAID_TOUT": _VISION_LOST_US}
    if not guidance.gnss:  # without satellites it has no home to return to
        parameters |= {"EKF2_GPS_CTRL": 0, "EKF2_HGT_REF": 3, "COM_OBL_RC_ACT": _LAND, "NAV_RCL_ACT": _LAND_WITHOUT_REMOTE}
    return parameters
