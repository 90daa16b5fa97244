"""Content of the fleet file: the drones, their network, mission, sensors, and login keys."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, field

from radron.agent.config.drone import DetectorConfig, ParameterName, SightingsConfig, VehicleConfig
from radron.agent.config.section import Degrees, Section
from radron.protocol.units import DroneId, Identifier

Port = Annotated[int, Meta(ge=1024, le=65535)]


class NetworkConfig(Section, frozen=True, kw_only=True):
    """The network in which the drones talk to each other: IPv4 with fixed addresses.

    ``subnet``: such as 10.7.1.0/24. ``interface``: name of the drone's network interface, with wildcards; it must fit one
    interface only. ``port``: port at which each drone listens to the other drones. ``ntp``: time servers besides the drones
    themselves, such as the operator's station.
    """

    subnet: str
    interface: str = "en*"
    gateway: str | None = None
    port: Port = 7447
    ntp: tuple[str, ...] = ()


class Px4Config(Section, frozen=True, kw_only=True):
    """Expected version and parameters of the autopilots (PX4), for the check in ``radron-deploy status``.

    ``version``: such as "1.15.4" (none: any). ``parameters``: such as ``{COM_OF_LOSS_T = 0.5}``; a drone reports the parameters
    that this table had when the drone's files were made.
    """

    version: str | None = None
    parameters: dict[ParameterName, float] = field(default_factory=dict)


class FleetDrone(Section, frozen=True, kw_only=True):
    """One drone of the fleet file.

    Keys in its own tables, such as ``[drones.vehicle]``, replace single keys of the top-level tables.

    ``address``: IPv4 address of the drone in the swarm's network. ``calibration``: folder with its camera's a.txt, b.txt, c.txt
    and t.txt, or Pixet's XML file. ``camera_rpy_deg``: roll, pitch and yaw of the camera in the body frame.
    """

    id: DroneId
    address: str
    calibration: str | None = None
    camera_rpy_deg: tuple[Degrees, Degrees, Degrees] = (90.0, 0.0, 90.0)
    vehicle: VehicleConfig = VehicleConfig()
    detector: DetectorConfig = DetectorConfig()
    sightings: SightingsConfig = SightingsConfig()
    px4: Px4Config = Px4Config()


class FleetConfig(Section, frozen=True, kw_only=True):
    """Content of a fleet file, which describes all drones of a swarm. Relative paths start from the folder of the file.

    ``version``: version of radron; an image of another version is refused (none: any). ``mission``: the mission file.
    ``ssh_keys``: public keys with root login on the drones. ``certificate_days``: validity of a drone's certificate. ``others``:
    names of further members that may join the network (none: every holder of a certificate of the swarm). ``records_mb``: limit
    of a drone's flight records. ``px4``: expected version and parameters of the autopilots, on all drones. ``camera_rpy_deg``,
    ``vehicle``, ``detector`` and ``sightings``: as in the drone file, for all drones.
    """

    mission: str
    network: NetworkConfig
    ssh_keys: Annotated[tuple[str, ...], Meta(min_length=1)]
    version: str | None = None
    certificate_days: Annotated[int, Meta(ge=1, le=3650)] = 30
    others: tuple[Identifier, ...] | None = None
    records_mb: Annotated[int, Meta(ge=16, le=1_000_000)] = 4096
    px4: Px4Config = Px4Config()
    camera_rpy_deg: tuple[Degrees, Degrees, Degrees] = (90.0, 0.0, 90.0)
    vehicle: VehicleConfig = VehicleConfig()
    detector: DetectorConfig = DetectorConfig()
    sightings: SightingsConfig = SightingsConfig()
    drones: Annotated[tuple[FleetDrone, ...], Meta(min_length=1, max_length=64)]
