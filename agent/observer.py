"""From one drone's detections and poses to its log entries: cones and exposures in its local frame."""

from __future__ import annotations

from itertools import count

from scipy.spatial.transform import Rotation

from agent.attitude import Quaternion, Vector3, turned
from agent.config import DroneConfig
from agent.detector.detection import ConeEvent, Detections
from agent.poses import HISTORY_NS, PoseHistory
from protocol.messages import Cone, ConeOrder, Counts, Coverage, Entry, Exposure, PoseSample

EXPOSURE_NS = 500_000_000
SAMPLE_NS = 100_000_000  # poses of an exposure: 10 Hz
# Live time without any hit. The background makes 1.5 a second; a healthy camera is then mute once in 600 hours, and silent for so
# long once in 1200 even where the background is half of that (a gap of T at the rate r begins r exp(-r T) times a second).
MUTE_S = 10.0  # says nothing of the source any more: its zeros are likelier those of a dead camera
SILENT_S = 20.0  # is told to the operator
LATE_NS = 3_000_000_000  # by which a camera's readouts may come late: what it has not told of by then it has not seen


class Observer:
    """Turns one detector's stretches into log entries with consecutive sequence numbers."""

    def __init__(self, drone: DroneConfig, mission_id: str, boot: str) -> None:
        self._drone = drone.id
        self._mission = mission_id
        self._boot = boot
        self.numbers = count(1)  # of the entries, whoever makes them
        x, y, z, w = Rotation.from_euler("xyz", drone.camera_rpy_deg, degrees=True).as_quat().tolist()
        self._body_from_camera: Quaternion = (w, x, y, z)
        self.history = PoseHistory()
        self.dropped = 0
        self._silent_s = 0.0  # live time since the last hit
        self._start_ns: int | None = None
        self._epoch = 0
        self._end_ns = 0
        self._live_s = 0.0
        self._hits = self._photopeak = self._coincidences = 0

    def coverage(self, stamp_ns: int, epoch: int, path_m: tuple[tuple[float, float], ...], swath_m: float) -> Coverage:
        """The log entry of a stretch that was searched; local frame of the epoch."""
        return Coverage(
            stamp_ns=stamp_ns,
            drone=self._drone,
            mission=self._mission,
            boot=self._boot,
            sequence=next(self.numbers),
            epoch=epoch,
            path_m=path_m,
            swath_m=swath_m,
        )

    @property
    def problems(self) -> tuple[str, ...]:
        """What the operator has to know of the camera, a line or none."""
        if self._silent_s < SILENT_S:
            return ()
        return (f"camera: no hit for {SILENT_S:g} s or more, not even of the background; its counts are left out",)

    def observe(self, detections: Detections) -> list[Entry]:
        """Log entries that a stretch of detections gives; counts are held until an exposure is full.

        A camera from which hits have stopped has told of nothing (see ``unseen``): its zeros are no absence of a source.
        Stretches are dropped, and counted in ``dropped``, when nobody knows where they were taken (before the vehicle's first
        telemetry, or longer than the poses are kept) and when they overlap what was observed already (a clock stepped back).
        """
        self._silent_s = 0.0 if detections.hits else self._silent_s + detections.live_time_s
        if self._silent_s >= MUTE_S:
            self._live_s = 0.0  # nor does what is held say anything
            return self._exposure() if self._start_ns is not None else []
        start_ns, end_ns = detections.start_ns, detections.end_ns
        state = self.history.at(start_ns)
        if state is None or start_ns < self._end_ns or not start_ns <= end_ns <= start_ns + HISTORY_NS:
            self.dropped += 1
            return []
        entries: list[Entry] = [self._cone(event) for event in detections.cones]
        if self._start_ns is not None and (start_ns > self._end_ns or state.epoch != self._epoch):
            entries += self._exposure()
        if self._start_ns is None:
            self._start_ns, self._epoch = start_ns, state.epoch
        self._end_ns = end_ns
        self._live_s += detections.live_time_s
        self._hits += detections.hits
        self._photopeak += detections.photopeak
        self._coincidences += detections.coincidences
        if self._end_ns - self._start_ns >= EXPOSURE_NS:
            entries += self._exposure()
        return entries

    def unseen(self, now_ns: int) -> list[Entry]:
        """Where the drone has been while its camera told of nothing: exposures without live time. They say nothing of the source,
        but without them nobody could tell any more where this drone's frame lies.
        """
        entries: list[Entry] = []
        span_ns = self.history.span_ns
        if span_ns is None:
            return entries
        until_ns = min(now_ns - LATE_NS, span_ns[1])
        while until_ns - max(self._end_ns, span_ns[0]) >= EXPOSURE_NS:
            if self._start_ns is not None:
                entries += self._exposure()  # what it told of last
                continue
            self._start_ns = max(self._end_ns, span_ns[0])
            self._end_ns = self._start_ns + EXPOSURE_NS
            entries += self._exposure()
        return entries

    def _cone(self, event: ConeEvent) -> Cone:
        state = self.history.at(event.stamp_ns)
        pose = self.history.pose(event.stamp_ns)
        assert state is not None  # observe() saw to it
        assert pose is not None
        position, local_from_body = pose
        first, second = (turned(local_from_body, turned(self._body_from_camera, axis)) for axis in event.axis.tolist())
        return Cone(
            stamp_ns=event.stamp_ns,
            drone=self._drone,
            mission=self._mission,
            boot=self._boot,
            sequence=next(self.numbers),
            epoch=state.epoch,
            apex_m=position,
            apex_sigma_m=state.position_sigma_m,
            yaw_sigma_rad=state.yaw_sigma_rad,
            clock_sigma_m=state.clock_sigma_m,
            orders=(_order(event, first, 0), _order(event, second, 1)),
            energies_kev=event.energies_kev,
            energy_sigmas_kev=event.energy_sigmas_kev,
            separation_mm=event.separation_mm,
        )

    def _exposure(self) -> list[Entry]:
        start_ns, self._start_ns = self._start_ns, None
        counts = Counts(self._hits, self._photopeak, self._coincidences)
        self._hits = self._photopeak = self._coincidences = 0
        live_s, self._live_s = self._live_s, 0.0
        assert start_ns is not None
        state = self.history.at(start_ns)
        assert state is not None
        poses = []
        for offset_ns in range(0, max(1, self._end_ns - start_ns), SAMPLE_NS):
            pose, then = self.history.pose(start_ns + offset_ns), self.history.at(start_ns + offset_ns)
            assert pose is not None
            if then is not None and then.epoch != state.epoch:  # poses of another frame do not belong to this one
                break
            poses.append(PoseSample(offset_ns, *pose))
        return [
            Exposure(
                stamp_ns=start_ns,
                drone=self._drone,
                mission=self._mission,
                boot=self._boot,
                sequence=next(self.numbers),
                epoch=state.epoch,
                end_ns=self._end_ns,
                live_time_s=min(live_s, (self._end_ns - start_ns) * 1e-9),
                counts=counts,
                poses=tuple(poses),
                position_sigma_m=state.position_sigma_m,
                yaw_sigma_rad=state.yaw_sigma_rad,
                clock_sigma_m=state.clock_sigma_m,
            )
        ]


def _order(event: ConeEvent, axis: Vector3, row: int) -> ConeOrder:
    return ConeOrder(
        axis=axis,
        theta_rad=float(event.theta_rad[row]),
        sigma_rad=float(event.sigma_rad[row]),
        probability=float(event.probability[row]),
    )
