"""From the recordings of radron's own agents to what PX4 said of itself in them, thinned out.

    python extract_flown.py FOLDER-OF-THE-TLOGS

flown/NAME.xz: packets as they were, each after its stamp (8 bytes of microseconds, UTC, big-endian). The recordings are of
another link than the agents': without ODOMETRY and ATTITUDE_QUATERNION, and with ATTITUDE and the simulator's true state.
"""

from __future__ import annotations

import lzma
import sys
from pathlib import Path

from extract_messages import AUTOPILOT, STAMP_BYTES, message_id, packets

# Message ids and the least time between two of them, seconds.
_READ = {
    0: 0.0,  # HEARTBEAT
    1: 0.9,  # SYS_STATUS
    24: 0.45,  # GPS_RAW_INT
    30: 0.0,  # ATTITUDE
    32: 0.0,  # LOCAL_POSITION_NED
    115: 0.19,  # HIL_STATE_QUATERNION
    230: 0.9,  # ESTIMATOR_STATUS
    242: 1.9,  # HOME_POSITION
    245: 0.19,  # EXTENDED_SYS_STATE
    410: 0.0,  # EVENT
}
_NAMES = ("F_v116-px4-0", "F_v116-px4-1", "F_v116-px4-2", "F_v116b-px4-0", "F_nodisarm-px4-0")


def extract(source: Path, target: Path) -> None:
    """Write ``target``/flown/NAME.xz for each of ``_NAMES``."""
    folder = target / "flown"
    folder.mkdir(exist_ok=True)
    for name in _NAMES:
        last_us: dict[int, int] = {}
        kept = b""
        for stamp_us, packet in packets(lzma.decompress((source / f"{name}.tlog.xz").read_bytes())):
            number = message_id(packet)
            if packet[6] != AUTOPILOT or stamp_us - last_us.get(number, 0) < _READ.get(number, float("inf")) * 1e6:
                continue
            last_us[number] = stamp_us
            kept += stamp_us.to_bytes(STAMP_BYTES, "big") + packet
        (folder / f"{name}.xz").write_bytes(lzma.compress(kept, preset=9 | lzma.PRESET_EXTREME))


if __name__ == "__main__":
    extract(Path(sys.argv[1]), Path(__file__).parent)
