"""Newest messages of one drone, as a station has received them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection

from msgspec.structs import replace

from radron.agent.frames.transform import Transform
from radron.protocol.entries import Exposure
from radron.protocol.messages import Estimate, Frame, Plan, Pose, Status
from radron.protocol.spectrum import BINS
from radron.station.picture.frame import DroneFrame, DroneSpectrum, Point

SILENT_AFTER_S = 1.5  # a drone is drawn as stale after this time without any message; poses come ten times a second
RATES_S = 3.0  # averaging time of count rates
SPECTRUM_S = 30.0  # summing time of spectra
ESTIMATE_S = 2.0  # older estimates of a drone are not compared any more
_PLAN_POINTS = 12

Course = tuple[Point, ...]  # course of a plan, mission frame


class Member:
    """Keeps the newest messages of one drone, and derives from them what the operator's web page shows of this drone.

    ``seen_ns``: time of the last message by the station's clock, nanoseconds UTC; 0: never heard.
    """

    def __init__(self, drone: str, localization: str) -> None:
        self.drone = drone
        self.localization = localization
        self.pose: Pose | None = None
        self.plan: Plan | None = None
        self.frame: Frame | None = None
        self.status: Status | None = None
        self.estimate: Estimate | None = None
        self.alive = False  # by its liveliness token
        self.seen_ns = 0
        self._exposures: deque[Exposure] = deque()
        self._rates: tuple[float, float, float] | None = None
        self._course: tuple[Plan | None, Transform | None, Course] = (None, None, ())  # the last course, with its plan and frame
        self._spectra: deque[Exposure] = deque()

    def hear(self, message: object, now_ns: int) -> None:
        """Store a message of this drone, unless a newer message of its kind is known."""
        self.seen_ns = max(self.seen_ns, now_ns)
        if isinstance(message, Pose) and _newer(message, self.pose):
            self.pose = message
        elif isinstance(message, Plan) and _newer(message, self.plan):
            self.plan = message
        elif isinstance(message, Frame) and _newer(message, self.frame):
            self.frame = message
        elif isinstance(message, Status) and _newer(message, self.status):
            self.status = message
        elif isinstance(message, Estimate) and _newer(message, self.estimate):
            self.estimate = message

    def expose(self, exposure: Exposure) -> None:
        """Add the photon counts of an exposure (one counting interval of the camera) from the log."""
        self._exposures.append(exposure)
        newest_ns = max(each.end_ns for each in self._exposures)
        while self._exposures and self._exposures[0].end_ns < newest_ns - RATES_S * 1e9:
            self._exposures.popleft()
        self._rates = _rates_ps(self._exposures)
        self._spectra.append(exposure)
        while self._spectra[0].end_ns < newest_ns - SPECTRUM_S * 1e9:
            self._spectra.popleft()

    def is_stale(self, now_ns: int) -> bool:
        """Return whether no message has come for ``SILENT_AFTER_S`` seconds, or the drone's program has ended."""
        return not self.alive or now_ns - self.seen_ns > SILENT_AFTER_S * 1e9

    def transform(self, epoch: int, known: Transform | None) -> Transform | None:
        """Return the transform from the drone's local frame of this ``epoch`` to the mission frame; None if unknown.

        ``known``: the transform according to the log, which is preferred; otherwise the drone's own published transform is
        returned.
        """
        if known is not None or self.frame is None or self.frame.epoch != epoch:
            return known
        return Transform(self.frame.yaw_rad, self.frame.translation_m)

    def rates_ps(self, now_ns: int) -> tuple[float, float, float] | None:
        """Return hits, full-energy events and coincidences (pairs of simultaneous clusters of pixels) per second of live time.

        Return None without recent exposures (counting intervals of the camera).
        """
        if self._rates is None or now_ns - self._exposures[-1].end_ns > 2.0 * RATES_S * 1e9:
            return None
        return self._rates

    def spectrum(self, now_ns: int) -> DroneSpectrum | None:
        """Return the gamma spectrum of the camera over the last seconds; None if the drone has sent no counts recently."""
        if not self._spectra or now_ns - max(each.end_ns for each in self._spectra) > SPECTRUM_S * 1e9:
            return None
        singles, coincidences = [0] * BINS, [0] * BINS
        for exposure in self._spectra:
            for each in exposure.spectrum:
                singles[each.place] += each.singles
                coincidences[each.place] += each.coincidences
        live_s = round(sum(each.live_time_s for each in self._spectra), 3)
        return DroneSpectrum(self.drone, live_s, tuple(singles), tuple(coincidences))

    def recent_estimate(self, now_ns: int) -> Estimate | None:
        """Return the drone's own source estimate; None if there is no recent one."""
        estimate = self.estimate
        return estimate if estimate is not None and now_ns - estimate.stamp_ns < ESTIMATE_S * 1e9 else None

    def shown(self, now_ns: int, mission_from_local: Transform | None) -> DroneFrame:
        """Return the state of this drone as the operator's web page shows it.

        ``mission_from_local``: transform from the drone's local frame to the mission frame, for its newest pose; None if unknown.
        """
        status, pose = self.status, self.pose
        frame = DroneFrame(
            id=self.drone,
            age_s=round((now_ns - self.seen_ns) * 1e-9, 2) if self.seen_ns else None,
            alive=self.alive,
            stale=self.is_stale(now_ns),
            localization=self.localization,
            rates_ps=self.rates_ps(now_ns),
        )
        return _with_pose(_with_status(frame, status), pose, self._planned(mission_from_local), mission_from_local)

    def _planned(self, mission_from_local: Transform | None) -> Course:
        """Return the course of the drone's plan; empty if the plan's epoch is not the newest pose's. Cached by plan and frame."""
        plan, pose = self.plan, self.pose
        if plan is None or pose is None or plan.epoch != pose.epoch or mission_from_local is None:
            return ()
        known, by, course = self._course
        if known is not plan or by is not mission_from_local:
            course = _course(plan, mission_from_local)
            self._course = plan, mission_from_local, course
        return course


def _with_status(frame: DroneFrame, status: Status | None) -> DroneFrame:
    if status is None:
        return frame
    return replace(
        frame,
        stage=str(status.stage),
        battery=status.battery,
        problems=status.problems,
        notices=status.notices,
        problem_codes=tuple(text.code for text in status.texts.problems),
        notice_codes=tuple(text.code for text in status.texts.notices),
        recognised=status.recognised.nuclide if status.recognised is not None else None,
    )


def _rates_ps(exposures: Collection[Exposure]) -> tuple[float, float, float] | None:
    """Hits, full-energy events and coincidences per second of live time."""
    live_s = sum(each.live_time_s for each in exposures)
    if live_s <= 0.0:
        return None
    counts = [(each.counts.hits, each.counts.photopeak, each.counts.coincidences) for each in exposures]
    hits, photopeak, coincidences = (round(sum(column) / live_s, 2) for column in zip(*counts, strict=True))
    return hits, photopeak, coincidences


def _with_pose(frame: DroneFrame, pose: Pose | None, course: Course, mission_from_local: Transform | None) -> DroneFrame:
    if pose is None or mission_from_local is None:
        return frame
    x, y, z = mission_from_local.apply_point(pose.position_m)
    w, i, j, k = pose.quaternion
    yaw = math.atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k)) + mission_from_local.yaw_rad
    return replace(
        frame,
        place=(round(x, 2), round(y, 2), round(z, 2)),
        yaw=round(yaw, 3),
        speed_mps=round(math.hypot(*pose.velocity_mps[:2]), 2),
        sigma_m=round(pose.position_sigma_m, 3),
        plan=course,
    )


def _course(plan: Plan, mission_from_local: Transform) -> Course:
    last = len(plan.positions_m) - 1
    chosen = sorted({round(last * point / (_PLAN_POINTS - 1)) for point in range(_PLAN_POINTS)})
    places = mission_from_local.apply_points([plan.positions_m[place] for place in chosen])
    return tuple((round(x, 2), round(y, 2)) for x, y, _ in places)


def _newer(message: Pose | Plan | Frame | Status | Estimate, known: Pose | Plan | Frame | Status | Estimate | None) -> bool:
    return known is None or message.stamp_ns > known.stamp_ns
