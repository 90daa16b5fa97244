"""From one drone's detections and poses to its log entries: cones and exposures in its local frame."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque

from scipy.spatial.transform import Rotation

from agent.config import DroneConfig
from agent.detector.detection import ConeEvent, Detections
from agent.vehicle.interface import VehicleState
from protocol.messages import Cone, ConeOrder, Counts, Coverage, Entry, Exposure, PoseSample

EXPOSURE_NS = 500_000_000
SAMPLE_NS = 100_000_000  # poses of an exposure: 10 Hz
HISTORY_NS = 5_000_000_000

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w, x, y, z


class PoseHistory:
    """The vehicle's last seconds, to be asked for the pose at an event's time (a later pose would look like a yaw bias)."""

    def __init__(self) -> None:
        self._stamps: deque[int] = deque()
        self._states: deque[VehicleState] = deque()

    def add(self, state: VehicleState) -> None:
        """Append telemetry; older than the newest known is ignored."""
        if self._stamps and state.stamp_ns <= self._stamps[-1]:
            return
        self._stamps.append(state.stamp_ns)
        self._states.append(state)
        while self._stamps[0] < state.stamp_ns - HISTORY_NS:
            self._stamps.popleft()
            self._states.popleft()

    def at(self, stamp_ns: int) -> VehicleState | None:
        """The telemetry nearest before ``stamp_ns`` (the oldest known, where none is)."""
        if not self._states:
            return None
        return self._states[max(0, bisect_right(self._stamps, stamp_ns) - 1)]

    def pose(self, stamp_ns: int) -> tuple[tuple[float, float, float], Quaternion] | None:
        """Position and attitude at ``stamp_ns``, linear between neighbours of one epoch, held at the ends."""
        if not self._states:
            return None
        place = bisect_right(self._stamps, stamp_ns)
        before = self._states[place - 1 if place else 0]
        after = self._states[place] if place < len(self._states) else before
        span = after.stamp_ns - before.stamp_ns
        if span <= 0 or before.epoch != after.epoch:
            return before.position_m, before.quaternion
        part = (stamp_ns - before.stamp_ns) / span
        b, a = before.position_m, after.position_m
        position = (b[0] + part * (a[0] - b[0]), b[1] + part * (a[1] - b[1]), b[2] + part * (a[2] - b[2]))
        return position, _blend(before.quaternion, after.quaternion, part)


class Observer:
    """Turns one detector's stretches into log entries with consecutive sequence numbers."""

    def __init__(self, drone: DroneConfig, mission_id: str, boot: str) -> None:
        self._drone = drone.id
        self._mission = mission_id
        self._boot = boot
        self._sequence = 0
        x, y, z, w = Rotation.from_euler("xyz", drone.camera_rpy_deg, degrees=True).as_quat().tolist()
        self._body_from_camera: Quaternion = (w, x, y, z)
        self.history = PoseHistory()
        self.dropped = 0
        self._start_ns: int | None = None
        self._epoch = 0
        self._end_ns = 0
        self._live_s = 0.0
        self._hits = self._photopeak = self._coincidences = 0

    def coverage(self, stamp_ns: int, path_m: tuple[tuple[float, float], ...], swath_m: float, epoch: int) -> Coverage:
        """The log entry of a stretch that was searched; local frame of the epoch."""
        return Coverage(
            stamp_ns=stamp_ns,
            drone=self._drone,
            mission=self._mission,
            boot=self._boot,
            sequence=self._next_sequence(),
            epoch=epoch,
            path_m=path_m,
            swath_m=swath_m,
        )

    def _next_sequence(self) -> int:
        self._sequence += 1
        return self._sequence

    def observe(self, detections: Detections) -> list[Entry]:
        """Log entries that a stretch of detections gives; counts are held until an exposure is full.

        Stretches are dropped, and counted in ``dropped``, when nobody knows where they were taken (before the vehicle's first
        telemetry, or longer than the poses are kept) and when they overlap what was observed already (a clock stepped back).
        """
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

    def _cone(self, event: ConeEvent) -> Cone:
        state = self.history.at(event.stamp_ns)
        pose = self.history.pose(event.stamp_ns)
        assert state is not None  # observe() saw to it
        assert pose is not None
        position, local_from_body = pose
        first, second = (_turned(local_from_body, _turned(self._body_from_camera, axis)) for axis in event.axis.tolist())
        return Cone(
            stamp_ns=event.stamp_ns,
            drone=self._drone,
            mission=self._mission,
            boot=self._boot,
            sequence=self._next_sequence(),
            epoch=state.epoch,
            apex_m=position,
            apex_sigma_m=state.position_sigma_m,
            yaw_sigma_rad=state.yaw_sigma_rad,
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
                sequence=self._next_sequence(),
                epoch=state.epoch,
                end_ns=self._end_ns,
                live_time_s=min(live_s, (self._end_ns - start_ns) * 1e-9),
                counts=counts,
                poses=tuple(poses),
                position_sigma_m=state.position_sigma_m,
                yaw_sigma_rad=state.yaw_sigma_rad,
            )
        ]


def _turned(rotation: Quaternion, vector: Vector3) -> Vector3:
    """A vector (3,) turned by a quaternion, which need not be of unit length."""
    w, x, y, z = rotation
    a, b, c = vector
    double = 2.0 / (w * w + x * x + y * y + z * z)
    tx, ty, tz = double * (y * c - z * b), double * (z * a - x * c), double * (x * b - y * a)
    return a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx


def _order(event: ConeEvent, axis: Vector3, row: int) -> ConeOrder:
    return ConeOrder(
        axis=axis,
        theta_rad=float(event.theta_rad[row]),
        sigma_rad=float(event.sigma_rad[row]),
        probability=float(event.probability[row]),
    )


def _blend(before: Quaternion, after: Quaternion, part: float) -> Quaternion:
    """Normalised linear interpolation: exact enough between poses 50 ms apart."""
    bw, bx, by, bz = before
    aw, ax, ay, az = after
    if bw * aw + bx * ax + by * ay + bz * az < 0.0:  # the same attitude, by the nearer of its two quaternions
        aw, ax, ay, az = -aw, -ax, -ay, -az
    w, x, y, z = bw + part * (aw - bw), bx + part * (ax - bx), by + part * (ay - by), bz + part * (az - bz)
    size = (w * w + x * x + y * y + z * z) ** 0.5
    return w / size, x / size, y / size, z / size
