"""Types of the messages' fields: names and numbers with their units and limits.

Every number has bounds (which NaN and infinity violate, too) and every text a pattern: impossible values are refused on reading.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

STATION = "station"  # replaces a drone's id in the keys of operators; not allowed as a drone's id
IDENTIFIER = r"^[a-z0-9][a-z0-9-]{0,31}\Z"
DRONE_ID = rf"^(?!{STATION}\Z)[a-z0-9][a-z0-9-]{{0,31}}\Z"
HEX_16 = r"^[0-9a-f]{16}\Z"

Identifier = Annotated[str, Meta(pattern=IDENTIFIER)]
DroneId = Annotated[str, Meta(pattern=DRONE_ID)]
MissionId = Annotated[str, Meta(pattern=HEX_16)]
BootId = Annotated[str, Meta(pattern=HEX_16)]
Nuclide = Annotated[str, Meta(pattern=r"^[A-Z][a-z]?-[0-9]{1,3}m?\Z")]  # such as Cs-137
Digest = Annotated[str, Meta(pattern=r"^[0-9a-f]{32}\Z")]
StampNs = Annotated[int, Meta(ge=0, le=2**63 - 1)]  # until the year 2262
PlanStepNs = Annotated[int, Meta(ge=10_000_000, le=10_000_000_000)]
DurationNs = Annotated[int, Meta(ge=0, le=60_000_000_000)]
Epoch = Annotated[int, Meta(ge=0, le=1_000_000)]
Count = Annotated[int, Meta(ge=0, le=2**40)]
CommandNumber = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Nonce = Annotated[str, Meta(pattern=HEX_16)]
Text = Annotated[str, Meta(max_length=256)]
PartHash = Annotated[bytes, Meta(min_length=32, max_length=32)]  # BLAKE2b-256
Certificate = Annotated[bytes, Meta(max_length=1024)]  # X.509, DER; Ed25519

Latitude = Annotated[float, Meta(ge=-90.0, le=90.0)]
Longitude = Annotated[float, Meta(ge=-180.0, le=180.0)]
Metres = Annotated[float, Meta(ge=-1e5, le=1e5)]
PositiveMetres = Annotated[float, Meta(ge=0.0, le=1e5)]
SwathMetres = Annotated[float, Meta(ge=0.1, le=1e4)]
SeparationMm = Annotated[float, Meta(ge=1e-3, le=100.0)]
MetresPerSecond = Annotated[float, Meta(ge=-200.0, le=200.0)]
Unit = Annotated[float, Meta(ge=-1.000001, le=1.000001)]
Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
Radians = Annotated[float, Meta(ge=-6.3, le=6.3)]
SigmaRadians = Annotated[float, Meta(ge=0.0, le=6.3)]  # 0: exact
SensorSigmaRadians = Annotated[float, Meta(ge=1e-4, le=6.3)]  # no sensor is exact; estimators divide by it
SensorSigmaMetres = Annotated[float, Meta(ge=1e-3, le=1e5)]
KiloElectronvolt = Annotated[float, Meta(ge=1e-3, le=10_000.0)]
Seconds = Annotated[float, Meta(ge=0.0, le=3600.0)]
Variance = Annotated[float, Meta(ge=-1e12, le=1e12)]

Position = tuple[Metres, Metres, Metres]
Velocity = tuple[MetresPerSecond, MetresPerSecond, MetresPerSecond]
Direction = tuple[Unit, Unit, Unit]
Quaternion = tuple[Unit, Unit, Unit, Unit]
Covariance3 = tuple[Variance, Variance, Variance, Variance, Variance, Variance]  # xx, xy, xz, yy, yz, zz
