"""Faults as the report of a live flight tells them."""

from __future__ import annotations

from sim.faults.agents import Lag, Partition, RadioRange
from sim.faults.base import Fault
from sim.faults.kinds import kind_of
from sim.faults.machines import Battery, Disarm, Gust, MotorFailure, PositionJump, StreamLost
from sim.vehicle.px4.faults import VehicleFault


def vehicle_told(fault: VehicleFault) -> str:
    """A fault that the world plays, as a sentence of the report."""
    match fault:
        case Gust():
            return f"a gust, {fault.acceleration_mps2:g} m/s^2"
        case MotorFailure():
            return f"a motor fails: it comes down at {fault.descent_mps:g} m/s"
        case Battery():
            return f"the battery {'reports' if fault.lies else 'is at'} {100.0 * fault.level:g} %"
        case StreamLost():
            return f"no {fault.message} from the autopilot any more"
        case PositionJump():
            return f"the filter is reset: the position jumps by {fault.jump_m:g} m"
        case Disarm():
            return "somebody disarms it before it takes off"
    return "the autopilot refuses changes of mode, and arming"


def links_told(fault: Fault) -> str:
    """A fault of the links, as a sentence of the report."""
    match fault:
        case Partition():
            return f"partition: {' | '.join(' '.join(group) for group in fault.groups)}"
        case RadioRange():
            return f"drones further apart than {fault.range_m:g} m do not hear each other"
        case Lag():
            return f"delay of {fault.delay_s:g} s, and up to {fault.jitter_s:g} s more"
    return f"{kind_of(fault)} of links"
