"""Values for autopilot parameters that are wrong for a mission: what ``radron-agent doctor --write`` sets."""

from __future__ import annotations

import asyncio
import time
from math import ceil, hypot

from msgspec import Struct

from agent.config.drone import DroneConfig
from agent.config.mission import MissionConfig
from agent.vehicle.parameters import float32
from agent.vehicle.px4 import Px4Vehicle

AGAIN_S = 0.5
MOST_ATTEMPTS = 4
_ANSWER_S = 2.0  # until the autopilot has told the new value
FENCE_SPARE_M = 20.0  # between the agents' fence and the autopilot's own
_HOLD, _RETURN, _LAND = "hold", "return", "land"
_WITHOUT_AGENT = {_RETURN: 3.0, _LAND: 4.0, _HOLD: 5.0}  # COM_OBL_RC_ACT
_BY_SATELLITES_US, _BY_VISION_US = 2_000_000.0, 5_000_000.0
_EV_POSITION, _EV_YAW = 1, 8  # bits of EKF2_EV_CTRL


class Change(Struct, frozen=True):
    """A parameter that was set. ``after``: as the autopilot told it last; None: not at all."""

    name: str
    before: float
    after: float | None
    wanted: float

    @property
    def taken(self) -> bool:
        """Whether the autopilot has the wanted value now."""
        return self.after == float32(self.wanted)


def correction(name: str, before: float, drone: DroneConfig, mission: MissionConfig) -> float | None:
    """The value to set for a parameter whose value is wrong; None where only a person can choose."""
    vehicle, area = drone.vehicle, mission.area
    reaction = mission.safety.agent_lost if vehicle.gnss else _LAND
    place = next(member.origin_m for member in mission.drones if member.id == drone.id)
    farthest_m = max(hypot(x - place[0], y - place[1]) for x, y in area.polygon_m) + area.fence_margin_m
    return_m = mission.return_height_m(drone.id)
    bits = _EV_POSITION if vehicle.gnss else _EV_POSITION | _EV_YAW
    return {
        "COM_OF_LOSS_T": 1.0,
        "COM_OBL_RC_ACT": _WITHOUT_AGENT[reaction],
        "NAV_RCL_ACT": 2.0 if vehicle.gnss else 3.0,  # return; land
        "COM_LOW_BAT_ACT": 3.0 if vehicle.gnss else 2.0,  # return; land
        "RTL_RETURN_ALT": return_m,
        "RTL_DESCEND_ALT": return_m,
        "MPC_Z_V_AUTO_UP": 3.0,  # PX4's default
        "GF_ACTION": 3.0,  # return
        "GF_MAX_HOR_DIST": float(ceil(farthest_m + FENCE_SPARE_M)),
        "EKF2_NOAID_TOUT": _BY_VISION_US if vehicle.vision is not None or not vehicle.gnss else _BY_SATELLITES_US,
        "EKF2_EV_CTRL": float(int(max(before, 0.0)) | bits),
        "EKF2_GPS_CTRL": 0.0,
    }.get(name)


class Corrections:
    """Sets the wrong parameters of one vehicle, each a few times, and remembers what they were."""

    def __init__(self, drone: DroneConfig, mission: MissionConfig) -> None:
        self._drone, self._mission = drone, mission
        self._before: dict[str, tuple[float, float]] = {}  # value before, and the wanted one
        self._attempts: dict[str, int] = {}
        self._set_s: dict[str, float] = {}  # when each was set last
        self._values: dict[str, float | None] = {}

    @property
    def changes(self) -> list[Change]:
        """All that was set, with the present values."""
        return [Change(name, before, self._values.get(name), wanted) for name, (before, wanted) in self._before.items()]

    def tries(self, name: str) -> bool:
        """Whether a parameter that is wrong is still going to be set, or its new value may still come."""
        if correction(name, 0.0, self._drone, self._mission) is None:
            return False
        answers = time.monotonic() - self._set_s.get(name, float("-inf")) < _ANSWER_S
        return answers or self._attempts.get(name, 0) < MOST_ATTEMPTS

    async def run(self, vehicle: Px4Vehicle) -> None:
        """Set what is wrong, until cancelled."""
        asked_s = float("-inf")
        while True:
            self._values = {name: vehicle.parameters.value(name) for name in self._before}
            if time.monotonic() - asked_s >= AGAIN_S:
                asked_s = time.monotonic()
                self._set(vehicle)
            await asyncio.sleep(0.1)

    def _set(self, vehicle: Px4Vehicle) -> None:
        for name, value in vehicle.parameters.wrong().items():
            wanted = correction(name, value, self._drone, self._mission)
            if wanted is None or self._attempts.get(name, 0) >= MOST_ATTEMPTS:
                continue
            if vehicle.set_parameter(name, wanted):
                self._attempts[name] = self._attempts.get(name, 0) + 1
                self._set_s[name] = time.monotonic()
                self._before.setdefault(name, (value, wanted))
