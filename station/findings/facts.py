"""All facts that a report on a mission needs: the estimates, the searched area, and the commands with their signers."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import TypeVar

from shapely import LineString, Polygon, union_all

from radron.agent.config.mission import DatumConfig, MissionConfig
from radron.agent.errors import RadronError
from radron.agent.flight.audit import Audited, audit, in_words, told
from radron.agent.flight.reader import RecordedFlight
from radron.agent.frames.geodesy import geodetic_from_mission
from radron.agent.fusion.observation import ConeObservation, observe
from radron.protocol.entries import Cone, Coverage, Exposure
from radron.station.hub import Hub
from radron.station.picture.frame import Frame, SearchFrame, SourceFrame
from radron.station.picture.orders import Heard, Orders
from radron.station.picture.picture import Picture
from radron.station.replay import SLICE_S, Records, play

BY_DRONES = "the drones that obeyed name who signed it"
UNHEARD = "this station has not heard that it was obeyed"
T = TypeVar("T")


class FindingsError(RadronError):
    """A report on a mission cannot be made."""


@dataclass(frozen=True, slots=True)
class Located:
    """An estimate of the radioactive sources at one time.

    ``at_ms``: milliseconds UTC. ``source``: the first source of the estimate; ``others``: further sources.
    """

    at_ms: int
    source: SourceFrame
    others: tuple[SourceFrame, ...] = ()

    @property
    def sources(self) -> tuple[SourceFrame, ...]:
        """All sources of the estimate, in its order."""
        return (self.source, *self.others)


@dataclass(frozen=True, slots=True)
class Source:
    """Where the facts of a report come from: flight records, or a station that has received a live flight.

    ``versions``: versions of the software. ``commands``: each command with the drone to which it was addressed. ``heard``: the
    commands were received by a station, and not read from the drones' records. ``flaws``: missing parts of the records.
    """

    versions: dict[str, str]
    commands: tuple[tuple[str, Audited], ...] = ()
    heard: bool = False
    flaws: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Findings:
    """All facts about one mission that go into its report.

    Attributes:
        mission: the mission.
        drones: ids of the drones.
        frames: states of the swarm, one for each second.
        best: of the estimates with as many sources as the last one, the estimate with the smallest RMS error of its first source;
            None if no source was found.
        last: the estimate at the end of the records; None if no source was found.
        excluded_bq: activity in becquerels above which a source in the area is excluded.
        finding: conclusion of the drones' search.
        recognised: the nuclide according to the drones' spectra, and its evidence (log likelihood ratio).
        cones: all Compton cones.
        exposures: all photon counts.
        places: position of the camera at the middle of each exposure, in the mission frame, metres.
        digest: hash of the log.
        entries: number of log entries.
        source: where the facts come from.
        surveyed: covered share of the area that was to be flown in parallel lanes, by the swarm's log; None without lanes.
        search: the search for further sources at the end; None for an estimator of a single source.
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
        """Convert a point of the mission frame to latitude and longitude (degrees) and height above the ellipsoid (metres).

        Raises:
            FindingsError: the mission has no datum (place on Earth).
        """
        return geodetic_from_mission(self.datum, (place[0], place[1], place[2] if len(place) > 2 else 0.0))

    @property
    def datum(self) -> DatumConfig:
        """Place on Earth of the mission frame's origin; raises FindingsError for a mission without a datum."""
        if self.mission.datum is None:
            raise FindingsError("the mission has no [datum], so its places are not known on Earth")
        return self.mission.datum


def gather(paths: Sequence[Path], progress: Callable[[float], None]) -> Findings:
    """Read the flight records of one mission, and return all facts for its report.

    ``progress``: called with the share read so far, from 0 to 1.

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
    """Return the versions of the software, the commands and the flaws from flight records."""
    flights = [RecordedFlight(path, whole=False) for path in paths]
    commands = ((flight.header.drone.id, each) for flight in flights for each in audit(flight))
    return Source(
        versions=dict(flights[0].header.versions),
        commands=tuple(sorted(commands, key=lambda each: each[1].first_ns)),
        flaws=records.flaws,
    )


def of_station(versions: dict[str, str], orders: Orders) -> Source:
    """Return the versions of the software and the commands that a station has received during a live flight."""
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
    """Return all facts for a report from the present state of a station, which continues to serve its web pages meanwhile."""
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
        if monotonic() - began_s > SLICE_S:
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
