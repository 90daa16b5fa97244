"""Traffic to a ground station on the links of recorded vehicles, thinned out: ``python extract_links.py FOLDER_OF_THE_TLOGS``.

``two_vehicles.tlog.xz``: vehicles 1 and 2 from standing to flying by setpoints, with all that their links forward, and the true
states. ``offboard_loss.tlog.xz``: a vehicle; its stream of setpoints stops. Format as of the recordings: 8 bytes of UTC in
microseconds, big-endian, then the packet as it was.
"""

from __future__ import annotations

import lzma
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
_HEARTBEAT, _ATTITUDE, _POSITION, _TRUTH, _SYSTEM_STATE, _TEXT = 0, 31, 32, 115, 245, 253
_EVERY = {_HEARTBEAT: 1, _ATTITUDE: 20, _POSITION: 6, _TRUTH: 5, _SYSTEM_STATE: 2, _TEXT: 1}
_TWO = ("E_mission_d1_onboard", "E_mission_d2_onboard", "E_mission_d1_truth_link", "E_mission_d2_truth_link")


class Packet(NamedTuple):
    """A packet of MAVLink 2. ``stamp_us``: UTC."""

    stamp_us: int
    data: bytes

    @property
    def number(self) -> int:
        """Of the kind of message."""
        return int.from_bytes(self.data[7:10], "little")

    @property
    def source(self) -> tuple[int, int]:
        """System and component."""
        return self.data[5], self.data[6]


def packets(file: Path) -> Iterator[Packet]:
    """All packets of a compressed recording."""
    content = lzma.decompress(file.read_bytes())
    at = 0
    while at < len(content):
        length = 12 + content[at + 9] + 13 * (content[at + 10] & 1)
        yield Packet(int.from_bytes(content[at : at + 8], "big"), content[at + 8 : at + 8 + length])
        at += 8 + length


def thinned(file: Path, from_s: float, to_s: float) -> Iterator[Packet]:
    """Of each kind that a ground station reads every so many, between two times since the recording's start."""
    seen: dict[tuple[int, tuple[int, int]], int] = {}
    began_us = None
    for packet in packets(file):
        began_us = began_us or packet.stamp_us
        kind = (packet.number, packet.source)
        seen[kind] = seen.get(kind, -1) + 1
        wanted = packet.number in _EVERY and seen[kind] % _EVERY[packet.number] == 0
        if wanted and from_s <= (packet.stamp_us - began_us) * 1e-6 < to_s:
            yield packet


def write(name: str, chosen: list[Packet]) -> None:
    """Write packets, in the order of their times, beside this file."""
    content = b"".join(packet.stamp_us.to_bytes(8, "big") + packet.data for packet in sorted(chosen))
    (HERE / name).write_bytes(lzma.compress(content, preset=9 | lzma.PRESET_EXTREME))


def extract(folder: Path) -> None:
    """Make both files from the recordings in a folder."""
    write("two_vehicles.tlog.xz", [packet for name in _TWO for packet in thinned(folder / f"{name}.tlog.xz", 32.0, 52.0)])
    write("offboard_loss.tlog.xz", list(thinned(folder / "D_loss_return_act3_hover.tlog.xz", 4.0, 10.0)))


if __name__ == "__main__":
    extract(Path(sys.argv[1]))
