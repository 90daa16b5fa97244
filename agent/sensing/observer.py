"""From one drone's detections and own poses to its log entries: cones and exposures in its local frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from math import ceil

from msgspec import UNSET
from scipy.spatial.transform import Rotation

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.detector.detection import ConeEvent, Detections
from radron.agent.detector.spectrum import CoarseSpectrum
from radron.agent.geometry import Quaternion, Vector3, turned
from radron.agent.localization.history import PoseHistory
from radron.agent.owntime import Utc
from radron.agent.sensing.overground import OverGround
from radron.agent.terrain.ground import Ground
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.entries import (
    MAX_LOGGED_EXPOSURE_NS,
    CarriedFrame,
    Cone,
    ConeOrder,
    Counts,
    Coverage,
    Entry,
    Exposure,
    PoseSample,
    Retraction,
)
from radron.protocol.texts import CodedText

EXPOSURE_NS = 500_000_000
SAMPLE_NS = 100_000_000  # poses of an exposure: 10 Hz
MOST_POSES = 16  # of an exposure, or fewer a second: 70 bytes each of the 2 kB of an entry
# Live time without any hit. The background makes 1.5 hits a second. A healthy camera is then mute once in 600 hours, and silent
# once in 1200 even at half that background. (Gaps of length T at rate r begin r exp(-r T) times a second.)
MUTE_S = 10.0  # counts carry no information on the source any more: zeros more likely mean a dead camera
SILENT_S = 20.0  # reported to the operator
COUNTER_FACTOR = 10.0  # both times of a counting tube, whose background makes 0.3 counts a second: it is then mute once a year
# Cones published of a stretch, for each second of it. A landed drone half a metre from 10 GBq measures 10,000; more directions
# from one place carry no new information. In flight there are about 30 a second. The exposure counts them all.
MOST_CONES_PS = 100
# A pose is held for this long before the first telemetry and after the last: telemetry comes every 20 to 50 ms.
HELD_NS = 100_000_000
MOST_WAITING = 8  # stretches, 1.6 s: telemetry may come this late
LATE_NS = 3_000_000_000  # a camera's readouts may come this late; time not covered by then was not observed
GONE_NS = 10_000_000_000  # after this time without data the camera is not waited for


class Observer:
    """Turns the detections of one drone's camera, in own time, into log entries in UTC, with the poses that the drone had: cones,
    and exposures (counts).

    The entries have consecutive sequence numbers, and positions in the drone's local frame.
    """

    def __init__(
        self,
        drone: DroneConfig,
        mission: MissionConfig,
        boot: str,
        history: PoseHistory,
        numbers: Iterator[int],
        carried: Callable[[int], CarriedFrame | None],
        utc: Utc,
    ) -> None:
        """Set up the observer of one drone.

        ``history``: the drone's own poses; ``numbers``: sequence numbers of this run's entries; ``carried``: see ``OwnPose``.
        """
        self._utc = utc
        self._drone = drone.id
        self._mission = mission.mission_id
        self._boot = boot
        self._history, self._numbers, self._carried = history, numbers, carried
        self._over_ground = OverGround(mission.member(drone.id), Ground.from_config(mission), carried)
        x, y, z, w = Rotation.from_euler("xyz", drone.camera_rpy_deg, degrees=True).as_quat().tolist()
        self._body_from_camera: Quaternion = (w, x, y, z)
        self._waiting: deque[Detections] = deque()  # for the telemetry of their time
        self.dropped = self.withheld = 0
        kind = mission.member(drone.id).detector
        self._subject = "camera" if kind == "minipix" else "detector"
        self._patience = COUNTER_FACTOR if kind == "counts" else 1.0  # times MUTE_S and SILENT_S
        self._silent_s = 0.0  # live time since the last hit
        self._start_ns: int | None = None
        self._epoch = 0
        self._end_ns = 0
        self._logged_ns = 0  # end of the exposures logged, UTC: none overlaps another, also after a clock step backward
        self._unused_ns = 0  # end of the last stretch if it was not used: nothing else will come of that time
        self._heard_ns: int | None = None  # end of the last stretch; before the first, since when it is waited for
        self._elsewhere_ns = 0  # until then this drone may have been elsewhere
        self._live_s = 0.0
        self._hits = self._photopeak = self._coincidences = 0
        self._spectrum = CoarseSpectrum()
        self._bins: tuple[int, ...] | None = None

    def coverage(self, stamp_ns: int, epoch: int, path_m: tuple[tuple[float, float], ...], swath_m: float) -> Coverage:
        """Return the log entry of a searched path (m, horizontal), in the local frame of the epoch (period without a jump).

        swath_m: width that is covered along the path.
        """
        return Coverage(
            stamp_ns=self._utc.of(stamp_ns),
            drone=self._drone,
            mission=self._mission,
            boot=self._boot,
            sequence=next(self._numbers),
            epoch=epoch,
            path_m=path_m,
            swath_m=swath_m,
        )

    def taken_back(self, stamp_ns: int, first: int, last: int) -> Retraction:
        """Return the log entry that takes back the entries with these numbers, whose stamps are of a wrong clock.

        Later measurements at these stamps are used.
        """
        self._logged_ns = 0
        return self.retraction(stamp_ns, first, last)

    def drop_until(self, until_ns: int) -> None:
        """Drop measurements until a time (ns) that are not logged yet, because this drone may have been at another place."""
        self._empty()
        self._elsewhere_ns = until_ns

    def retraction(self, stamp_ns: int, first: int, last: int) -> Retraction:
        """Return the log entry that takes back the measurements with the numbers ``first`` to ``last``."""
        return Retraction(
            stamp_ns=self._utc.of(stamp_ns),
            drone=self._drone,
            mission=self._mission,
            boot=self._boot,
            sequence=next(self._numbers),
            first=first,
            last=last,
        )

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Problems of the camera: a line if it has not seen a hit for long, else empty."""
        if self._silent_s < self._patience * SILENT_S:
            return ()
        text = (
            f"{self._subject}: no hit for {self._patience * SILENT_S:g} s or more, not even background; its counts are not used"
        )
        return (CodedText(Code.CAMERA_BLIND, text),)

    def observe(self, detections: Detections) -> list[Entry]:
        """Return the log entries of a time interval of detections, and of earlier intervals that have waited for their telemetry.

        Counts are held until an exposure is full. The zeros of a mute camera are not used (see ``unseen``): these are no evidence
        against a source. Some intervals are dropped, and counted in ``dropped``: longer than the longest exposure, without a
        known (telemetry missing) or trusted pose, or overlapping earlier ones, in own time or in UTC (a backward clock step).
        Measurements at a wrong place would mislead the whole swarm. Of more cones than ``MOST_CONES_PS`` the first ones are
        taken, whatever their direction, and the others counted in ``withheld``.
        """
        start_ns, end_ns = detections.start_ns, detections.end_ns
        self._heard_ns, self._unused_ns = end_ns, 0
        self._silent_s = 0.0 if detections.hits else self._silent_s + detections.live_time_s
        if self._silent_s >= self._patience * MUTE_S:
            self._live_s = 0.0  # the counts held so far carry no information either
            self._waiting.clear()
            return self._unused(end_ns)
        if not start_ns <= end_ns <= start_ns + MAX_LOGGED_EXPOSURE_NS:
            self.dropped += 1
            return []
        self._waiting.append(detections)
        entries: list[Entry] = []
        while self._waiting and (len(self._waiting) > MOST_WAITING or not self._awaits_telemetry(self._waiting[0].end_ns)):
            entries += self._take(self._waiting.popleft())
        return entries

    def _awaits_telemetry(self, end_ns: int) -> bool:
        span_ns = self._history.span_ns
        return span_ns is not None and end_ns > span_ns[1] + HELD_NS

    def _unused(self, end_ns: int) -> list[Entry]:
        """Return the entries held until a stretch that is not used."""
        self._unused_ns = end_ns
        return self._exposure() if self._start_ns is not None else []

    def _take(self, detections: Detections) -> list[Entry]:
        start_ns, end_ns = detections.start_ns, detections.end_ns
        state = self._history.at(start_ns)
        if state is None or not self._is_placed(state, start_ns, end_ns):
            self.dropped += 1
            return self._unused(end_ns)
        if start_ns < self._end_ns or self._utc.of(start_ns) < self._logged_ns:
            self.dropped += 1
            return []
        most = ceil((end_ns - start_ns) * 1e-9 * MOST_CONES_PS)
        self.withheld += max(0, len(detections.cones) - most)
        entries: list[Entry] = [self._cone(event) for event in detections.cones[:most]]
        if self._start_ns is not None and (
            start_ns > self._end_ns or state.epoch != self._epoch or end_ns > self._start_ns + MAX_LOGGED_EXPOSURE_NS
        ):
            entries += self._exposure()
        if self._start_ns is None:
            self._start_ns, self._epoch = start_ns, state.epoch
        self._end_ns = end_ns
        self._live_s += detections.live_time_s
        self._hits += detections.hits
        self._photopeak += detections.photopeak
        self._coincidences += detections.coincidences
        self._spectrum.add_bins(detections.spectrum)
        if detections.bins is not None:
            held = self._bins or (0,) * len(detections.bins)
            self._bins = tuple(one + other for one, other in zip(held, detections.bins, strict=True))
        if self._end_ns - self._start_ns >= EXPOSURE_NS:
            entries += self._exposure()
        return entries

    def _is_placed(self, state: VehicleState, start_ns: int, end_ns: int) -> bool:
        """Whether the position of this drone between two stamps is known; ``state``: the telemetry at the first."""
        span_ns = self._history.span_ns
        if span_ns is None or not state.position_trusted or start_ns < self._elsewhere_ns:
            return False
        return span_ns[0] - HELD_NS <= start_ns and end_ns <= span_ns[1] + HELD_NS

    def unseen(self, now_ns: int) -> list[Entry]:
        """Return log entries with poses for times without usable data of the camera: exposures without live time.

        These carry no information on the source, but without them the drone's frame could not be estimated, or published after a
        jump, any more. The wait for a readout is as short as possible. After late poses every drone estimates all frames since
        then again, and with them the source.
        """
        entries: list[Entry] = []
        span_ns = self._history.span_ns
        if span_ns is None:
            return entries
        self._heard_ns = now_ns if self._heard_ns is None else self._heard_ns
        wait_ns = LATE_NS if now_ns - self._heard_ns < GONE_NS else 0
        until_ns = min(max(now_ns - wait_ns, self._unused_ns), span_ns[1])
        while until_ns - max(self._end_ns, span_ns[0]) >= EXPOSURE_NS:
            if self._start_ns is not None:
                entries += self._exposure()  # the counts held so far
                continue
            self._start_ns = max(self._end_ns, span_ns[0])
            self._end_ns = self._start_ns + EXPOSURE_NS
            entries += self._exposure()
        return entries

    def _cone(self, event: ConeEvent) -> Cone:
        state = self._history.at(event.stamp_ns)
        pose = self._history.pose(event.stamp_ns)
        assert state is not None  # observe() checked it
        assert pose is not None
        position, local_from_body = pose
        first, second = (turned(local_from_body, turned(self._body_from_camera, axis)) for axis in event.axis.tolist())
        return Cone(
            stamp_ns=self._utc.of(event.stamp_ns),
            drone=self._drone,
            mission=self._mission,
            boot=self._boot,
            sequence=next(self._numbers),
            epoch=state.epoch,
            apex_m=self._over_ground.placed(position, state),
            apex_sigma_m=state.stamped_sigma_m,
            yaw_sigma_rad=state.yaw_sigma_rad,
            clock_sigma_m=state.clock_sigma_m,
            orders=(_order(event, first, 0), _order(event, second, 1)),
            energies_kev=event.energies_kev,
            energy_sigmas_kev=event.energy_sigmas_kev,
            separation_mm=event.separation_mm,
        )

    def _empty(self) -> None:
        """Hold no counts."""
        self._start_ns, self._live_s = None, 0.0
        self._hits = self._photopeak = self._coincidences = 0
        self._spectrum, self._bins = CoarseSpectrum(), None

    def _exposure(self) -> list[Entry]:
        start_ns, live_s, spectrum = self._start_ns, self._live_s, self._spectrum.bins()
        counts, bins = Counts(self._hits, self._photopeak, self._coincidences), self._bins
        self._empty()
        assert start_ns is not None
        state = self._history.at(start_ns)
        if state is None or not self._history.keeps(start_ns + HELD_NS) or self._utc.of(start_ns) < self._logged_ns:
            self.dropped += 1
            return []
        self._logged_ns = self._utc.of(self._end_ns)
        poses = []
        duration_ns = max(1, self._end_ns - start_ns)
        for offset_ns in range(0, duration_ns, max(SAMPLE_NS, -(-duration_ns // MOST_POSES))):
            pose, then = self._history.pose(start_ns + offset_ns), self._history.at(start_ns + offset_ns)
            assert pose is not None
            assert then is not None
            if then.epoch != state.epoch:  # poses of another frame do not belong to this one
                break
            position, quaternion = pose
            poses.append(PoseSample(offset_ns, self._over_ground.placed(position, then), quaternion))
        return [
            Exposure(
                stamp_ns=self._utc.of(start_ns),
                drone=self._drone,
                mission=self._mission,
                boot=self._boot,
                sequence=next(self._numbers),
                epoch=state.epoch,
                end_ns=self._utc.of(self._end_ns),
                live_time_s=min(live_s, (self._end_ns - start_ns) * 1e-9),
                counts=counts,
                poses=tuple(poses),
                position_sigma_m=state.stamped_sigma_m,
                yaw_sigma_rad=state.yaw_sigma_rad,
                clock_sigma_m=state.clock_sigma_m,
                spectrum=spectrum,
                carried=self._carried(state.epoch),
                bins=UNSET if bins is None else bins,
            )
        ]


def _order(event: ConeEvent, axis: Vector3, row: int) -> ConeOrder:
    return ConeOrder(
        axis=axis,
        theta_rad=float(event.theta_rad[row]),
        sigma_rad=float(event.sigma_rad[row]),
        probability=float(event.probability[row]),
    )
