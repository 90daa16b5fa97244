"""Commands to a real PX4 and its answers, out of its recordings A, B, D and E: timelines.json.xz.

    PYTHONPATH=tests/lib python tests/contract/recordings/extract_timelines.py FOLDER-OF-THE-TLOGS

One entry for each recording: "name", "system" (of the vehicle), "duration_ms", "rates_hz" (of the vehicle's messages by number),
"setpoints" ([ms, mask, ...], the values that the mask does not ignore, in 1/1000, NaN as null) and "rows" ([ms, kind, ...], times
since the first packet). Kinds sent to the vehicle:
    beat(system, component, type)   command(number, parameters, component of the target, target is the vehicle, sender's system,
    sender's component, by COMMAND_INT)   param_set(name, value, type)   param_read(name, index)   param_list()
    origin(latitude, longitude, altitude)
and what came back, states only where they have changed:
    heartbeat(custom mode, base mode, status)   mode(custom mode, intended, standard mode)   landed(state)
    ack(command, result, target system, target component)   event(id, levels, arguments)   text(severity, text, id, chunk)
    param_error(name, error)   param_value(name, value, type)   fix(type, satellites)   resets(ODOMETRY.reset_counter)
    global_origin(latitude, longitude, altitude)   sensors(present, enabled, health)   home(local north, east, down)
    place(local north, east, down at the beginning)   estimator(flags)
and of recordings in which the filter is disturbed
    estimator(flags, ratios of velocity and position, accuracies claimed)   error(estimate minus truth, north, east, down)
"""

from __future__ import annotations

import json
import lzma
import sys
from collections.abc import Iterator
from pathlib import Path

from support.px4.timeline import Packet, Timeline

GROUPS = "ABDE"
OUTPUT = Path(__file__).parent / "timelines.json.xz"


def packets(path: Path) -> Iterator[Packet]:
    """A ``.tlog.xz`` from its beginning."""
    data, at = lzma.decompress(path.read_bytes()), 0
    while at + 8 < len(data):
        time_us, begin = int.from_bytes(data[at : at + 8], "big"), at + 8
        assert data[begin] == 0xFD, "MAVLink 2"
        at = begin + 12 + data[begin + 1] + (13 if data[begin + 2] & 1 else 0)
        number = int.from_bytes(data[begin + 7 : begin + 10], "little")
        yield Packet(time_us, data[begin + 5], data[begin + 6], number, data[begin:at])


def extract(folder: Path) -> None:
    """Write timelines.json.xz from the recordings in ``folder``; truth links of E have nothing for it."""
    entries = []
    for path in sorted(folder.glob("*.tlog.xz")):
        if path.name[0] in GROUPS and "truth_link" not in path.name:
            timeline = Timeline(path.name.removesuffix(".tlog.xz"))
            for packet in packets(path):
                timeline.take(packet)
            entries.append(timeline.entry())
    OUTPUT.write_bytes(lzma.compress(json.dumps(entries, separators=(",", ":")).encode(), preset=9))


if __name__ == "__main__":
    extract(Path(sys.argv[1]))
