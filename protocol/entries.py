"""Log entries: raw observations that every agent keeps for the whole mission.

Each entry has an identity, and is accepted or refused by its bytes alone, never by the receiver's clock. Units are in the names,
limits in ``units``; frames as in ``messages``.
"""

from __future__ import annotations

from itertools import pairwise
from sys import intern
from typing import Annotated, NamedTuple

from msgspec import UNSET, Meta, Struct, UnsetType

from radron.protocol.checks import flaw_of_covariance, is_unit
from radron.protocol.message import DroneMessage
from radron.protocol.spectrum import Spectrum, is_in_order
from radron.protocol.units import (
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

MAX_READABLE_EXPOSURE_NS = 60_000_000_000  # readable: records of former releases may hold exposures of this length
MAX_LOGGED_EXPOSURE_NS = 2_000_000_000  # accepted by a log
MAX_CHANNELS = 128  # of an ordinary detector's spectrum in an exposure: 2 kB with the poses of 2 s
SIGNATURE_BYTES = 64  # Ed25519
Signature = Annotated[bytes, Meta(max_length=SIGNATURE_BYTES)]
Proof = Annotated[bytes, Meta(max_length=SIGNATURE_BYTES + 1 + 16 * 5)]


class EntryId(NamedTuple):
    """Unique identity of a log entry: one measurement of one drone.

    Estimators read the entries of a mission in ascending order of these identities, so that all drones read the same sequence.
    ``boot``: identity of a run of the drone's agent. ``sequence``: number of the entry within this run.
    """

    mission: str
    stamp_ns: int
    drone: str
    boot: str
    sequence: int


class Entry(DroneMessage, frozen=True, kw_only=True):
    """Base of the log entries: measurements that each drone publishes and that every drone keeps for the whole mission.

    ``boot`` is a new random word at every start of the agent. ``sequence`` counts the entries within one boot. ``proof`` shows
    that this drone has signed the entry (see ``signing``).
    """

    mission: MissionId
    boot: BootId
    sequence: Count
    proof: Proof = b""  # of the publisher's signature: see ``signing``

    @property
    def entry_id(self) -> EntryId:
        """Return the unique identity of this entry.

        Equal texts are stored once (interned), as logs keep hundreds of thousands of identities.
        """
        return EntryId(intern(self.mission), self.stamp_ns, intern(self.drone), intern(self.boot), self.sequence)


class Credential(Entry, frozen=True, kw_only=True):
    """A drone's certificate, published as the first log entry (sequence number 0) after each start of its agent.

    Receivers verify the proofs of all later entries of this boot with the certificate.
    """

    certificate: Certificate


class ConeOrder(Struct, frozen=True, array_like=True):
    """One of the two possible orders of scattering and absorption in a coincidence.

    A coincidence is a pair of simultaneous clusters (adjacent pixels hit by one particle), from one photon that was scattered and
    then absorbed. Each order takes another cluster for the recoil electron of the scattering, so that each gives another cone.

    ``axis``: unit vector from the absorption of the scattered photon to the recoil electron, in the publisher's local frame. The
    source lies in a direction at the angle ``theta_rad`` from the axis. ``sigma_rad``: 1-sigma width of the cone's surface
    (angular resolution measure, ARM). ``probability``: that this order is the true one.
    """

    axis: Direction
    theta_rad: Annotated[float, Meta(ge=0.0, le=3.1416)]
    sigma_rad: SensorSigmaRadians
    probability: Probability


class Cone(Entry, frozen=True, kw_only=True):
    """One Compton cone: the directions from which a photon may have come that scattered in a drone's camera.

    A cone is evidence for the direction of the source only; the number of photons is in ``Exposure`` (paper, Sec. IV-A).
    ``apex_m``: position of the camera, with the 1-sigma error ``apex_sigma_m``. ``separation_mm``: distance of the two clusters.
    ``orders``: the two possible orders of scattering and absorption.
    """

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
        """Return an error text if an axis is no unit vector or the probabilities are impossible; else None.

        The probabilities of two exclusive alternatives must add up to more than 0 and at most 1.
        """
        first, second = self.orders
        if not 0.0 < first.probability + second.probability < 1.000001:
            return "the probabilities of its orders add up to 0 or to more than 1"
        return None if is_unit(first.axis) and is_unit(second.axis) else "an axis is no unit vector"


class PoseSample(Struct, frozen=True, array_like=True):
    """A drone's position and attitude ``offset_ns`` after the time stamp of the message that contains this sample."""

    offset_ns: DurationNs
    position_m: Position
    quaternion: Quaternion


class CarriedFrame(Struct, frozen=True, array_like=True):
    """Transform from the local frame of a later epoch to the local frame of the drone's first epoch.

    An epoch begins when the drone's localisation jumps; the drone's own motion relates the frames before and after the jump. The
    transform is a rotation by ``yaw_rad`` about the vertical axis, followed by ``translation_m``. ``covariance``: rows of the 4 x
    4 error covariance matrix over (x m, y m, z m, yaw rad); None: the two frames are identical.
    """

    translation_m: Position
    yaw_rad: Radians
    covariance: Annotated[tuple[Variance, ...], Meta(min_length=16, max_length=16)] | None = None


class Counts(Struct, frozen=True, array_like=True):
    """Numbers of events in a detector during an interval.

    ``hits``: all clusters. ``photopeak``: events with the full energy of a gamma line. ``coincidences``: pairs of simultaneous
    clusters.
    """

    hits: Count
    photopeak: Count
    coincidences: Count


class Exposure(Entry, frozen=True, kw_only=True):
    """The number of photons that a drone's camera has counted from ``stamp_ns`` until before ``end_ns``, and where the drone was.

    Intervals without photons are published, too, since they show where no source is. An interval lasts at most
    ``MAX_LOGGED_EXPOSURE_NS``; exposures of a drone that overlap are not evaluated. ``live_time_s``: the part of the interval in
    which the camera could register photons. ``spectrum``: the counts by energy. ``carried``: only in later epochs of a drone
    whose first local frame is exactly known, the transform to that first frame. ``bins``: only of an ordinary detector, the
    counts in each channel of its table of response, which the mission names; they add up to ``counts.hits``."""

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
    bins: Annotated[tuple[Count, ...], Meta(max_length=MAX_CHANNELS)] | UnsetType = UNSET

    def flaw(self) -> str | None:
        """Return an error text if interval, live time, poses, spectrum and covariance contradict each other; else None."""
        if not is_in_order(self.spectrum):
            return "the bins of its spectrum are not in order of energy"
        if self.bins is not UNSET and sum(self.bins) != self.counts.hits:
            return "the counts in its channels do not add up to its counts"
        duration_ns = self.end_ns - self.stamp_ns
        if duration_ns <= 0:
            return "it ends before it begins"
        if duration_ns > MAX_READABLE_EXPOSURE_NS:
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
    """A drone's measurement of the direction, the range, or both, of another drone.

    A camera measures the direction by the other drone's blinking light, and a radio measures the range. Light and radio name
    identify the ``target``, possibly wrongly. ``position_m`` and ``direction`` (unit vector) are in the measuring drone's local
    frame; ``direction_sigma_rad`` and ``range_sigma_m`` are 1-sigma errors.
    """

    epoch: Epoch
    target: DroneId
    position_m: Position
    direction: Direction | None = None
    direction_sigma_rad: SensorSigmaRadians | None = None
    range_m: PositiveMetres | None = None
    range_sigma_m: SensorSigmaMetres | None = None

    def flaw(self) -> str | None:
        """Return an error text for an inconsistent measurement; else None.

        The target must be another drone. At least one of direction and range must be present, each with its error; a direction
        must be a unit vector.
        """
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
    """A drone's GNSS position (WGS84, height above the ellipsoid), paired with its position by its own localisation.

    The pair relates the drone's local frame to the Earth. ``position_m``: in the local frame at the time of the GNSS position.
    The sigmas are 1-sigma errors in metres, horizontal and vertical, as the receiver reports them.
    """

    epoch: Epoch
    position_m: Position
    latitude_deg: Latitude
    longitude_deg: Longitude
    altitude_m: Metres
    horizontal_sigma_m: SensorSigmaMetres
    vertical_sigma_m: SensorSigmaMetres


class Coverage(Entry, frozen=True, kw_only=True):
    """A part of the search area that a drone has surveyed: all places within ``swath_m / 2`` of the flown path ``path_m``."""

    epoch: Epoch
    path_m: Annotated[tuple[tuple[Metres, Metres], ...], Meta(min_length=1, max_length=256)]
    swath_m: SwathMetres


class Retraction(Entry, frozen=True, kw_only=True):
    """A drone's withdrawal of its own measurements, which were taken with a wrong clock or a possibly wrong localisation.

    The measurements have the sequence numbers ``first`` to ``last`` of this boot. They stay in the log, but estimators ignore
    them. Entries about coverage are not withdrawn.
    """

    first: Count
    last: Count

    def flaw(self) -> str | None:
        """Return an error text unless the withdrawn sequence numbers are all below the number of this entry; else None."""
        return None if self.first <= self.last < self.sequence else "it does not take back earlier entries"


AnyEntry = Cone | Exposure | Sighting | Fix | Coverage  # measurements, for estimators
