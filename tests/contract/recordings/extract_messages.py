"""From the recordings to the input of a driver of PX4: the very packets, as far as it reads them, and the packets sent to PX4.

    python extract_messages.py FOLDER-OF-THE-TLOGS

messages/NAME.xz: of the frequent messages ten a second are kept, of ODOMETRY two and each with a changed count of resets: the
driver reads nothing else of it. A file has the format of a .tlog: 8 bytes of microseconds (UTC, big-endian), a packet,
and so on.
airborne.json: when the vehicle was truly higher than 0.3 m above ground, by the simulator's own state; seconds since the file's
first packet, and the whole time with that state known.
"""

from __future__ import annotations

import json
import lzma
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

AUTOPILOT, COMPANION = 1, 195  # components
STAMP_BYTES, CHECKSUM_BYTES, SIGNATURE_BYTES, HEAD_BYTES = 8, 2, 13, 10
_HEARTBEAT, _ODOMETRY, _RESETS_AT = 0, 331, 230  # the last one: place of reset_counter in ODOMETRY
_TRUTH, _ALTITUDE_AT = 115, 44  # HIL_STATE_QUATERNION, and the place of alt (mm) in it
GROUND_M, HIGH_M = 275.0, 0.3
# Message ids and the least time between two of them, seconds.
_READ = {
    0: 0.0,  # HEARTBEAT
    1: 0.0,  # SYS_STATUS
    22: 0.0,  # PARAM_VALUE
    24: 0.0,  # GPS_RAW_INT
    31: 0.095,  # ATTITUDE_QUATERNION
    32: 0.095,  # LOCAL_POSITION_NED
    49: 0.0,  # GPS_GLOBAL_ORIGIN
    77: 0.0,  # COMMAND_ACK
    132: 0.19,  # DISTANCE_SENSOR
    147: 0.0,  # BATTERY_STATUS
    230: 0.0,  # ESTIMATOR_STATUS
    242: 0.9,  # HOME_POSITION
    245: 0.0,  # EXTENDED_SYS_STATE
    253: 0.0,  # STATUSTEXT
    331: 0.48,  # ODOMETRY
    345: 0.0,  # PARAM_ERROR
    410: 0.0,  # EVENT
    436: 0.0,  # CURRENT_MODE
}
_SENT = (20, 23, 76)  # PARAM_REQUEST_READ, PARAM_SET, COMMAND_LONG


def extract(source: Path, target: Path) -> None:
    """Write ``target``/messages/NAME.xz for each of ``source``'s A, B, D and E files of an onboard link."""
    folder = target / "messages"
    folder.mkdir(exist_ok=True)
    flights = {}
    for path in sorted(source.glob("[ABDE]_*.tlog.xz")):
        name = path.name.removesuffix(".tlog.xz")
        if name.endswith("truth_link"):
            continue
        recorded = list(packets(lzma.decompress(path.read_bytes())))
        data = b"".join(kept(iter(recorded)))
        (folder / f"{name}.xz").write_bytes(lzma.compress(data, preset=9 | lzma.PRESET_EXTREME))
        beside = source / f"{name.removesuffix('onboard')}truth_link.tlog.xz"
        true = list(packets(lzma.decompress(beside.read_bytes()))) if beside.exists() else recorded
        flights[name] = airborne(recorded[0][0], true)
    (target / "airborne.json").write_text(json.dumps(flights, indent=1) + "\n")


def packets(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Stamps (microseconds) and packets of an unpacked file; MAVLink 2 only."""
    place = 0
    while place + STAMP_BYTES < len(data):
        begin = place + STAMP_BYTES
        length = HEAD_BYTES + data[begin + 1] + CHECKSUM_BYTES + (SIGNATURE_BYTES if data[begin + 2] & 1 else 0)
        yield int.from_bytes(data[place:begin], "big"), data[begin : begin + length]
        place = begin + length


def message_id(packet: bytes) -> int:
    """Of a MAVLink 2 packet."""
    return int.from_bytes(packet[7:10], "little")


def airborne(first_us: int, true: list[tuple[int, bytes]]) -> dict[str, list[list[float]]]:
    """Intervals (s) with the vehicle in the air by HIL_STATE_QUATERNION, and the interval with any such message."""
    heights = [
        (round((stamp_us - first_us) * 1e-6, 2), _height_m(packet))
        for stamp_us, packet in true
        if message_id(packet) == _TRUTH and packet[6] == AUTOPILOT
    ]
    found: list[list[float]] = []
    flies = False
    for time_s, height_m in heights:
        if (height_m > HIGH_M) is not flies:
            flies = not flies
            if flies:
                found.append([time_s, time_s])
        if flies:
            found[-1][1] = time_s
    return {"known": [[heights[0][0], heights[-1][0]]] if heights else [], "airborne": found}


def _height_m(packet: bytes) -> float:
    """Above the plane on which the simulated vehicle stands."""
    payload = packet[HEAD_BYTES:-CHECKSUM_BYTES].ljust(64, b"\0")
    return float(struct.unpack_from("<i", payload, _ALTITUDE_AT)[0]) * 1e-3 - GROUND_M


def kept(recorded: Iterator[tuple[int, bytes]]) -> Iterator[bytes]:
    """Packets that a file keeps."""
    last_us: dict[int, int] = {}
    resets = -1
    for place, (stamp_us, packet) in enumerate(recorded):
        number, component = message_id(packet), packet[6]
        if place == 0:
            pass  # times are counted from it
        elif component == AUTOPILOT:
            if number not in _READ:
                continue
            payload = packet[HEAD_BYTES:-CHECKSUM_BYTES]
            count = payload[_RESETS_AT] if number == _ODOMETRY and len(payload) > _RESETS_AT else 0
            another = number == _ODOMETRY and count != resets
            if not another and stamp_us - last_us.get(number, 0) < _READ[number] * 1e6:
                continue
            last_us[number] = stamp_us
            resets = count if number == _ODOMETRY else resets
        elif number != _HEARTBEAT and not (component == COMPANION and number in _SENT):
            continue
        yield stamp_us.to_bytes(STAMP_BYTES, "big") + packet


if __name__ == "__main__":
    extract(Path(sys.argv[1]), Path(__file__).parent)
