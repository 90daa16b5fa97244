"""Log entries: raw observations that every agent keeps for the whole mission.

Each entry has an identity, and is accepted or refused by its bytes alone, never by the receiver's clock. Units are in the names,
limits in ``units``; frames as in ``messages``.
"""

from __future__ import annotations

from itertools import pairwise
from sys import intern
from typing import Annotated, NamedTuple

from msgspec import Meta, Struct

from protocol.checks import flaw_of_covariance, is_unit
from protocol.message import DroneMessage
from protocol.spectrum import Spectrum, is_in_order
from protocol.units import (
    BootId,
    Certificate,
    Count,
    Direction,
    DroneId,
    DurationNs,
    Epoch,
    KiloElectronvolt,
    Latitude,
    Longitude,
    Metres,
    MissionId,
    Position,
    PositiveMetres,
    Probability,
    Quaternion,
    Radians,
    Seconds,
    SensorSigmaMetres,
    SensorSigmaRadians,
    SeparationMm,
    SigmaRadians,
    StampNs,
    SwathMetres,
    Variance,
)

LONGEST_EXPOSURE_NS = 60_000_000_000  # readable: records of former releases may hold exposures of this length
MAX_EXPOSURE_NS = 2_000_000_000  # accepted by a log
SIGNATURE_BYTES = 64  # Ed25519
Proof = Annotated[bytes, Meta(max_length=SIGNATURE_BYTES + 1 + 16 * 5)]


class EntryId(NamedTuple):
    """Identity of a log entry; also its rank in the order in which estimators read the log (within one mission)."""

    mission: str
    stamp_ns: int
    drone: str
    boot: str
    sequence: int


class Entry(DroneMessage, frozen=True, kw_only=True):
    """Base of the log entries. ``boot`` changes at every start of the agent, ``sequence`` counts within one boot."""

    mission: MissionId
    boot: BootId
    sequence: Count
    proof: Proof = b""  # of the publisher's signature: see ``signing``

    @property
    def entry_id(self) -> EntryId:
        """The unique identity of this entry. All identities share their texts, as logs keep hundreds of thousands of them."""
        return EntryId(intern(self.mission), self.stamp_ns, intern(self.drone), intern(self.boot), self.sequence)


class Credential(Entry, frozen=True, kw_only=True):
    """The first entry of a boot, with sequence number 0: the certificate that verifies the proofs of all entries of the boot."""

    certificate: Certificate


class ConeOrder(Struct, frozen=True, array_like=True):
    """One order of a coincidence: which of its two clusters was the recoil electron.

    The source lies in a direction u with angle(u, axis) = theta; ``axis`` points from the absorbed photon to the recoil electron,
    in the publisher's local frame. ``sigma_rad``: 1-sigma width of the cone's surface (ARM).
    """

    axis: Direction
    theta_rad: Annotated[float, Meta(ge=0.0, le=3.1416)]
    sigma_rad: SensorSigmaRadians
    probability: Probability


class Cone(Entry, frozen=True, kw_only=True):
    """A Compton cone: direction only; its count is in the exposure (paper, Sec. IV-A)."""

    epoch: Epoch
    apex_m: Position
    apex_sigma_m: PositiveMetres
    yaw_sigma_rad: SigmaRadians
    clock_sigma_m: PositiveMetres = 0.0  # part of apex_sigma_m that the drone's clock error causes by its motion
    orders: tuple[ConeOrder, ConeOrder]  # first: cluster 1 is the electron; second: cluster 2 is
    energies_kev: tuple[KiloElectronvolt, KiloElectronvolt]  # clusters 1 and 2
    energy_sigmas_kev: tuple[KiloElectronvolt, KiloElectronvolt]
    separation_mm: SeparationMm

    def flaw(self) -> str | None:
        """The axes must be unit vectors, and the probabilities must fit two exclusive alternatives (sum at most 1)."""
        first, second = self.orders
        if not 0.0 < first.probability + second.probability < 1.000001:
            return "the probabilities of its orders add up to 0 or to more than 1"
        return None if is_unit(first.axis) and is_unit(second.axis) else "an axis is no unit vector"


class PoseSample(Struct, frozen=True, array_like=True):
    """Pose of the drone at ``stamp_ns + offset_ns`` of the message that contains it."""

    offset_ns: DurationNs
    position_m: Position
    quaternion: Quaternion


class CarriedFrame(Struct, frozen=True, array_like=True):
    """Pose of an epoch's frame in the frame of the same drone's first epoch: translation, then yaw about up.

    The drone's motion carries the frame over jumps of the localisation. ``covariance``: rows of the 4 x 4 matrix over (x m, y m,
    z m, yaw rad); None: the two frames are the same.
    """

    translation_m: Position
    yaw_rad: Radians
    covariance: Annotated[tuple[Variance, ...], Meta(min_length=16, max_length=16)] | None = None


class Counts(Struct, frozen=True, array_like=True):
    """Events of one detector in an interval: all clusters, full-energy events, two-cluster coincidences."""

    hits: Count
    photopeak: Count
    coincidences: Count


class Exposure(Entry, frozen=True, kw_only=True):
    """Counts over [stamp_ns, end_ns), zeros included; at most ``MAX_EXPOSURE_NS``. Overlapping exposures of a drone do not count.

    ``carried``: only in later epochs of a drone with an exactly known first frame.
    """

    epoch: Epoch
    end_ns: StampNs
    live_time_s: Seconds
    counts: Counts
    poses: Annotated[tuple[PoseSample, ...], Meta(min_length=1, max_length=256)]  # 10 Hz or more
    position_sigma_m: PositiveMetres
    yaw_sigma_rad: SigmaRadians
    clock_sigma_m: PositiveMetres = 0.0  # part of position_sigma_m that the drone's clock error causes by its motion
    spectrum: Spectrum = ()
    carried: CarriedFrame | None = None

    def flaw(self) -> str | None:
        """Interval, live time, poses, spectrum and covariance must be consistent."""
        if not is_in_order(self.spectrum):
            return "the bins of its spectrum are not in order of energy"
        duration_ns = self.end_ns - self.stamp_ns
        if duration_ns <= 0:
            return "it ends before it begins"
        if duration_ns > LONGEST_EXPOSURE_NS:
            return "it is longer than a minute"
        if self.live_time_s > duration_ns * 1e-9 * 1.000001:
            return "its live time is longer than itself"
        if not all(before.offset_ns < after.offset_ns for before, after in pairwise(self.poses)):
            return "its poses are not in order of time"
        if self.poses[-1].offset_ns > duration_ns:
            return "a pose lies outside of it"
        if self.carried is not None and self.carried.covariance is not None:
            rows = [self.carried.covariance[row : row + 4] for row in (0, 4, 8, 12)]
            flaw = flaw_of_covariance(rows)
            if flaw is not None:
                return flaw
        return None if all(is_unit(pose.quaternion) for pose in self.poses) else "a quaternion has no unit norm"


class Sighting(Entry, frozen=True, kw_only=True):
    """A relative observation of another drone by this drone's sensors: direction (local frame), range, or both.

    ``position_m``: this drone's position. A camera gives a direction, a radio a range. The blinking or the radio's name
    identifies the other drone, possibly wrongly.
    """

    epoch: Epoch
    target: DroneId
    position_m: Position
    direction: Direction | None = None
    direction_sigma_rad: SensorSigmaRadians | None = None
    range_m: PositiveMetres | None = None
    range_sigma_m: SensorSigmaMetres | None = None

    def flaw(self) -> str | None:
        """The target must be another drone; each measurement needs its error; at least one; directions are unit vectors."""
        if self.target == self.drone:
            return "it is of the drone itself"
        if (self.range_m is None) != (self.range_sigma_m is None):
            return "of range and range_sigma one is missing"
        if (self.direction is None) != (self.direction_sigma_rad is None):
            return "of direction and direction_sigma one is missing"
        if self.direction is None:
            return "it has neither direction nor range" if self.range_m is None else None
        return None if is_unit(self.direction) else "its direction is no unit vector"


class Fix(Entry, frozen=True, kw_only=True):
    """A satellite fix of this drone (WGS84, height above the ellipsoid), and its own localisation's ``position_m`` at this time.

    The sigmas are horizontal and vertical distances, as reported by the receiver.
    """

    epoch: Epoch
    position_m: Position
    latitude_deg: Latitude
    longitude_deg: Longitude
    altitude_m: Metres
    horizontal_sigma_m: SensorSigmaMetres
    vertical_sigma_m: SensorSigmaMetres


class Coverage(Entry, frozen=True, kw_only=True):
    """A flown part of the survey: the area within ``swath_m / 2`` of the path is covered."""

    epoch: Epoch
    path_m: Annotated[tuple[tuple[Metres, Metres], ...], Meta(min_length=1, max_length=256)]
    swath_m: SwathMetres


class Retraction(Entry, frozen=True, kw_only=True):
    """A drone's retraction of its measurements with the numbers ``first`` to ``last`` of this boot.

    Reasons: a wrong clock at their stamps, or a possibly wrong localisation. Retracted measurements stay in the log, and do not
    count. Coverage is not retracted.
    """

    first: Count
    last: Count

    def flaw(self) -> str | None:
        """Only earlier entries can be retracted."""
        return None if self.first <= self.last < self.sequence else "it does not take back earlier entries"


AnyEntry = Cone | Exposure | Sighting | Fix | Coverage  # measurements, for estimators
