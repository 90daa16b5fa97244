"""Which faults a live flight can play, and what they need."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from radron.agent.errors import ConfigError
from radron.sim.faults.agents import (
    Cut,
    DenseEntries,
    Disk,
    Flood,
    Freeze,
    Kill,
    Lag,
    Late,
    OldEntries,
    Partition,
    RadioRange,
    SlowCpu,
    Stall,
    Throttle,
)
from radron.sim.faults.base import Fault
from radron.sim.faults.kinds import kind_of
from radron.sim.faults.machines import CameraDead, MavlinkImpaired, MavlinkLoss, PositionJump, SatellitesLost, Takeover
from radron.sim.scenario import Scenario
from radron.sim.vehicle.px4.faults import VehicleFault

ON_LINKS = (Partition, Cut, Lag, Stall, Throttle, RadioRange)
_RELAYED = (*ON_LINKS, MavlinkLoss, MavlinkImpaired)
PLAYABLE = (
    Kill,
    Freeze,
    Late,
    SlowCpu,
    Disk,
    *_RELAYED,
    Flood,
    OldEntries,
    DenseEntries,
    CameraDead,
    SatellitesLost,
    Takeover,
    *get_args(VehicleFault),
)
_DISKS = ("state-torn", "state-flipped", "record-torn", "record-removed")


def check_playable(scenario: Scenario, *, here: bool) -> None:
    """Raise ConfigError for faults that a live flight cannot play. ``here``: the agents are started on this machine."""
    for number, fault in enumerate(scenario.fault):
        where = f"{scenario.name}: fault[{number}] ({kind_of(fault)})"
        if not here:
            raise ConfigError(f"{where}: faults are played only with agents that are started here; leave out --external")
        if not isinstance(fault, PLAYABLE):
            kinds = ", ".join(str(kind.__struct_config__.tag) for kind in PLAYABLE)
            raise ConfigError(f"{where}: not played in a live flight, which plays {kinds}; `radron-sim run` plays all")
        if isinstance(fault, PositionJump) and not fault.announced:
            raise ConfigError(f"{where}: announced = false is not played in a live flight; announced = true is")
        if isinstance(fault, CameraDead) and fault.blind:
            raise ConfigError(f"{where}: blind = true is not played in a live flight; blind = false is")
        if isinstance(fault, Disk) and fault.how not in _DISKS:
            raise ConfigError(f"{where}: how = {fault.how!r} is not played in a live flight, which plays {', '.join(_DISKS)}")


def needs_relays(faults: Sequence[Fault]) -> bool:
    """Return whether the faults require relays in the links of the swarm, which impair messages."""
    return any(isinstance(fault, _RELAYED) for fault in faults)


def late_drones(scenario: Scenario) -> frozenset[str]:
    """Return the ids of drones whose agent is started late."""
    drones = [drone.id for drone in scenario.mission.drones]
    return frozenset(drone for fault in scenario.fault if isinstance(fault, Late) for drone in fault.strikes(drones))
