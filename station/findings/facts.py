"""The facts of all files of a report: the findings, the searched area, the commands and their signers."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import TypeVar

from shapely import LineString, Polygon, union_all

from agent.config.mission import DatumConfig, MissionConfig
from agent.errors import RadronError
from agent.flight.audit import Audited, audit, in_words, told
from agent.flight.reader import RecordedFlight
from agent.frames.geodesy import geodetic_from_mission
from agent.fusion.observation import ConeObservation, observe
from protocol.entries import Cone, Coverage, Exposure
from station.hub import Hub
from station.picture.frame import Frame, SearchFrame, SourceFrame
from station.picture.orders import Heard, Orders
from station.picture.picture import Picture
from station.replay import Records, play

BY_DRONES = "the drones that obeyed name who signed it"
UNHEARD = "this station has not heard that it was obeyed"
T = TypeVar("T")
_SLICE_S = 0.02  # of work, before pages are served


class FindingsError(RadronError):
    """A report that cannot be made."""


@dataclass(frozen=True, slots=True)
class Located:
    """An estimate and its time. ``source``: the first source; ``others``: the further sources."""

    at_ms: int
    source: SourceFrame
    others: tuple[SourceFrame, ...] = ()

    @property
    def sources(self) -> tuple[SourceFrame, ...]:
        """All sources, in the estimate's order."""
        return (self.source, *self.others)


@dataclass(frozen=True, slots=True)
class Source:
    """The source of the facts. ``versions``: of the software. ``commands``: each with an addressed drone, from its record; with
    ``heard``: as received by a station. ``flaws``: missing parts of the records.
    """

    versions: dict[str, str]
    commands: tuple[tuple[str, Audited], ...] = ()
    heard: bool = False
    flaws: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Findings:
    """The facts of one mission.

    ``last``: the estimate at the end of the records; ``best``: among estimates with as many sources, the estimate with the
    smallest RMS of the first source; None without a finding.
    ``surveyed``: share of the area covered in lanes, by the swarm's log; None without lanes.
    ``search``: for further sources, at the end; None for an estimator of one source. ``frames``: a second apart.
    ``recognised``: the nuclide by the drones' spectra, and its evidence (log likelihood ratio).
    """

    mission: MissionConfig
    drones: tuple[str, ...]
    frames: tuple[Frame, ...]
    best: Located | None
    last: Located | None
    excluded_bq: float | None
    finding: str
    recognised: tuple[str, float] | None
    cones: tuple[ConeObservation, ...]
    exposures: tuple[Exposure, ...]
    places: tuple[tuple[float, float, float] | None, ...]  # of the camera at the middle of each exposure, mission frame
    digest: str
    entries: int
    source: Source
    surveyed: float | None = None
    search: SearchFrame | None = None

    def on_earth(self, place: Sequence[float]) -> tuple[float, float, float]:
        """Return latitude and longitude (degrees) and height above the ellipsoid (m) of a place in the mission frame.

        Raises:
            FindingsError: the mission has no datum.
        """
        return geodetic_from_mission(self.datum, (place[0], place[1], place[2] if len(place) > 2 else 0.0))

    @property
    def datum(self) -> DatumConfig:
        """Origin of the mission frame on Earth; raises FindingsError for a mission without a datum."""
        if self.mission.datum is None:
            raise FindingsError("the mission has no [datum], so its places are not known on Earth")
        return self.mission.datum


def gather(paths: Sequence[Path], progress: Callable[[float], None]) -> Findings:
    """Read the records of one mission.

    Raises:
        FlightRecordError: records are unreadable, or of several missions.
    """
    records = Records(paths)
    picture = Picture(records.mission, records.verifier, judges_exposures=records.judges_exposures)
    hub = Hub(picture, replay=True, progress=progress)

    async def played() -> Findings:
        await play(hub, records)
        return await facts_of(hub, of_records(paths, records))

    return asyncio.run(played())


def of_records(paths: Sequence[Path], records: Records) -> Source:
    """Return versions, commands and flaws from the records themselves."""
    flights = [RecordedFlight(path, whole=False) for path in paths]
    commands = ((flight.header.drone.id, each) for flight in flights for each in audit(flight))
    return Source(
        versions=dict(flights[0].header.versions),
        commands=tuple(sorted(commands, key=lambda each: each[1].first_ns)),
        flaws=records.flaws,
    )


def of_station(versions: dict[str, str], orders: Orders) -> Source:
    """Return versions and commands as received by a station during a live flight."""
    commands = ((drone, _audited(order, drone)) for order in orders.heard for drone in sorted(order.numbers))
    return Source(versions, tuple(sorted(commands, key=lambda each: each[1].first_ns)), heard=True)


def _audited(order: Heard, drone: str) -> Audited:
    unknown = BY_DRONES if order.told else "certificate is none of this swarm's" if order.refused else "not known here"
    signer = order.signer or unknown
    result = f"refused: {in_words(order.refused, signer)}" if order.refused else order.results.get(drone, UNHEARD)
    names = tuple(sorted(order.numbers))
    copies = max(1, order.copies)
    return Audited(order.first_ns, order.last_ns, order.station, told(signer), order.action, names, result, copies)


async def facts_of(hub: Hub, source: Source) -> Findings:
    """Return the present findings of a hub; pages are served meanwhile."""
    frames, picture = tuple(hub.history.frames()), hub.picture
    fusion = picture.log.fusion
    located = [Located(frame.at_ms, frame.source, frame.others) for frame in frames if frame.source is not None]
    complete = [each for each in located if len(each.others) == len(located[-1].others)]
    searched = [frame.search for frame in frames if frame.search is not None]
    searches = [each.excluded_bq for each in searched]
    exposures, cones, digest, entries = (
        tuple(fusion.log.entries(Exposure)),
        fusion.log.entries(Cone),
        fusion.digest,
        len(fusion.log),
    )
    return Findings(
        mission=picture.mission,
        drones=tuple(picture.members),
        frames=frames,
        best=min(complete, key=lambda each: each.source.rms_m, default=None),
        last=located[-1] if located else None,
        excluded_bq=next((excluded for excluded in reversed(searches) if excluded is not None), None),
        finding=next((frame.finding for frame in reversed(frames) if frame.finding), ""),
        recognised=_recognised(picture),
        cones=tuple([cone async for cone in _sliced(_cones(picture, tuple(cones)))]),
        exposures=exposures,
        places=tuple([place async for place in _sliced(_place(picture, exposure) for exposure in exposures)]),
        digest=digest,
        entries=entries,
        source=source,
        surveyed=_surveyed(picture),
        search=next((each for each in reversed(searched) if each.nuclides_bq is not None), None),
    )


async def _sliced(work: Iterable[T]) -> AsyncIterator[T]:
    """Yield the same, with a break for other tasks after each slice of work."""
    began_s = monotonic()
    for each in work:
        yield each
        if monotonic() - began_s > _SLICE_S:
            await asyncio.sleep(0.0)
            began_s = monotonic()


def _recognised(picture: Picture) -> tuple[str, float] | None:
    statuses = [member.status for member in picture.members.values() if member.status is not None]
    found = [(status.recognised.nuclide, status.recognised.evidence) for status in statuses if status.recognised is not None]
    return max(found, key=lambda each: each[1], default=None)


def _cones(picture: Picture, cones: Sequence[Cone]) -> Iterator[ConeObservation]:
    """Yield the cones with known frames, in the mission frame."""
    for cone in cones:
        transform = picture.log.mission_from_local(cone.drone, cone.epoch, cone.stamp_ns)
        observation = observe(cone, transform) if transform is not None else None
        if isinstance(observation, ConeObservation):
            yield observation


def _surveyed(picture: Picture) -> float | None:
    area, lanes = Polygon(picture.mission.area.polygon_m), []
    for entry in picture.log.fusion.log.entries(Coverage):
        transform = picture.log.mission_from_local(entry.drone, entry.epoch, entry.stamp_ns)
        if transform is not None:
            path = [(x, y) for x, y, _ in transform.apply_points([(x, y, 0.0) for x, y in entry.path_m])]
            lanes.append(LineString(path * 2 if len(path) == 1 else path).buffer(0.5 * picture.mission.survey.lane_spacing_m))
    return float(area.intersection(union_all(lanes)).area / area.area) if lanes else None


def _place(picture: Picture, exposure: Exposure) -> tuple[float, float, float] | None:
    transform = picture.log.mission_from_local(exposure.drone, exposure.epoch, exposure.stamp_ns)
    middle_ns = (exposure.end_ns - exposure.stamp_ns) // 2
    nearest = min(exposure.poses, key=lambda pose: abs(pose.offset_ns - middle_ns))
    return transform.apply_point(nearest.position_m) if transform is not None else None
