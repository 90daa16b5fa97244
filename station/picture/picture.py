"""The station's knowledge of the swarm: messages of the network go in, states for the web page come out."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Collection
from math import dist
from statistics import median

import numpy as np
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.config.beyond import bearing_beyond
from radron.agent.config.mission import MissionConfig
from radron.agent.frames.geodesy import geodetic_from_mission
from radron.agent.fusion.estimator import Hypothesis, Outlook
from radron.agent.fusion.observation import ConeObservation, observe
from radron.agent.fusion.registry import Estimators, estimator_named
from radron.agent.terrain.ground import Ground
from radron.protocol.codec import decode_from
from radron.protocol.entries import Cone, Entry, Exposure
from radron.protocol.errors import ProtocolError
from radron.protocol.messages import AnyDroneMessage, Order, Status
from radron.protocol.revocations import Revocation, Revoked
from radron.protocol.signing import Verifier
from radron.protocol.spectrum import EDGES_KEV, unknown_nuclide
from radron.protocol.texts import CodedText
from radron.station.picture.curves import ground_curves
from radron.station.picture.dose import rate_usvph
from radron.station.picture.events import Events, told
from radron.station.picture.frame import (
    ConeCurve,
    DroneFrame,
    Event,
    Frame,
    MissionFrame,
    Point,
    Raster,
    SearchFrame,
    SourceFrame,
    Spectra,
)
from radron.station.picture.member import Member
from radron.station.picture.numbering import Numbering
from radron.station.picture.orders import Orders
from radron.station.picture.rasters import Rasters
from radron.station.picture.swarmlog import SwarmLog

NINETY = math.sqrt(4.605170185988092)  # radius of the region of 90 %, in sigmas: the 0.9 quantile of chi squared with 2 degrees
MAX_CURVES = 200  # waiting for the page
_CLOCKS_NS = 1_000_000_000


class Picture:
    """The station's knowledge of the swarm, from all messages that it has received.

    The station computes the source estimate itself, from the same log and with the same code as the drones; the drones' own
    estimates only show whether they agree. ``log``: the log with the estimate. ``orders``: orders of all operators. ``counters``:
    numbers of dropped messages, by reason. ``link_problems``: problems of the station's own link.
    """

    def __init__(
        self,
        mission: MissionConfig,
        verifier: Verifier | None,
        estimators: Estimators = estimator_named,
        *,
        judges_exposures: bool = True,
    ) -> None:
        """``verifier``: checks the signatures in the log; None: in a swarm without certificates. ``estimators``: makes the
        estimators by name. ``judges_exposures``: whether overlapping exposures are ignored (see ``ObservationLog``).
        """
        self.mission = mission
        self._mission_id = mission.mission_id
        self.log = SwarmLog(mission, verifier, estimators, judges_exposures=judges_exposures)
        self.orders = Orders(verifier)
        self.members = {drone.id: Member(drone.id, drone.localization) for drone in mission.drones}
        self.counters: Counter[str] = Counter()
        self.on_entry: list[Callable[[Entry], None]] = []  # called with each entry that comes into the log
        self.link_problems: tuple[CodedText, ...] = ()
        self._verifier, self._estimators = verifier, estimators
        self._ground = Ground.from_config(mission)
        self._rasters = Rasters(mission)
        self._events = Events(list(self.members))
        self._numbering = Numbering()
        self._cones: deque[Cone] = deque(maxlen=MAX_CURVES)
        self._digests: deque[str] = deque(maxlen=64)  # the log's newest digests
        self._clocks_s: dict[str, float | None] = {}  # clock offsets, by drone: positive if ahead of the others
        self._clocks_ns = 0  # time of the offsets

    def about(self, replay: bool) -> MissionFrame:
        """Return everything about the mission that the web page shows and that does not change in flight.

        ``replay``: a flight record is shown, and not a live flight.
        """
        mission, datum = self.mission, self.mission.datum
        area = Polygon(mission.area.polygon_m)
        fence = area.buffer(mission.area.fence_margin_m)
        return MissionFrame(
            id=self._mission_id,
            name=mission.name,
            swarm=mission.swarm,
            nuclide=mission.nuclide_text,
            drones=tuple(self.members),
            area=corners(area),
            fence=corners(fence),
            datum_deg=(datum.latitude_deg, datum.longitude_deg) if datum is not None else None,
            replay=replay,
            encrypted=self._verifier is not None,
            energies_kev=tuple(round(edge, 1) for edge in EDGES_KEV),
        )

    def of(self, mission: MissionConfig) -> Picture:
        """Return an empty picture of this swarm for another mission; only the orders are kept."""
        picture = Picture(mission, self._verifier, self._estimators)
        picture.orders = self.orders
        return picture

    def receive(self, key: str, payload: bytes, now_ns: int) -> None:
        """Process a message from the network. An invalid message is counted and dropped.

        ``now_ns``: time of arrival, nanoseconds UTC.
        """
        try:
            message = decode_from(key, payload)
        except ProtocolError:
            self.counters["rejected_malformed"] += 1
            return
        if isinstance(message, Revocation | Revoked):
            by = message.drone if isinstance(message, Revoked) else None
            for one in message.held if isinstance(message, Revoked) else (message,):
                self.log.revoke(one, now_ns, by)
            return
        if isinstance(message, Order):
            self.orders.take(message, now_ns)
        if not isinstance(message, AnyDroneMessage):
            return
        member = self.members.get(message.drone)
        if member is None:
            self.counters["unknown_drone"] += 1
            return
        if isinstance(message, Entry):
            for entry in self.log.take(message, payload, now_ns):
                self._keep(entry)
            return
        if message.drone in self.log.revoked:
            self.counters["revoked"] += 1
            return
        if isinstance(message, Status):
            self._take_status(message, member, now_ns)
        else:
            member.hear(message, now_ns)

    def _take_status(self, status: Status, member: Member, now_ns: int) -> None:
        """Take a status if its drone has signed it."""
        if not self.log.is_signed(status, now_ns):
            self.counters["forged"] += 1
            return
        member.hear(status, now_ns)
        self.orders.hear(status, now_ns)
        if status.mission == self._mission_id and status.started_ns is not None:
            self.log.start(status.started_ns)

    def appear(self, alive: Collection[str]) -> None:
        """Set which drones are connected to the network."""
        for name, member in self.members.items():
            member.alive = name in alive

    def advance(self, now_ns: int) -> None:
        """Process log entries that have been received, and update the source estimate."""
        self.log.advance(now_ns)
        if not self._digests or self._digests[-1] != self.log.fusion.digest:
            self._digests.append(self.log.fusion.digest)

    def frame(self, now_ns: int) -> Frame:
        """Return the state of the swarm at this time (nanoseconds UTC), for the web page."""
        if abs(now_ns - self._clocks_ns) >= _CLOCKS_NS:  # statuses come once a second
            self._clocks_s, self._clocks_ns = {name: self._clock_s(member) for name, member in self.members.items()}, now_ns
        drones = tuple(self._drone(member, now_ns) for member in self.members.values())
        hypothesis, outlook = self.log.fusion.hypothesis, self.log.fusion.outlook
        found = (hypothesis, *hypothesis.others) if hypothesis is not None else ()
        sources = self._numbering.numbered([self._source(one) for one in found], now_ns // 1_000_000)
        warnings = *self.link_problems, *self.log.problems(now_ns)
        findings = {member.status.finding for member in self.members.values() if member.status is not None} - {""}
        return Frame(
            at_ms=now_ns // 1_000_000,
            drones=drones,
            source=sources[0] if sources else None,
            others=sources[1:],
            search=_search(outlook) if outlook is not None else None,
            finding=min(findings, default=""),
            digest=self.log.fusion.digest,
            entries=len(self.log.fusion.log),
            warnings=tuple(map(str, warnings)),
            warning_codes=tuple(text.code for text in warnings),
            revoked=tuple(sorted(self.log.revoked)),
        )

    def events(self, frame: Frame) -> list[Event]:
        """Return the events for the timeline since the last call: orders and changes of the swarm's state."""
        return [*(told(order, frame.at_ms) for order in self.orders.news(frame.at_ms * 1_000_000)), *self._events.since(frame)]

    def cones(self) -> list[ConeCurve]:
        """Return the Compton cones that are new since the last call, as curves on the ground.

        A cone of a drone whose local frame is not known in the mission frame is left out.
        """
        found, waiting = [], list(self._cones)
        self._cones.clear()
        for cone in waiting:
            transform = self.log.mission_from_local(cone.drone, cone.epoch, cone.stamp_ns)
            observation = observe(cone, transform) if transform is not None else None
            if isinstance(observation, ConeObservation):
                curves = ground_curves(observation, self._ground)
                found.append(ConeCurve(at_ms=cone.stamp_ns // 1_000_000, drone=cone.drone, curves=curves))
        return found

    def rasters(self, now_ns: int) -> list[Raster]:
        """Return the raster layers of the map: probability density of the source, and expected dose rate."""
        posterior = self.log.posterior(now_ns)
        if posterior is None:
            return []
        fusion, at_ms = self.log.fusion, now_ns // 1_000_000
        dose = self._rasters.dose(posterior, fusion.hypothesis, fusion.outlook, at_ms)
        return [self._rasters.belief(posterior, at_ms), *([dose] if dose is not None else [])]

    def spectra(self, now_ns: int) -> Spectra:
        """Return the gamma spectra of all cameras over the last seconds."""
        found = (member.spectrum(now_ns) for member in self.members.values())
        return Spectra(at_ms=now_ns // 1_000_000, drones=tuple(one for one in found if one is not None))

    def _keep(self, entry: Entry) -> None:
        for listen in self.on_entry:
            listen(entry)
        if isinstance(entry, Cone):
            self._cones.append(entry)
        elif isinstance(entry, Exposure):
            self.members[entry.drone].expose(entry)

    def _drone(self, member: Member, now_ns: int) -> DroneFrame:
        pose = member.pose
        transform = None
        if pose is not None:
            transform = member.transform(pose.epoch, self.log.mission_from_local(member.drone, pose.epoch))
        other = member.status.mission if member.status is not None else self._mission_id
        shown = replace(
            member.shown(now_ns, transform),
            clock_s=self._clocks_s.get(member.drone),
            other_mission=other if other != self._mission_id else "",
        )
        estimate, hypothesis = member.recent_estimate(now_ns), self.log.fusion.hypothesis
        if estimate is None or hypothesis is None or not estimate.sources:
            return shown
        same = estimate.digest in self._digests
        return replace(shown, same_log=same, apart_m=round(dist(estimate.sources[0].position_m, hypothesis.position.tolist()), 3))

    def _clock_s(self, member: Member) -> float | None:
        """Return a drone's clock offset (s, positive if ahead), by the drones' reports of each other's delays; None: unknown."""
        status = member.status
        if status is None:
            return None
        ahead = [
            0.5e-9 * (other.status.delays_ns[member.drone] - delay_ns)
            for name, delay_ns in status.delays_ns.items()
            if (other := self.members.get(name)) is not None
            and other.status is not None
            and member.drone in other.status.delays_ns
        ]
        return round(-median(ahead), 4) if ahead else None

    def _source(self, hypothesis: Hypothesis) -> SourceFrame:
        variances, axes = np.linalg.eigh(hypothesis.covariance[:2, :2])
        short_m, long_m = (NINETY * math.sqrt(max(0.0, variance)) for variance in variances.tolist())
        x, y, z = hypothesis.position.tolist()
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = hypothesis.covariance.tolist()
        nuclide, activity, datum = self._nuclide(hypothesis), hypothesis.activity_bq, self.mission.datum
        latitude_deg, longitude_deg, _ = geodetic_from_mission(datum, (x, y, z)) if datum is not None else (0.0, 0.0, 0.0)
        return SourceFrame(
            place=(x, y, z),
            covariance_m2=(xx, xy, xz, yy, yz, zz),
            rms_m=hypothesis.rms_m,
            region=(long_m, short_m, math.atan2(axes[1, 1], axes[0, 1])),
            velocity_mps=(float(hypothesis.velocity[0]), float(hypothesis.velocity[1])),
            cones=hypothesis.cones,
            nuclide=nuclide,
            activity_bq=activity,
            activity_sigma_bq=hypothesis.activity_sigma_bq,
            dose_usvph=rate_usvph(nuclide, activity) if activity is not None else None,
            bearing_deg=bearing_beyond(self.mission.area, x, y),
            position_deg=(latitude_deg, longitude_deg) if datum is not None else None,
        )

    def _nuclide(self, hypothesis: Hypothesis) -> str:
        if hypothesis.lines_kev is not None:
            return unknown_nuclide(hypothesis.lines_kev)
        return hypothesis.nuclide or self.mission.nuclide_text


def _search(outlook: Outlook) -> SearchFrame:
    found, exclusion = SearchFrame(none=outlook.none, excluded_bq=outlook.excluded_bq), outlook.exclusion
    if exclusion is None:
        return found
    left, glare = float(exclusion.left.mean()), float(exclusion.glare.mean())
    return replace(found, nuclides_bq=exclusion.known_bq, left=left, glare=glare)


def corners(polygon: Polygon) -> tuple[Point, ...]:
    """Return the corners of a polygon's outline, rounded to the centimetre; the first corner is repeated at the end."""
    return tuple((round(x, 2), round(y, 2)) for x, y in polygon.exterior.coords)
