"""Flights of radron's own agents on a real PX4, as recorded on another of its links (``recordings/flown``), given to the driver.

That link has neither ATTITUDE_QUATERNION nor ODOMETRY: the attitudes come from ATTITUDE, and a reset is counted where the heading
jumps in a takeoff. The origin of the local frame, which PX4 sends once, follows from the truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from math import cos, radians, remainder, sin, tau
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from radron.agent.vehicle.interface import LaunchPlace
from radron.agent.vehicle.launch import WINDOW_S
from radron.agent.vehicle.mavlink.messages import DECODERS, Attitude, GlobalOrigin, Message, Odometry
from support.px4.mavsdk_json import fields_of
from support.px4.recorded import FOLDER, Replay, packets

FLOWN = FOLDER.parent / "flown"
V1_16 = ("F_v116-px4-0", "F_v116-px4-1", "F_v116-px4-2", "F_v116b-px4-0")  # stable v1.16.1
MAIN = ("F_nodisarm-px4-0",)  # main of March 2026
TAKING_OFF = 3  # MAV_LANDED_STATE
RESET_RAD = 0.015  # by rates and headings at 10 Hz: resets are larger; of main nothing in a takeoff is beyond 0.009
_METRES_PER_DEG = 111_195.0  # mean of a degree of latitude; a flight's extent is 20 m


class HeadingReset(NamedTuple):
    """In a takeoff. ``moved_m``: what of the position's step in between its velocity does not explain."""

    time_s: float
    step_rad: float
    up_m: float  # true height above the place where it stood
    moved_m: float


class Recorded(NamedTuple):
    """Messages of one recording, decoded by pymavlink. ``time_s``: since the first one."""

    time_s: float
    message: mavlink.MAVLink_message


def recorded(name: str, folder: Path = FLOWN) -> Iterator[Recorded]:
    """All of a recording that pymavlink knows."""
    for packet in packets(name, folder):
        try:
            yield Recorded(packet.time_s, mavlink.MAVLink(None).decode(bytearray(packet.data)))
        except mavlink.MAVError:
            continue


def heading_resets(messages: list[Recorded]) -> list[HeadingReset]:
    """Steps of the heading in takeoffs, at 10 Hz, beyond what the rates explain."""
    found: list[HeadingReset] = []
    landed, up_m, ground_m = 1, 0.0, 0.0
    before = place = None
    moved_m = 0.0
    for time_s, message in messages:
        match message.get_type():
            case "EXTENDED_SYS_STATE":
                ground_m = up_m if landed != message.landed_state == TAKING_OFF else ground_m
                landed = message.landed_state
            case "HIL_STATE_QUATERNION":
                up_m = message.alt * 1e-3
            case "LOCAL_POSITION_NED":
                moved_m = 0.0 if place is None else _unexplained_m(place, message)
                place = message
            case "ATTITUDE":
                if before is not None and landed == TAKING_OFF:
                    step_s = (message.time_boot_ms - before.time_boot_ms) * 1e-3
                    turned = 0.5 * step_s * (message.yawspeed + before.yawspeed)
                    step_rad = remainder(message.yaw - before.yaw - turned, tau)
                    if abs(step_rad) > RESET_RAD:
                        found.append(HeadingReset(time_s, step_rad, up_m - ground_m, moved_m))
                before = message
    return found


def _unexplained_m(before: mavlink.MAVLink_message, now: mavlink.MAVLink_message) -> float:
    half_s = 0.5e-3 * (now.time_boot_ms - before.time_boot_ms)
    north_m = now.x - before.x - half_s * (now.vx + before.vx)
    east_m = now.y - before.y - half_s * (now.vy + before.vy)
    return float((north_m**2 + east_m**2) ** 0.5)


class FlownReplay(Replay):
    """``resets``: of the heading, in takeoffs."""

    @cached_property
    def resets(self) -> list[HeadingReset]:
        return heading_resets(self.recorded)

    @cached_property
    def recorded(self) -> list[Recorded]:
        return list(recorded(self._name))

    @property
    def largest_error_m(self) -> float:
        """Of the local position, horizontally, against the simulator's truth, both from where it stood at first."""
        messages = self.recorded
        truths = [one for one in messages if one.message.get_type() == "HIL_STATE_QUATERNION"]
        places = [one for one in messages if one.message.get_type() == "LOCAL_POSITION_NED"]
        first, times_s = truths[0].message, [one.time_s for one in truths]
        per_lon = _METRES_PER_DEG * cos(radians(first.lat * 1e-7))
        north_m = [(one.message.lat - first.lat) * 1e-7 * _METRES_PER_DEG for one in truths]
        east_m = [(one.message.lon - first.lon) * 1e-7 * per_lon for one in truths]
        at_s = np.array([one.time_s for one in places])
        true_m = np.column_stack([np.interp(at_s, times_s, north_m), np.interp(at_s, times_s, east_m)])
        error_m = np.array([(one.message.x, one.message.y) for one in places]) - true_m
        begin = error_m[at_s < at_s[0] + WINDOW_S].mean(axis=0)
        return float(np.hypot(*(error_m - begin).T).max())

    def _received(self) -> Iterator[tuple[float, list[Message]]]:
        times, count = [one.time_s for one in self.resets], 0
        yield 0.0, [GlobalOrigin(*self._origin)]
        for packet in packets(self._name, FLOWN):
            found = fields_of(packet.data)
            if found is None:
                continue
            if found[0] == "ATTITUDE":
                told = mavlink.MAVLink(None).decode(bytearray(packet.data))
                count = sum(time_s <= packet.time_s for time_s in times)
                odometry = Odometry(time_usec=told.time_boot_ms * 1000, reset_counter=count)
                yield packet.time_s, [odometry, _attitude(told)]
            elif found[0] in DECODERS:
                yield packet.time_s, [DECODERS[found[0]].decode(found[1])]

    @property
    def _origin(self) -> tuple[int, int, int]:
        first = next(one.message for one in self.recorded if one.message.get_type() == "HIL_STATE_QUATERNION")
        return first.lat, first.lon, first.alt

    @staticmethod
    def _launch(name: str) -> LaunchPlace | None:
        """Measured: these recordings begin on the ground."""
        return None


def _attitude(told: mavlink.MAVLink_message) -> Attitude:
    (cr, sr), (cp, sp), (cy, sy) = ((cos(0.5 * a), sin(0.5 * a)) for a in (told.roll, told.pitch, told.yaw))
    return Attitude(
        time_boot_ms=told.time_boot_ms,
        q1=cr * cp * cy + sr * sp * sy,
        q2=sr * cp * cy - cr * sp * sy,
        q3=cr * sp * cy + sr * cp * sy,
        q4=cr * cp * sy - sr * sp * cy,
        rollspeed=told.rollspeed,
        pitchspeed=told.pitchspeed,
        yawspeed=told.yawspeed,
    )
