"""Confirmation of a landing: a report is confirmed by further reports, and by position and height.

One faulty or forged packet must not end a flight: once the agent takes its vehicle for landed, it sends no more setpoints.
"""

from __future__ import annotations

from math import hypot

from msgspec.structs import replace

from radron.agent.lasting import since
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

CONFIRM_NS = 2_200_000_000  # two more heartbeats, at 1 Hz, must say the same
STILL_NS = 5_000_000_000  # if it seems to stand high: on a roof, or without a rangefinder for the height above ground
LOW_M = 2.0
MOVING_MPS = 1.0  # more than the estimate of a vehicle at rest wanders
_TOLD_NS = 10_000_000_000


class Grounded:
    """Filter of one vehicle's telemetry that confirms landing and disarming: one false report must not end a flight.

    ``armed`` and ``in_air`` become false only once further reports, position and height agree. Until then the vehicle counts as
    healthy as before: readiness to arm says nothing about a vehicle that still counts as flying. A vehicle that moves has not
    landed, whatever it reports, as long as its position can be trusted.
    """

    def __init__(self) -> None:
        self._armed = self._in_air = False
        self._healthy = True  # as of the newest telemetry that says it is armed or in the air
        self._since_ns: int | None = None  # since when it has reported to be disarmed or landed
        self._refused_ns: int | None = None

    def take(self, state: VehicleState) -> VehicleState:
        """Return the telemetry with ``armed`` and ``in_air`` as confirmed."""
        self._healthy = state.healthy if state.armed or state.in_air else self._healthy
        falls = (self._armed and not state.armed) or (self._in_air and not state.in_air)
        self._since_ns = since(self._since_ns, state.stamp_ns, holds=falls)
        if falls and self._since_ns is not None and not self._confirmed(state, self._since_ns):
            up = state.armed or state.in_air
            healthy = state.healthy if up else self._healthy
            return replace(state, armed=state.armed or self._armed, in_air=state.in_air or self._in_air, healthy=healthy)
        self._armed, self._in_air, self._since_ns = state.armed, state.in_air, None
        return state

    def problem(self, now_ns: int) -> CodedText | None:
        """Return the message to the operator if the vehicle moves although it reports to have landed or to be disarmed; else
        None.
        """
        if self._refused_ns is None or now_ns - self._refused_ns >= _TOLD_NS:
            return None
        text = "its autopilot reports that it has landed or is disarmed, but it flies by its position: not believed"
        return CodedText(Code.LANDING_NOT_BELIEVED, text)

    def _confirmed(self, state: VehicleState, since_ns: int) -> bool:
        trusted = state.position_trusted
        moves = trusted and hypot(*state.velocity_mps) > MOVING_MPS
        high = trusted and state.height_m > LOW_M
        if moves or (high and not state.armed):
            self._refused_ns = state.stamp_ns
        if moves:
            self._since_ns = state.stamp_ns  # from the beginning once it is still
            return False
        return state.stamp_ns - since_ns >= (STILL_NS if high else CONFIRM_NS)
