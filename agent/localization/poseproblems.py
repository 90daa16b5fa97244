"""Problems of a drone's clock, localisation and frame, as reported to the operator."""

from __future__ import annotations

from radron.agent.frames.swarm import SwarmFrames
from radron.agent.localization.clocks import Clocks
from radron.agent.localization.ownpose import LocalFrame, OwnPose
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

UNSURE_M = 5.0  # 1 sigma of the own position in the mission frame above which the drone reports it
NO_PLACE = CodedText(
    Code.POSITION_UNKNOWN,
    "where it is in the mission frame is not known: its localisation has jumped while its agent was down",
)


def pose_problems(
    drone: str, own: OwnPose, clocks: Clocks, frames: SwarmFrames, now_ns: int, flying: bool
) -> tuple[CodedText, ...]:
    """Return the problems for the operator: those of clock and localisation, and, in flight (``flying``), of the frames of all
    drones, this one first.
    """
    told = [problem for problem in (clocks.problem(now_ns), *own.problems(now_ns)) if problem is not None]
    if not flying:
        return tuple(told)
    suspects = frames.suspects()
    vehicle, frame = own.vehicle, own.frame
    if vehicle is not None and drone not in suspects:
        told += [NO_PLACE] if frame is None else _unsure(frame, vehicle)
    contradicted = frames.contradicted()
    for name in sorted(suspects, key=lambda name: (name != drone, name)):
        code = Code.FRAME_CONTRADICTED if name in contradicted else Code.FRAME_UNKNOWN
        told.append(CodedText(code, f"{name}: {suspects[name]}", name))
    return tuple(told)


def _unsure(frame: LocalFrame, vehicle: VehicleState) -> list[CodedText]:
    sigma_m = frame.mission_from_local.sigmas_at(vehicle.position_m)[0]
    if sigma_m <= UNSURE_M:
        return []
    return [CodedText(Code.POSITION_UNCERTAIN, f"its position in the mission frame is uncertain: 1 sigma = {sigma_m:.0f} m")]
