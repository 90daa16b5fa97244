"""From a log entry (made by ``sensing.observer``) to an observation in the mission frame, the input of the estimators."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Vector3, yaw_of
from radron.protocol.entries import Cone, Entry, EntryId, Exposure, PoseSample
from radron.protocol.spectrum import Spectrum, SpectrumBin

_MIN_LIVE_S = 1e-3  # exposures shorter than this hold no information
_MIN_AXIS_NORM = 0.5  # a shorter "unit vector" is no direction


class ConeSurface(Struct, frozen=True):
    """One reading of a Compton cone, for one order of the photon's two interactions: the source lies on this surface. Mission
    frame.

    The source lies at the angle theta_rad from the axis. apex: position of the camera, c_e' of the paper (Sec. IV-A), metres.
    axis:
    unit vector, from the absorbed photon to the recoil electron. theta_rad: scattering angle, eq. (3). sigma_rad: 1-sigma width
    of the surface (angular resolution measure, ARM). probability: of this reading.
    """

    stamp_ns: int
    apex: Vector3
    axis: Vector3
    theta_rad: float
    sigma_rad: float
    probability: float


class ConeObservation(Struct, frozen=True):
    """A Compton cone measured by a drone, in the mission frame, with its possible readings (one or two, in the order of
    publication).

    ``identity`` and ``epoch``: of the log entry; ``mission_from_local``: the transform of the publisher's local frame.
    ``position_sigma_m``, ``yaw_sigma_rad``: 1-sigma errors of the drone's position (horizontal distance) and heading.
    """

    stamp_ns: int
    readings: tuple[ConeSurface, ...]
    position_sigma_m: float
    yaw_sigma_rad: float
    mission_from_local: Transform
    identity: EntryId
    epoch: int
    energy_kev: float = 0.0  # of the line

    @property
    def apex(self) -> Vector3:
        """Position of the camera that measured the cone, mission frame, metres."""
        return self.readings[0].apex

    @property
    def probable(self) -> ConeSurface:
        """The more probable reading of the cone, of the two orders of the photon's interactions."""
        return max(self.readings, key=lambda reading: reading.probability)

    @property
    def forward(self) -> ConeSurface:
        """The reading with the smaller scattering angle, in which the cluster with less energy was the electron."""
        return min(self.readings, key=lambda reading: reading.theta_rad)


class CountObservation(Struct, frozen=True):
    """The counts of a camera during an exposure (about half a second), with the camera's position in the middle of it, mission
    frame.

    ``stamp_ns``: the exposure's end, the first time at which it is known. ``facing``: means of cos 2 psi and sin 2 psi over the
    exposure, psi the drone's heading from east; the sensor's sensitivity depends on the square of a cosine, so on twice the
    angle; 0, 0 for an unknown heading. ``way_m``: distance between the camera's first and last position. ``bins``: of an
    ordinary detector, counts in the channels of its table of response. ``position_sigma_m``,
    ``yaw_sigma_rad``: 1-sigma errors of the drone's position (horizontal distance) and heading. ``identity``, ``epoch``: of the
    log entry; ``mission_from_local``: the transform of the publisher's local frame.
    """

    stamp_ns: int
    middle_ns: int
    position: Vector3
    live_time_s: float
    counts: NDArray[np.float64]  # (3,) hits, full-energy events, coincidences
    position_sigma_m: float
    yaw_sigma_rad: float
    mission_from_local: Transform
    identity: EntryId
    epoch: int
    spectrum: Spectrum = ()
    facing: tuple[float, float] = (0.0, 0.0)
    way_m: float = 0.0
    bins: tuple[int, ...] = ()


Observation = ConeObservation | CountObservation


def observe(entry: Entry, mission_from_local: Transform, identity: EntryId | None = None) -> Observation | None:
    """Transform a log entry into an observation in the mission frame; None if it holds no information about the source.

    ``identity``: the entry's identity as the log holds it, so that only one object is in memory.

    The entry's content alone decides, so that all agents decide alike. Without information are a cone whose readings are both
    impossible (probability 0) or have no axis, and an exposure without live time.
    """
    identity = identity or entry.entry_id
    if isinstance(entry, Cone):
        return _observe_cone(entry, mission_from_local, identity)
    if isinstance(entry, Exposure):
        return _observe_counts(entry, mission_from_local, identity)
    return None


def known_ns(entry: Entry) -> int:
    """Return the time (ns) from which the measurement in an entry is known: the end of an exposure, the stamp of all other
    entries.
    """
    return entry.end_ns if isinstance(entry, Exposure) else entry.stamp_ns


def _observe_counts(exposure: Exposure, mission_from_local: Transform, identity: EntryId) -> CountObservation | None:
    if exposure.live_time_s < _MIN_LIVE_S:
        return None
    middle_ns = (exposure.stamp_ns + exposure.end_ns) // 2
    counts = np.array([exposure.counts.hits, exposure.counts.photopeak, exposure.counts.coincidences], dtype=np.float64)
    place = _position(exposure.poses, middle_ns - exposure.stamp_ns)
    sigmas = _sigmas(exposure, mission_from_local, place, exposure.position_sigma_m)
    position = mission_from_local.apply_point(place)
    live_s = exposure.live_time_s
    return CountObservation(
        known_ns(exposure),
        middle_ns,
        position,
        live_s,
        counts,
        *sigmas,
        mission_from_local,
        identity,
        exposure.epoch,
        tuple(map(_alike, exposure.spectrum)),
        _facing(exposure.poses, mission_from_local.yaw_rad),
        math.dist(exposure.poses[0].position_m, exposure.poses[-1].position_m),
        exposure.bins or (),
    )


@lru_cache(maxsize=4096)
def _alike(one: SpectrumBin) -> SpectrumBin:
    """Return an equal bin that is held already: most hold one event or two, and each log thousands of them."""
    return one


def _sigmas(entry: Cone | Exposure, mission_from_local: Transform, place: Vector3, told_m: float) -> tuple[float, float]:
    """Return 1-sigma errors of position and heading at a place of the local frame.

    The covariance of an estimated frame includes the error of the drone's own localisation, independent of the drone's statement.
    The additional error of a wrong clock is not included.
    """
    if mission_from_local.covariance is None:
        return told_m, entry.yaw_sigma_rad
    position_m, yaw_rad = mission_from_local.sigmas_at(place)
    return math.hypot(position_m, entry.clock_sigma_m), yaw_rad


def _position(poses: Sequence[PoseSample], offset_ns: int) -> Vector3:
    """Return the drone's position at an offset, interpolated between neighbouring samples, or the last sample's; local frame."""
    after = next((place for place, sample in enumerate(poses) if sample.offset_ns >= offset_ns), len(poses) - 1)
    late, early = poses[after], poses[max(after - 1, 0)]
    span_ns = late.offset_ns - early.offset_ns
    if span_ns <= 0 or late.offset_ns < offset_ns:
        return late.position_m
    part = (late.offset_ns - offset_ns) / span_ns
    (x, y, z), (u, v, w) = late.position_m, early.position_m
    return (x + part * (u - x), y + part * (v - y), z + part * (w - z))


def _facing(poses: Sequence[PoseSample], turned_rad: float) -> tuple[float, float]:
    """Return ``facing`` as in ``CountObservation``; ``turned_rad``: yaw of the local frame in the mission frame."""
    doubled = [2.0 * (yaw_of(sample.quaternion) + turned_rad) for sample in poses]
    return sum(map(math.cos, doubled)) / len(doubled), sum(map(math.sin, doubled)) / len(doubled)


def _observe_cone(cone: Cone, mission_from_local: Transform, identity: EntryId) -> ConeObservation | None:
    apex = mission_from_local.apply_point(cone.apex_m)
    readings = []
    for order in cone.orders:
        length = math.hypot(*order.axis)
        if order.probability <= 0.0 or length < _MIN_AXIS_NORM:
            continue
        x, y, z = mission_from_local.rotate_direction(order.axis)
        axis = (x / length, y / length, z / length)
        readings.append(ConeSurface(cone.stamp_ns, apex, axis, order.theta_rad, order.sigma_rad, order.probability))
    if not readings:
        return None
    sigmas = _sigmas(cone, mission_from_local, cone.apex_m, cone.apex_sigma_m)
    return ConeObservation(
        cone.stamp_ns, tuple(readings), *sigmas, mission_from_local, identity, cone.epoch, sum(cone.energies_kev)
    )
