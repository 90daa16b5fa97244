"""Descriptions of faults for the report on a live flight."""

from __future__ import annotations

from radron.sim.faults.agents import Lag, Partition, RadioRange, Throttle
from radron.sim.faults.base import Fault
from radron.sim.faults.kinds import kind_of
from radron.sim.faults.machines import (
    Battery,
    Disarm,
    Gust,
    HeadingReset,
    MavlinkImpaired,
    MotorFailure,
    PositionJump,
    StreamLost,
)
from radron.sim.vehicle.px4.faults import VehicleFault


def vehicle_told(fault: VehicleFault) -> str:
    """Describe a fault of a vehicle in words, for the report on a live flight."""
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
        case HeadingReset():
            return f"the filter resets its heading by {fault.turn_deg:g} degrees"
        case Disarm():
            return "somebody disarms it before it takes off"
    return "the autopilot refuses changes of mode, and arming"


def links_told(fault: Fault) -> str:
    """Describe a fault of the links in words, for the report on a live flight."""
    match fault:
        case Partition():
            return f"partition: {' | '.join(' '.join(group) for group in fault.groups)}"
        case RadioRange():
            return f"drones further apart than {fault.range_m:g} m do not hear each other"
        case Lag():
            return f"delay of {fault.delay_s:g} s, and up to {fault.jitter_s:g} s more"
        case Throttle():
            return f"links carry {fault.rate_kilobytes_ps:g} kB/s at most"
    return f"{kind_of(fault)} of links"


def mavlink_told(fault: MavlinkImpaired) -> str:
    """Describe an impaired MAVLink link in words, for the report on a live flight."""
    told = ["nothing gets through"] if fault.cut else []
    if fault.delay_s + fault.jitter_s > 0.0:
        told.append(f"packets take {fault.delay_s:g} s, and up to {fault.jitter_s:g} s more")
    shares = ((fault.reorder, "are overtaken"), (fault.duplicate, "arrive twice"), (fault.corrupt, "are corrupt"))
    told += [f"{100.0 * share:g} % {what}" for share, what in shares if share > 0.0]
    where = {"both": "", "to-agent": " to the agent", "to-vehicle": " to the vehicle"}[fault.direction]
    return f"MAVLink{where}: {', '.join(told)}"
