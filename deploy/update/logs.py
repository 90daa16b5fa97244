"""Copies of the flight records of many onboard computers, each verified by its hash, for ``radron-deploy logs``."""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from radron.deploy.digest import digest
from radron.deploy.remote import Host, fetch, run
from radron.deploy.update.hosts import Tell

FLIGHTS = "/var/lib/radron/flights"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}")
# Present size and digest of each record: the newest record may still grow during its copy.
_LIST = (
    'cd {folder} 2>/dev/null || exit 0; for file in *.mcap; do test -f "$file" || continue; '
    'size=$(stat -c %s "$file"); echo "$size $(head -c "$size" "$file" | sha256sum | cut -d\' \' -f1) $file"; done'
)


@dataclass(frozen=True, slots=True)
class Fetched:
    """Result of copying one computer's flight records: number of all records, and of the newly copied ones."""

    records: int
    new: int
    folder: Path


async def fetch_logs(host: Host, out: Path, tell: Tell, source: str = FLIGHTS) -> Fetched:
    """Copy the flight records of a computer that are missing here into ``out/NAME``.

    The next call completes an interrupted copy. ``source``: folder of the records on board.

    Raises:
        RemoteError: no connection, or a copy that differs.
        OSError: a record cannot be written here.
    """
    tell(host, "looking at its records", 0, 0)
    folder = out / re.sub(r"[^A-Za-z0-9.-]", "_", host.name)
    folder.mkdir(parents=True, exist_ok=True)
    listed = [line.split(" ", 2) for line in (await run(host, _LIST.format(folder=source))).splitlines()]
    new = 0
    for size, sha256, name in listed:
        if _NAME.fullmatch(name) is None or re.fullmatch("[0-9a-f]{64}", sha256) is None or not size.isdecimal():
            raise host.error(f"a record with an impossible name, {name[:40]!r}: not copied")
        file = folder / name
        if file.exists() and file.stat().st_size == int(size) and await asyncio.to_thread(digest, file) == sha256:
            continue
        if file.exists():  # the record has grown since its last copy
            file.replace(file.with_name(f"{name}.part"))
        await fetch(host, f"{source}/{name}", file, int(size), sha256, partial(tell, host, name))
        new += 1
    return Fetched(len(listed), new, folder)
