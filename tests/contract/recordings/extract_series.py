"""How a real PX4 followed setpoints, out of its recordings C: series.npz.xz.

    python extract_series.py FOLDER-OF-THE-TLOGS

Arrays NAME/setpoint, NAME/estimate and NAME/truth for each recording, int32, one column for each quantity, each row but the first
as the difference to the row before. Times are those of sending or of reception in units of 0.1 ms, since the first packet: the
vehicle's own clock loses 1 % against them, and the truth's stamp is not of the vehicle's clock at all.
``tests/lib/support/px4/recorded_series.py`` reads it. Columns, local NED, of the units that are named in ``UNITS``:

setpoint: time, type_mask, position, velocity and acceleration (the ignored ones, too, are the reference), yaw, yaw rate
estimate: time, position, velocity, yaw, from LOCAL_POSITION_NED and the newest ATTITUDE
truth: time, position, velocity, roll, pitch, yaw, from HIL_STATE_QUATERNION, relative to GPS_GLOBAL_ORIGIN
"""

from __future__ import annotations

import io
import lzma
import sys
from collections.abc import Iterator
from math import asin, atan2, cos, pi, radians
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

OUTPUT = Path(__file__).parent / "series.npz.xz"
VEHICLE, COMPANION = 1, 195  # components
_LAYOUTS = {
    "setpoint": [1e-4, 1.0] + [1e-3] * 9 + [1e-3, 1e-3],
    "estimate": [1e-4] + [1e-3] * 6 + [1e-3],
    "truth": [1e-4] + [1e-3] * 3 + [1e-2] * 3 + [1e-3] * 3,
}
UNITS = {series: np.array(units) for series, units in _LAYOUTS.items()}
# PX4 projects onto a sphere about its origin.
_METRES_PER_DEGREE = 6371000.0 * pi / 180.0

Rows = dict[str, list[list[float]]]


def packets(path: Path) -> Iterator[tuple[float, int, bytes]]:
    """Time in seconds, component and raw packet of each line of a ``.tlog.xz``."""
    data, at = lzma.decompress(path.read_bytes()), 0
    while at + 8 < len(data):
        time_us, begin = int.from_bytes(data[at : at + 8], "big"), at + 8
        assert data[begin] == 0xFD, "MAVLink 2"
        at = begin + 12 + data[begin + 1] + 13 * (data[begin + 2] & 1)
        yield time_us * 1e-6, data[begin + 6], data[begin:at]


def series(path: Path) -> Rows:
    """The three series of one recording."""
    decoder = mavlink.MAVLink(None)
    numbers = {mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION}
    numbers |= {mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_ATTITUDE}
    rows: Rows = {name: [] for name in UNITS}
    began_s: float | None = None
    origin, yaw = None, 0.0
    places: list[tuple[float, mavlink.MAVLink_hil_state_quaternion_message]] = []
    for stamp_s, component, packet in packets(path):
        began_s = stamp_s if began_s is None else began_s
        number = int.from_bytes(packet[7:10], "little")
        if component == COMPANION and number == mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
            rows["setpoint"].append([stamp_s - began_s, *_setpoint(decoder.decode(bytearray(packet)))])
        if component != VEHICLE or number not in numbers:
            continue
        message, time_s = decoder.decode(bytearray(packet)), stamp_s - began_s
        if number == mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
            assert origin in (None, (message.latitude, message.longitude, message.altitude)), "an origin that stays"
            origin = (message.latitude, message.longitude, message.altitude)
        elif number == mavlink.MAVLINK_MSG_ID_ATTITUDE:
            yaw = message.yaw
        elif number == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            place = (message.x, message.y, message.z, message.vx, message.vy, message.vz)
            rows["estimate"].append([time_s, *place, yaw])
        else:
            places.append((time_s, message))
    assert origin is not None
    rows["truth"] = [[time_s, *_truth(message, origin)] for time_s, message in places]
    return rows


def _setpoint(m: mavlink.MAVLink_set_position_target_local_ned_message) -> list[float]:
    return [m.type_mask, m.x, m.y, m.z, m.vx, m.vy, m.vz, m.afx, m.afy, m.afz, m.yaw, m.yaw_rate]


def _truth(m: mavlink.MAVLink_hil_state_quaternion_message, origin: tuple[int, int, int]) -> list[float]:
    north = (m.lat - origin[0]) * 1e-7 * _METRES_PER_DEGREE
    east = (m.lon - origin[1]) * 1e-7 * _METRES_PER_DEGREE * cos(radians(origin[0] * 1e-7))
    w, x, y, z = m.attitude_quaternion
    roll = atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = asin(max(-1.0, min(2.0 * (w * y - z * x), 1.0)))
    yaw = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return [north, east, (origin[2] - m.alt) * 1e-3, m.vx * 1e-2, m.vy * 1e-2, m.vz * 1e-2, roll, pitch, yaw]


def _differences(rows: list[list[float]], units: NDArray[np.float64]) -> NDArray[np.int32]:
    whole = np.rint(np.array(rows) / units).astype(np.int32)
    return np.diff(whole, axis=0, prepend=np.zeros((1, whole.shape[1]), dtype=np.int32))


def main() -> None:
    """Write the file."""
    arrays = {}
    for path in sorted(Path(sys.argv[1]).glob("C_*.tlog.xz")):
        for name, rows in series(path).items():
            # Columns one after another: alike values beside each other make a smaller file.
            arrays[f"{path.name.removesuffix('.tlog.xz')}/{name}"] = np.asfortranarray(_differences(rows, UNITS[name]))
    plain = io.BytesIO()
    np.savez(plain, **arrays)
    OUTPUT.write_bytes(lzma.compress(plain.getvalue(), preset=9 | lzma.PRESET_EXTREME))


if __name__ == "__main__":
    main()
