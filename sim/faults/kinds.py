"""All kinds of faults, and reading of the ``[[fault]]`` entries of a scenario file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from radron.agent.config.loading import convert
from radron.agent.errors import ConfigError
from radron.sim.faults.agents import (
    CopiedKey,
    Corrupt,
    Cut,
    DenseEntries,
    Disk,
    Duplicate,
    Equivocating,
    Flood,
    Forged,
    Freeze,
    Kill,
    Lag,
    Late,
    Lie,
    Loss,
    OldCommand,
    OldEntries,
    Partition,
    Poisoned,
    RadioRange,
    Reorder,
    Revoked,
    SlowCpu,
    Stall,
    Throttle,
)
from radron.sim.faults.base import Fault
from radron.sim.faults.machines import (
    Battery,
    CameraDead,
    CameraGain,
    CameraNoisy,
    CameraStuck,
    Clock,
    Disarm,
    Drag,
    Gust,
    HeadingReset,
    MavlinkImpaired,
    MavlinkLoss,
    MotorFailure,
    PositionJump,
    Refusal,
    SatellitesLost,
    StreamLost,
    Takeover,
)

AnyFault = (
    Kill | Freeze | Late | SlowCpu | Revoked | Disk
    | Partition | Cut | Loss | Lag | Stall | Throttle | Reorder | Duplicate | Corrupt | RadioRange
    | Flood | OldEntries | DenseEntries | Lie | Equivocating | Forged | CopiedKey | OldCommand | Poisoned
    | CameraDead | CameraNoisy | CameraStuck | CameraGain | Clock
    | SatellitesLost | PositionJump | HeadingReset | Drag | Gust | MotorFailure | Battery
    | MavlinkLoss | MavlinkImpaired | StreamLost | Takeover | Disarm | Refusal
)  # fmt: skip

LIVE_ONLY = (StreamLost, Disarm, MavlinkImpaired, Stall, Throttle)  # kinds that need the real MAVLink, or TCP
DEALT_ONLY = (
    *LIVE_ONLY,
    Forged,
    CopiedKey,
    OldCommand,
    HeadingReset,
    OldEntries,
    DenseEntries,
    Poisoned,
)  # left out of random missions, so that their seeds draw the same faults as before

KINDS: dict[str, type[Fault]] = {str(kind.__struct_config__.tag): kind for kind in get_args(AnyFault)}


def read_faults(document: object, where: str) -> tuple[Fault, ...]:
    """Read the faults of a scenario file from its parsed ``[[fault]]`` tables.

    Raises:
        ConfigError: no list of tables, an unknown kind or key, a value out of range; names the entry and what is allowed.
    """
    if not isinstance(document, list | tuple) or not all(isinstance(entry, dict) for entry in document):
        raise ConfigError(f"{where}: fault: expected [[fault]] tables")
    return tuple(_read(entry, f"{where}: fault[{number}]") for number, entry in enumerate(document))


def _read(entry: dict[str, object], where: str) -> Fault:
    kind = entry.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        told = "the key 'kind' is missing" if kind is None else f"unknown kind {kind!r}"
        raise ConfigError(f"{where}: {told}; known: {', '.join(KINDS)}")
    return convert(entry, KINDS[kind], f"{where} ({kind})")


def kind_of(fault: Fault) -> str:
    """Return the name of a fault's kind, as in the scenario file."""
    return str(fault.__struct_config__.tag)


def check_faults(faults: Sequence[Fault], drones: Sequence[str], where: str) -> None:
    """Raise ConfigError if a fault names a drone outside the mission, or contradicts itself."""
    for number, fault in enumerate(faults):
        entry = f"{where}: fault[{number}] ({kind_of(fault)})"
        if fault.target == ():
            raise ConfigError(f"{entry}: target: name at least one drone, or leave it out for all")
        unknown = [name for name in fault.names() if name not in drones]
        if unknown:
            raise ConfigError(f"{entry}: no drone {unknown[0]!r} in the mission; there are {', '.join(drones)}")
        wrong = fault.check()
        if wrong is not None:
            raise ConfigError(f"{entry}: {wrong}")
