"""The report on a mission at an operator's request, during a live flight or from open flight records."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from radron.protocol.identity import Identity
from radron.station.hub import Hub

if TYPE_CHECKING:
    from radron.station.replay import Records


def reports(
    hub: Hub, identity: Identity | None, paths: Sequence[Path] = (), records: Records | None = None
) -> Callable[[], Awaitable[bytes]]:
    """Return a function that makes the report on the present state of a mission, as a ZIP archive.

    ``identity``: certificate and key with which the report is signed; None: unsigned. ``paths`` and ``records``: the flight
    records that the station shows; None: a live flight.
    """

    async def report() -> bytes:
        await asyncio.to_thread(import_module, "radron.station.findings.command")  # seconds, while pages are served
        from radron.station.findings.command import zipped  # noqa: PLC0415
        from radron.station.findings.facts import facts_of, of_records, of_station  # noqa: PLC0415

        live = of_station({"radron": version("radron")}, hub.picture.orders)
        source = live if records is None else await asyncio.to_thread(of_records, paths, records)
        return await asyncio.to_thread(zipped, await facts_of(hub, source), identity)

    return report
