"""Recordings' commands and setpoints, sent to emulated PX4s at their times: all of a group in one fleet, in simulated time.

A recorder that waited for the vehicle is followed: at each change of a state of the recording (landed state, armed) the time of
the replay stands still until the emulated vehicle has that state too; the stream and the heartbeats go on. The same code
decodes the traffic and the recordings.
"""

from __future__ import annotations

import functools
import json
import lzma
import struct
from collections.abc import Sequence
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth
from radron.sim.vehicle.px4.config import Px4Config
from radron.sim.vehicle.px4.fleet import Px4Fleet
from radron.sim.vehicle.px4.mavlink.dialect import CurrentEventSequence, CurrentMode
from radron.sim.vehicle.px4.mavlink.streams import GROUND_STATION_HZ, ONBOARD_HZ
from radron.sim.world.localization import Localization, LocalizationTruth
from support.px4.timeline import _IGNORED_BITS, Packet, Row, Timeline

FILE = Path(__file__).parents[3] / "contract" / "recordings" / "timelines.json.xz"
STEP_S = 0.02
TICK_S, BEAT_S = 0.06, 1.0  # between two setpoints of a stream that stands still; between two heartbeats
LONGEST_WAIT_S = 40.0
PRELUDE_S = {"boot": 0.0, "ground": 6.0, "idle": 20.0, "air": 24.0}
HOVER_M = 3.0
UTC_NS = 1_795_313_620_000_000_000
RECORDED = {"COM_OBL_RC_ACT": 3.0, "RTL_RETURN_ALT": 10.0, "RTL_DESCEND_ALT": 10.0}  # as the recordings' README says
CHANGED: dict[str, dict[str, float]] = {
    "B_flight": {"MIS_TAKEOFF_ALT": 5.0},
    "D_loss_hold": {"COM_OBL_RC_ACT": 5.0},
    "D_loss_land": {"COM_OBL_RC_ACT": 4.0},
    "D_geofence_hold": {"GF_MAX_HOR_DIST": 50.0},
    "D_geofence_return": {"GF_MAX_HOR_DIST": 50.0, "GF_ACTION": 3.0},
    "D_datalink": {"NAV_DLL_ACT": 2.0},
    "D_battery_drain": {"SIM_BAT_MIN_PCT": 0.0},
    "E_": {"GF_ACTION": 3.0, "GF_MAX_HOR_DIST": 300.0, "COM_OBL_RC_ACT": 3.0, "SDLOG_MODE": 1.0},
}
_STATION, _COMPANION = (255, 190), 195
_LOOKED_AT = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 0.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 0.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 0.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 0.0,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.0,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 100_000.0,
    CurrentMode.id: 0.0,
    CurrentEventSequence.id: 0.0,
}
_OFFBOARD, _HOLD = 6 << 16, 3 << 24 | 4 << 16
POSITION_ONLY = 0x9F8 | 0x400


@functools.cache
def recordings() -> dict[str, dict[str, Any]]:
    """All by their names, as ``extract_timelines`` describes them."""
    return {entry["name"]: entry for entry in json.loads(lzma.decompress(FILE.read_bytes()))}


def start(name: str) -> str:
    """How a recording begins: "boot", on the "ground", after being "idle" there, in the "air"."""
    if "boot" in name:
        return "boot"
    if name in ("A_idle_gcs_arrives", "A_params"):
        return "idle"  # there was a ground station, which has gone
    landed = next(row for row in recordings()[name]["rows"] if row[1] == "landed")
    return "air" if landed[2] == mavlink.MAV_LANDED_STATE_IN_AIR else "ground"


class Replay:
    """A recording and an emulated vehicle. ``flown``: what passed, from the recording's first moment on; ``course``: the time,
    and position and velocity by the vehicle's estimate, NED.
    """

    def __init__(self, name: str, system: int, begin_s: float = 0.0) -> None:
        """``begin_s``: earlier packets are left out."""
        entry = recordings()[name]
        self.name, self.system = name, system
        self.flown = Timeline(name)
        self.course: list[tuple[float, ...]] = []
        self.parameters = {} if name.startswith("E_") else dict(RECORDED)
        for prefix, values in CHANGED.items():
            if name.startswith(prefix):
                self.parameters |= values
        self._start = start(name)
        self._sent = [row for row in entry["rows"] if row[1] in _SENDERS and row[0] >= begin_s * 1e3]
        self._stream: list[Row] = list(entry["setpoints"])
        self._barriers = _barriers(entry, begin_s)
        self._duration_s = entry["duration_ms"] * 1e-3
        self._place = next(row[2:] for row in entry["rows"] if row[1] == "place")
        self._home = next((row[2:] for row in entry["rows"] if row[1] == "home"), [0.0, 0.0, 0.0])
        self._origin = next((row[2:] for row in entry["rows"] if row[1] == "global_origin"), None)
        self._first_mode = next(row[2] for row in entry["rows"] if row[1] == "heartbeat")
        self._station = any(row[1] == "beat" and row[2:4] == list(_STATION) for row in self._sent)
        self._clock_s, self._begun, self._ended = begin_s, False, False
        self._senders: dict[tuple[int, int], Any] = {}
        self._last_setpoint: Row | None = None
        self._offset = (0.0, 0.0, 0.0)
        self._waited_s = 0.0

    def attach(self, face: Any) -> None:
        """To a vehicle's onboard link."""
        self.face = face
        self._link = face.links[0]
        self._link.attach(self._hear)
        if len(face.links) > 1:
            face.links[1].attach(lambda data: None)
            for number in GROUND_STATION_HZ:
                face.links[1].schedule.set_interval(number, -1.0, 0.0)
        for number in ONBOARD_HZ:
            interval_us = _LOOKED_AT.get(number, -1.0)
            if interval_us:
                self._link.schedule.set_interval(number, interval_us, 0.0)

    @property
    def over(self) -> bool:
        """Whether the recording has ended."""
        return self._clock_s > self._duration_s and not self._barriers

    def step(self, now_s: float) -> None:
        """Send the packets that are due; ``now_s`` of the fleet."""
        self._now_s = now_s
        since_s = now_s - PRELUDE_S[self._start]
        if not self._begun:
            if self._start == "boot" and (self._link.cut or now_s < TICK_S):
                return
            if since_s < 0.0:
                self._prepare(now_s)
                return
            self._begin()
        if self._waits():
            self._waited_s += STEP_S
            assert self._waited_s < LONGEST_WAIT_S, (self.name, self._clock_s, self._barriers[0], self.face.commander.mode)
            streaming = self._last_setpoint is not None and self._clock_s * 1e3 - self._last_setpoint[0] < 200.0
            if self._every(TICK_S) and streaming and self._last_setpoint is not None:
                self._send_setpoint(self._last_setpoint)
            if self._every(BEAT_S):
                self._beat(_COMPANION)
                if self._station:
                    self._beat(_STATION[1])
            return
        self._clock_s += STEP_S
        self._ended = self.over
        now = self.face._state.now
        self.course.append((self._clock_s, *now.position_ned_m, *now.velocity_ned_mps))
        due_ms = self._clock_s * 1e3
        while self._stream and self._stream[0][0] <= due_ms:
            self._last_setpoint = self._stream.pop(0)
            self._send_setpoint(self._last_setpoint)
        while self._sent and self._sent[0][0] <= due_ms:
            row = self._sent.pop(0)
            _SENDERS[row[1]](self, row)

    # Before the recording

    def _prepare(self, now_s: float) -> None:
        """Bring the vehicle to where the recording found it."""
        idle = self._start == "idle"
        if self._every(BEAT_S) and now_s > 1.0:
            self._beat(_COMPANION)
            left_s = 13.4 if self.name == "A_params" else 3.0
            if (self._station and not idle) or (idle and now_s < left_s):
                self._beat(_STATION[1])
        if self.name == "A_idle_gcs_arrives" and self._at(5.8):
            self._ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)  # and it is disarmed as nothing comes of it
        if self._start == "ground" and self._first_mode == _OFFBOARD and self._at(4.5):
            self._ask(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 6.0, 0.0)
        if self._start == "air":
            self._take_off(now_s)

    def _take_off(self, now_s: float) -> None:
        """To where the recording begins, and there into its mode."""
        if self._at(4.5):
            self._param_set([0, "param_set", "MIS_TAKEOFF_ALT", HOVER_M, mavlink.MAV_PARAM_TYPE_REAL32])
        if self._at(4.52):
            self._ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            self._ask(mavlink.MAV_CMD_NAV_TAKEOFF, *[nan] * 7)
        if now_s > 13.5 and self._every(TICK_S):
            self._adopt_home()
            self._send_setpoint([0, POSITION_ONLY, *(round(value * 1e3) for value in self._place)])
        if self._at(13.7):
            self._ask(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 6.0, 0.0)
        if self._at(23.5) and self._first_mode == _HOLD:
            self._ask(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 4.0, 3.0)

    def _begin(self) -> None:
        self._begun = True
        self._adopt_home()
        self.flown.take(Packet(round(self._now_s * 1e6), self.system, _COMPANION, 0xFFFFFF, bytes(12)))  # the first moment

    def _adopt_home(self) -> None:
        """Places are kept beside home, heights above where it stood: a recorded home's height is wrong by up to 2 m."""
        east, north, up = self.face.commander.home
        self._offset = (north - self._home[0], east - self._home[1], -up)

    def _waits(self) -> bool:
        while self._barriers and self._barriers[0][0] <= self._clock_s * 1e3:
            _, kind, wanted = self._barriers[0]
            commander = self.face.commander
            shown = commander.landed_state if kind == "landed" else commander.armed
            if shown != wanted:
                return True
            self._barriers.pop(0)
            self._waited_s = 0.0
        return False

    def _at(self, seconds: float) -> bool:
        return abs(self._now_s - seconds) < 0.5 * STEP_S

    def _every(self, seconds: float) -> bool:
        return round(self._now_s / STEP_S) % round(seconds / STEP_S) == 0

    # Both ways

    def _hear(self, data: bytes) -> None:
        if self._begun and not self._ended:
            self._note(data)

    def _note(self, data: bytes) -> None:
        number = int.from_bytes(data[7:10], "little")
        self.flown.take(Packet(round(self._now_s * 1e6), data[5], data[6], number, data))

    def _send(self, message: Any, sender: tuple[int, int]) -> None:
        if sender not in self._senders:
            self._senders[sender] = mavlink.MAVLink(None, *sender)
        data = bytes(message.pack(self._senders[sender]))
        elsewhere = sender == _STATION and len(self.face.links) > 1  # on the other link, from which its heartbeats are passed on
        if self._begun and not elsewhere:
            self._note(data)
        self.face.links[elsewhere].hear(data, UTC_NS + round(self._now_s * 1e9))

    def _own(self, message: Any) -> None:
        self._send(message, (self.system, _COMPANION))

    def _beat(self, component: int) -> None:
        kind = mavlink.MAV_TYPE_GCS if component == _STATION[1] else mavlink.MAV_TYPE_ONBOARD_CONTROLLER
        self._heartbeat([0, "beat", 255 if component == _STATION[1] else 1, component, kind])

    def _ask(self, number: int, *parameters: float) -> None:
        filled = [*parameters, *[0.0] * (7 - len(parameters))]
        self._own(mavlink.MAVLink_command_long_message(self.system, 1, number, 0, *filled))

    # Packets sent

    def _heartbeat(self, row: Row) -> None:
        _, _, system, component, kind = row
        message = mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3)
        self._send(message, (255 if system == 255 else self.system, component))

    def _command(self, row: Row) -> None:
        _, _, number, parameters, component, meant, sender, sender_component, by_int = row
        values = [nan if value is None else value for value in parameters]
        if number == mavlink.MAV_CMD_EXTERNAL_POSITION_ESTIMATE and not by_int:
            place = self.face._state.now.place
            metres = 10.0 if self._clock_s < 5.0 else 3.0  # north of where it is, as the recorder says
            values[4:6] = [place.latitude_deg + metres / 111_230.0, place.longitude_deg]
        target = (self.system if meant else self.system + 100, component)
        if number == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL and int(values[0]) not in _LOOKED_AT:
            values[1] = -1.0  # not examined here
        if by_int:
            message = mavlink.MAVLink_command_int_message(*target, 0, number, 0, 0, *values[:4], 0, 0, nan)
        else:
            message = mavlink.MAVLink_command_long_message(*target, number, 0, *values)
        self._send(message, (255 if sender == 255 else self.system, sender_component))

    def _param_set(self, row: Row) -> None:
        _, _, name, value, kind = row
        wire = struct.unpack("<f", struct.pack("<i", int(value)))[0] if kind == mavlink.MAV_PARAM_TYPE_INT32 else value
        self._own(mavlink.MAVLink_param_set_message(self.system, 1, name.encode(), wire, kind))

    def _param_read(self, row: Row) -> None:
        self._own(mavlink.MAVLink_param_request_read_message(self.system, 1, row[2].encode(), row[3]))

    def _param_list(self, row: Row) -> None:
        self._own(mavlink.MAVLink_param_request_list_message(self.system, 1))

    def _move_origin(self, row: Row) -> None:
        latitude, longitude, altitude = self.face._state.origin
        moved = [new - old for new, old in zip(row[2:], self._origin or row[2:], strict=True)]
        place = (round(latitude * 1e7) + moved[0], round(longitude * 1e7) + moved[1], round(altitude * 1e3) + moved[2])
        if moved == [0, 0, 0] and self._moved_from is not None:
            place = self._moved_from
        self._moved_from = (round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3))
        self._own(mavlink.MAVLink_set_gps_global_origin_message(self.system, *place))

    _moved_from: tuple[int, int, int] | None = None

    def _send_setpoint(self, row: Row) -> None:
        mask = row[1]
        given = iter(row[2:])
        values = [0.0 if mask >> bit & 1 else _metres(next(given)) for bit in _IGNORED_BITS]
        values[:3] = [value + offset for value, offset in zip(values, self._offset, strict=False)]
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, self.system, 1, mavlink.MAV_FRAME_LOCAL_NED, mask, *values
        )
        self._own(message)


_SENDERS = {
    "beat": Replay._heartbeat,
    "command": Replay._command,
    "param_set": Replay._param_set,
    "param_read": Replay._param_read,
    "param_list": Replay._param_list,
    "origin": Replay._move_origin,
}


def _metres(thousandths: int | None) -> float:
    return nan if thousandths is None else thousandths * 1e-3


def _barriers(entry: dict[str, Any], begin_s: float) -> list[tuple[int, str, int | bool]]:
    """(when, what, which) the emulated vehicle must have shown before the recording goes on. None where satellites are lost: then
    a landing is noticed in one recording and not in another, and so here; nor after the start, when it may not be armed yet.
    """
    found: list[tuple[int, str, int | bool]] = []
    armed = False
    for row in entry["rows"]:
        if row[0] < begin_s * 1e3 or entry["name"].startswith(("D_gps_loss", "A_boot")):
            continue
        if row[1] == "landed" and row[0] > 500:
            found.append((row[0], "landed", row[2]))
        elif row[1] == "heartbeat" and bool(row[3] & 128) != armed:
            armed = bool(row[3] & 128)
            found.append((row[0], "armed", armed))
    return found


def replay(names: Sequence[str], seed: int, begin_s: float = 0.0) -> list[Replay]:
    """All of these recordings at once, each by a vehicle of its own."""
    rng = np.random.default_rng(seed)
    count = len(names)
    replays = [Replay(name, index + 1, begin_s) for index, name in enumerate(names)]
    places = np.array([(300.0 * index, 0.0, 0.0) for index in range(count)])
    motion = Multirotors(MultirotorTruth(), places, np.zeros(count), STEP_S, rng)
    error = Localization(LocalizationTruth(), count, STEP_S, rng)
    nowhere = ("127.0.0.1", 9)
    configs = [
        Px4Config(onboard=nowhere, ground_station=nowhere if one.name.startswith("E_") else None, parameters=one.parameters)
        for one in replays
    ]
    now_ns = [UTC_NS]
    fleet = Px4Fleet(configs, motion, error, STEP_S, rng, clock_ns=lambda: now_ns[0])
    for one, face in zip(replays, fleet.faces, strict=True):
        one.attach(face)
    while not all(one.over for one in replays):
        now_ns[0] += round(STEP_S * 1e9)
        for one in replays:
            if not one.over:
                one.step(fleet.time_s)
        fleet.step()
    assert all(isfinite(value) for value in motion.position_m.ravel())
    return replays
