"""The heights at which the drones' autopilots return without their agents: each has a layer of its own."""

from __future__ import annotations

from itertools import pairwise

from radron.agent.config.mission import MissionConfig
from radron.agent.vehicle.interface import Finding

NAME = "return layer"
LEAST_M = 1.0  # between two layers: heights by barometer and satellites are good to about this


def layers_finding(mission: MissionConfig, drone: str) -> Finding | None:
    """Check the heights at which the drones' autopilots return without their agents: each drone needs a height of its own.

    Return None if this drone's autopilot does not return.
    """
    members = [member for member in mission.drones if member.localization != "slam"]  # without satellites there is no home
    if mission.safety.agent_lost != "return" or drone not in [member.id for member in members]:
        return None
    heights_m = {member.id: mission.return_height_m(member.id) for member in members}
    others = ", ".join(f"{name} {height:g} m" for name, height in heights_m.items() if name != drone)
    text = f"{heights_m[drone]:g} m above its launch place" + (f"; {others}" if others else "")
    ordered = sorted(heights_m.values())
    between_m = min((above - below for below, above in pairwise(ordered)), default=LEAST_M)
    if mission.safety.return_layer_m > 0.0 and between_m < LEAST_M:
        advice = "raise area.ceiling_m or lower safety.return_height_m, or set safety.return_layer_m = 0 for one height for all"
        return Finding(NAME, "failed", f"{text}: only {between_m:.2g} m between two of them; {advice}")
    return Finding(NAME, "ok", text)
