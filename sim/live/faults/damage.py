"""Damage to the files of an agent in a live flight: its saved state or its flight record."""

from __future__ import annotations

import shutil
from pathlib import Path
from random import Random


def damage(folder: Path, how: str, random: Random) -> str:
    """Damage the newest state file in a drone's folder, or the present flight record; return a report of the damage.

    ``how``: kind of damage, as in the fault ``disk``.
    """
    if how == "record-removed":
        shutil.rmtree(folder / "flight", ignore_errors=True)
        return "the folder of the flight records is removed"
    state = how.startswith("state")
    files = sorted((folder / ("state" if state else "flight")).glob("*.json" if state else "*.mcap"))
    if not files:
        return f"{how}: there is no file yet"
    path = files[-1]
    if how.endswith("torn"):
        with path.open("r+b") as file:
            file.truncate(path.stat().st_size // 2)
        return f"{path.name} is torn"
    content = bytearray(path.read_bytes())
    for _ in range(8):
        if content:
            content[random.randrange(len(content))] ^= 1 << random.randrange(8)
    path.write_bytes(content)
    return f"{path.name} has flipped bits"
