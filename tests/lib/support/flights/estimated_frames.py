"""Frames estimated from the flights of ``sighted_swarm``: its swarms, the estimate from all entries at once, and its result."""

from msgspec import structs

from radron.agent.frames.swarm import SwarmFrames
from radron.protocol.codec import encode
from radron.protocol.entries import Entry, Exposure
from support.flights.sighted_swarm import SECOND, START_NS, Drone, settle

DRIFT = {"drift_m": 0.1, "yaw_drift_deg": 0.2}  # 1 % of 100 m, 0.1 degrees by the root of seconds and of metres at 3 m/s each
UNKNOWN = {"reported_yaw_deg": 0.0, "yaw_sigma_deg": 180.0}


def at_once(flown):
    """The frames from all entries of a flight, given before the first estimate."""
    frames = SwarmFrames(flown.mission)
    for entry in flown.entries:
        frames.receive(entry, encode(entry))
    settle(frames, int(flown.stamps_ns[-1]) + SECOND)
    return frames


def anchored(**values):
    """d1 is known exactly; the others begin with any heading."""
    return [Drone("d1", kind="exact"), Drone("d2", yaw_deg=70.0, **values), Drone("d3", yaw_deg=-130.0, **values)]


def satellites(**of_the_third):
    """Three by GNSS."""
    plain = {"kind": "gnss", "wander_m": 1.0, "fixes": True, "yaw_sigma_deg": 2.0}
    return [Drone("d1", **plain), Drone("d2", **plain), Drone("d3", **plain, **of_the_third)]


def slams():
    """d1's first frame is the mission's, all drift."""
    return [
        Drone("d1", origin_sigma_m=0.0, yaw_sigma_deg=0.0, **DRIFT),
        Drone("d2", yaw_deg=70.0, **UNKNOWN, **DRIFT),
        Drone("d3", yaw_deg=-130.0, **UNKNOWN, **DRIFT),
    ]


def lines(frames, flown):
    """The graph's result, bit for bit."""
    found = []
    for drone in flown.place:
        for epoch in (0, 1):
            for stamp_ns in [*range(START_NS, int(flown.stamps_ns[-1]) + 2 * SECOND, SECOND // 2), None]:
                one = frames.graph.mission_from_local(drone, epoch, stamp_ns)
                found.append(
                    None
                    if one is None
                    else (one.yaw_rad, one.translation, None if one.covariance is None else one.covariance.tobytes())
                )
    return found


def told_later(entry: Entry, by_s: float, sigma_m: float) -> Entry:
    """An entry of a drone with its clock ahead; its exposures show the resulting error of its motion."""
    by_ns = round(by_s * SECOND)
    later = structs.replace(entry, stamp_ns=entry.stamp_ns + by_ns)
    return structs.replace(later, end_ns=later.end_ns + by_ns, clock_sigma_m=sigma_m) if isinstance(later, Exposure) else later
