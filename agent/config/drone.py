"""The drone file: everything that belongs to one vehicle: its links, sensors and folders."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, field

from radron.agent.config.section import Coordinate, Degrees, DetectorKind, NonNegative, Section
from radron.protocol.units import DroneId, Identifier

PARAMETER = "^[A-Z][A-Z0-9_]{0,15}$"  # of PX4
ParameterName = Annotated[str, Meta(pattern=PARAMETER)]


class PeerMeshConfig(Section, frozen=True, kw_only=True):
    """Addresses of the swarm's Zenoh sessions (its radio network), by drone: ``{d1 = "tls/10.7.1.11:7447", ...}``, equal on every
    drone.

    A drone listens at its own endpoint and connects to the endpoints of the drones before it: one link for each pair. ``gossip``:
    it also connects to the endpoints that peers announce. ``identity``: folder with this drone's certificate and key, made by
    ``radron-deploy pki issue``. ``insecure``: plain TCP instead (endpoints ``tcp/...``), open to everybody. ``others``: names of
    the operators and observers that may join (none: all with a certificate of the swarm).
    """

    endpoints: dict[DroneId, str] = field(default_factory=dict)
    listen: str | None = None  # none: its own entry of ``endpoints``
    gossip: bool = True
    identity: str | None = None
    insecure: bool = False
    others: tuple[Identifier, ...] | None = None


class VisionConfig(Section, frozen=True, kw_only=True):
    """Address ("host:port") of the TCP feed with the poses of a visual or LiDAR SLAM on board, which are passed on to the
    autopilot.
    """

    address: str


class ResponseConfig(Section, frozen=True, kw_only=True):
    """The vehicle's response to setpoints, as assumed at the start of a flight; drag, lag and tracking error are then identified
    in flight.

    The defaults are the values of PX4 for a quadrotor, with a drag between small and large vehicles. ``radron-agent identify``
    fits them to a recorded flight.
    """

    drag_ps: Annotated[float, Meta(ge=0.0, le=3.0)] = 0.5  # deceleration by drag, per m/s of speed
    lag_s: Annotated[float, Meta(ge=0.0, le=0.6)] = 0.06  # dead time: half the setpoints' period, and the autopilot's
    attitude_lag_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.24  # from commanded to actual tilt; about 1 / MC_ROLL_P
    derivative_gain: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.2  # MPC_XY_VEL_D_ACC: the autopilot's damping of accelerations
    tracking_error_m: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.4  # horizontal deviation from the plan, RMS


class VehicleConfig(Section, frozen=True, kw_only=True):
    """The onboard computer's MAVLink link to the autopilot, and assumptions about vehicle and localisation.

    ``address``: a MAVSDK address. The autopilot obeys every sender that reaches it. The best link is therefore a serial line, or
    a network of computer and autopilot alone, with the agent listening at its own address there. ``source``: the autopilot's IP
    address there; packets from other addresses are dropped; none: the first address heard, but on a loopback any. ``system_id``:
    the vehicle's MAVLink system id, for a link shared with other autopilots; none: the first id heard. ``gnss``:
    the autopilot flies by satellites; without satellites the autopilot has neither origin nor home, and is guided by vision.
    ``parameters``: names of autopilot parameters that the computer reports besides the parameters that a flight relies on.
    """

    address: str = "udpin://127.0.0.1:14540"
    source: str | None = None
    connect_timeout_s: Annotated[float, Meta(gt=0.0, le=600.0)] = 5.0
    system_id: Annotated[int, Meta(ge=1, le=255)] | None = None
    position_sigma_m: NonNegative = 0.15  # lower limit; the autopilot's own figure is used if it is larger
    yaw_sigma_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 1.0
    gnss: bool = True
    vision: VisionConfig | None = None  # none: there is no SLAM, or it feeds the autopilot directly
    response: ResponseConfig = ResponseConfig()
    parameters: tuple[ParameterName, ...] = ()

    @property
    def by_satellites(self) -> bool:
        """Whether the autopilot's only position source is its satellite receiver."""
        return self.gnss and self.vision is None


class SightingsConfig(Section, frozen=True, kw_only=True):
    """Address of the TCP feed of a sensor for relative observations of other drones (a camera that sees their lamps, a ranging
    radio).
    """

    address: str | None = None  # "host:port"; none: there is no such sensor


class DetectorConfig(Section, frozen=True, kw_only=True):
    """The device or file from which the agent gets the data of its detector: pixel hits of the Compton camera, or counts.

    ``kind``: of the detector, as the mission has it for this drone: the Compton camera ``minipix``, or an ordinary detector
    (``spectrum``, ``counts``).

    ``driver``: ``feed``: the simulation's TCP feed at ``address`` ("host:port"); ``t3pa``: playback of the recording ``file`` in
    real time; ``pypixet``: the camera itself, by the vendor's module, with its files in ``pixet_folder``; any other: of an
    installed package. ``bias_v``: bias voltage (V).

    Of an ordinary detector: ``energy_kev``: coefficients a, b, c, ... of the energy in keV at the lower edge of its channel n,
    a + b n + c n^2 + ...; none: its channels are the channels of its table of response. ``dead_time_us``: dead time after each
    count, not extended by further counts; none: the device states its live time.
    """

    kind: DetectorKind = "minipix"
    driver: Identifier = "none"  # none, feed, t3pa, pypixet, or of an installed package
    address: str | None = None
    file: str | None = None
    pixet_folder: str | None = None
    bias_v: Annotated[float, Meta(ge=-1000.0, le=1000.0)] | None = None  # none: that of the camera's own configuration
    energy_kev: Annotated[tuple[Coordinate, ...], Meta(min_length=2, max_length=6)] | None = None
    dead_time_us: Annotated[float, Meta(ge=0.0, le=10_000.0)] | None = None


class RecorderConfig(Section, frozen=True, kw_only=True):
    """Settings of the flight recorder, which writes MCAP files into ``folder`` (none: no records).

    The oldest files are removed once all files together exceed ``limit_mb``.
    """

    folder: str | None = None
    limit_mb: Annotated[int, Meta(ge=16, le=1_000_000)] = 4096


class DroneConfig(Section, frozen=True, kw_only=True):
    """The drone file: everything that belongs to one vehicle.

    ``camera_rpy_deg``: rotation from the camera's to the body's axes as roll, pitch and yaw about the fixed body axes, degrees;
    the camera's z is the outward normal of its sensor, x runs along a pixel row, y up the rows. The default looks forward with y
    up. ``mission``: path of the mission file; relative paths in a drone file start from that file's folder. ``state``: folder for
    the state that must survive a restart in flight (none: a restarted agent does not resume). ``updates``: folder of this
    computer's updater, ``radron-update`` (none: the computer has no updater).
    """

    id: DroneId
    mission: str | None = None
    state: str | None = None
    updates: str | None = None
    camera_rpy_deg: tuple[Degrees, Degrees, Degrees] = (90.0, 0.0, 90.0)
    calibration: str | None = None  # folder of a.txt, b.txt, c.txt, t.txt (drift.txt), or Pixet's XML; none: the nominal camera
    mesh: PeerMeshConfig = PeerMeshConfig()
    vehicle: VehicleConfig = VehicleConfig()
    detector: DetectorConfig = DetectorConfig()
    sightings: SightingsConfig = SightingsConfig()
    recorder: RecorderConfig = RecorderConfig()
