"""``radron-agent status`` and ``watch``: the swarm by its drones' reports, on a terminal."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import UNSET, Struct
from msgspec.structs import replace

from radron.agent.config.loading import load_mission
from radron.agent.errors import RadronError
from radron.agent.frames.geodesy import geodetic_from_mission
from radron.agent.operator.statuses import legible
from radron.protocol.codec import decode_from
from radron.protocol.errors import ProtocolError
from radron.protocol.identity import load_identity
from radron.protocol.mesh.diagnosis import refusals
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.message import DroneMessage
from radron.protocol.messages import Estimate, Source, Status
from radron.protocol.signing import Verifier
from radron.protocol.spectrum import unknown_nuclide

if TYPE_CHECKING:
    from rich.console import RenderableType

    from radron.agent.config.mission import MissionConfig

LISTEN_S = 2.5  # a drone publishes its status every second
STALE_S = 3.0
REFRESH_S = 0.5


class OverviewError(RadronError):
    """There is nothing to show, because no drone is heard, or options contradict each other."""


class Place(Struct, frozen=True):
    """The options of ``status`` and ``watch``: swarm, its network addresses, and the observer's certificate.

    ``mission``: file that gives latitude and longitude, and the drones that the swarm should have.
    """

    swarm: str
    connect: tuple[str, ...]
    identity: Path | None
    mission: Path | None


def place_of(swarm: str, connect: Sequence[str], identity: Path | None, insecure: bool, mission: Path | None) -> Place:
    """Return the options of ``status`` and ``watch`` in one object; raises OverviewError if they contradict each other."""
    if insecure == (identity is not None):
        make = "run `radron-deploy pki issue NAME --role observer`, and give the folder that it makes"
        raise OverviewError(f"--identity or --insecure: give one of them; for a certificate, {make}")
    return Place(swarm, tuple(connect), identity, mission)


@dataclass(slots=True)
class _Drone:
    status: Status | None = None
    estimate: Estimate | None = None
    heard_s: float = -math.inf


class Overview:
    """The newest status and source estimate of each drone, for a table on the terminal.

    ``clock_s``: monotonic clock; ``verifier``: checks the statuses' signatures, None in a swarm without certificates.
    """

    def __init__(self, mission: MissionConfig | None, clock_s: Callable[[], float], verifier: Verifier | None = None) -> None:
        self._clock_s, self._verifier = clock_s, verifier
        self._datum = mission.datum if mission is not None else None
        self._drones: dict[str, _Drone] = {drone.id: _Drone() for drone in mission.drones} if mission is not None else {}

    @property
    def heard(self) -> bool:
        """Whether a message of any drone has arrived."""
        return any(drone.heard_s > 0.0 for drone in self._drones.values())

    def receive(self, key: str, payload: bytes, vouched: bool = True) -> None:
        """Take a message from the radio network; invalid messages are dropped.

        ``vouched``: the session prevents publications under foreign names; otherwise only statuses, which are signed, are taken.
        """
        try:
            message = decode_from(key, payload)
        except ProtocolError:
            return
        if not isinstance(message, DroneMessage):
            return
        if not (self._counts(message) if isinstance(message, Status) else vouched):
            return
        drone = self._drones.setdefault(message.drone, _Drone())
        drone.heard_s = self._clock_s()
        if isinstance(message, Status):
            drone.status = legible(self._known(message))
        elif isinstance(message, Estimate):
            drone.estimate = message

    @property
    def signers(self) -> frozenset[str]:
        """The names of the drones whose statuses have arrived."""
        return frozenset(name for name, drone in self._drones.items() if drone.status is not None)

    def _counts(self, status: Status) -> bool:
        """Whether a status is signed by its drone, and is no replay."""
        if self._verifier is not None and not self._verifier.accepts_status(status):
            return False
        known = self._drones.get(status.drone)
        if known is None or known.status is None or status.stamp_ns > known.status.stamp_ns:
            return True
        return self._clock_s() - known.heard_s > STALE_S  # after a pause: the drone's clock may have stepped backward

    def _known(self, status: Status) -> Status:
        """A valid status, without fields that its drone has not signed."""
        signed = self._verifier is None or self._verifier.accepts_obeyed(status)
        return status if signed else replace(status, obeyed=UNSET)

    def rows(self) -> list[tuple[str, ...]]:
        """Return a row of the table for each drone: name, stage, battery, seconds since it was heard, log, last order,
        problems.
        """
        return [self._row(name, self._drones[name]) for name in sorted(self._drones)]

    def sources(self) -> list[str]:
        """Return a line for each different source estimate: the drones that have it, and its sources."""
        told: dict[str, list[str]] = {}
        for name in sorted(self._drones):
            estimate, age_s = self._drones[name].estimate, self._clock_s() - self._drones[name].heard_s
            if estimate is not None and estimate.sources and age_s < STALE_S:
                told.setdefault("; ".join(map(self._source, estimate.sources)), []).append(name)
        findings = {drone.status.finding for drone in self._drones.values() if drone.status is not None} - {""}
        return [f"{', '.join(names)}: {text}" for text, names in told.items()] or sorted(findings) or ["no source found yet"]

    def _row(self, name: str, drone: _Drone) -> tuple[str, ...]:
        status, age_s = drone.status, self._clock_s() - drone.heard_s
        if status is None:
            return name, "not heard", "", "", "", "", ""
        battery = "" if status.battery is None else f"{status.battery:.0%}"
        log = drone.estimate.digest[:8] if drone.estimate is not None else ""
        heard = f"{age_s:.1f} s" if age_s < STALE_S else f"NOT HEARD for {age_s:.0f} s"
        ordered = "" if status.obeyed is UNSET else f"{status.obeyed.order} by {status.obeyed.station}"
        return name, str(status.stage), battery, heard, log, ordered, "; ".join((*status.problems, *status.notices))

    def _source(self, source: Source) -> str:
        x, y, z = source.position_m
        sigma_m = math.sqrt(max(0.0, source.covariance_m2[0] + source.covariance_m2[3]))
        parts = [f"source at ({x:.2f}, {y:.2f}) m, 1 sigma {sigma_m:.2f} m"]
        if self._datum is not None:
            latitude_deg, longitude_deg, _ = geodetic_from_mission(self._datum, (x, y, z))
            parts.append(f"{latitude_deg:.7f}, {longitude_deg:.7f} (WGS84)")
        if source.activity_bq is not None:
            parts.append(f"{source.nuclide or 'activity'} {source.activity_bq:.3g} Bq")
        if source.lines_kev is not UNSET:
            parts.append(f"nuclide {unknown_nuclide(source.lines_kev)}")
        return ", ".join(parts)


async def show(place: Place, watch: Callable[[Overview], None] | None) -> Overview:
    """Listen to a swarm for some seconds, and return what its drones report.

    With ``watch``, listen until cancelled; ``watch`` is then called twice a second.

    Raises:
        OverviewError: no drone is heard.
        ProtocolError: an endpoint or certificate that cannot be used.
        ConfigError: a mission file that cannot be used.
    """
    mission = load_mission(place.mission) if place.mission is not None else None
    identity = load_identity(place.identity) if place.identity is not None else None
    overview = Overview(mission, time.monotonic, Verifier(identity.authority) if identity is not None else None)
    drones = tuple(drone.id for drone in mission.drones) if mission is not None else None
    links = MeshConfig(connect=place.connect, identity=identity, drones=drones)
    receive = partial(overview.receive, vouched=identity is None or mission is not None)
    async with AsyncExitStack() as stack:
        mesh = await Mesh.open(links, place.swarm, None, receive=receive)
        stack.push_async_callback(mesh.close)
        until_s, authors = time.monotonic() + LISTEN_S, frozenset(drones or ())
        news: Mesh | None = None  # of drones known by their statuses only
        while watch is not None or time.monotonic() < until_s:
            if watch is not None:
                watch(overview)
            await asyncio.sleep(REFRESH_S)
            if identity is not None and drones is None and authors != overview.signers:
                authors, until_s = overview.signers, time.monotonic() + LISTEN_S
                links = replace(links, drones=tuple(sorted(authors)))
                if news is None:
                    news = await Mesh.open(links, place.swarm, None, receive=overview.receive)
                    stack.push_async_callback(news.close)
                else:
                    await news.reopen(links)
        if not overview.heard:
            refused = (await refusals(identity, place.connect, time.time_ns())).values()
            where = "; ".join((", ".join(place.connect), *refused))
            raise OverviewError(f"nothing heard from any drone of the swarm {place.swarm!r} at {where}")
        return overview


def table(overview: Overview) -> RenderableType:
    """Return the drones as a table for the terminal, with the sources below it."""
    from rich.console import Group  # noqa: PLC0415
    from rich.markup import escape  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    drones = Table("drone", "stage", "battery", "heard", "log", "last order", "problems", box=None, pad_edge=False)
    for row in overview.rows():
        drones.add_row(*map(escape, row))
    return Group(drones, *map(escape, overview.sources()))
