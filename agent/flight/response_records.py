"""The part of a recorded flight that shows the vehicle's response: telemetry, setpoints, and the plans behind them."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TypeVar

import msgspec
import numpy as np

from radron.agent.errors import FlightRecordError
from radron.agent.flight import topics
from radron.agent.flight.reader import FlightRecord, RecordedFlight
from radron.agent.geometry import Array
from radron.agent.navigation.drag import horizontal_thrust
from radron.agent.vehicle.interface import FlightMode, Request, Setpoint, VehicleCommand, VehicleState
from radron.protocol.codec import decode_from
from radron.protocol.errors import ProtocolError
from radron.protocol.messages import Plan

_GAP_NS = 1_000_000_000  # a longer gap between setpoints begins another piece
SHORTEST_S = 5.0  # shorter pieces are ignored
_EVERY = 500  # records per progress report
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Piece:
    """A part of the flight by setpoints without a gap, in one local frame: S setpoints and T measured states. Horizontal.

    Times (s) since its beginning. told_s: (S,); told: (S, 3, 2), position, velocity and acceleration setpoints; told_yaw_rps:
    (S,), yaw rate. seen_s: (T,); seen: (T, 3, 2), measured position and velocity, and thrust acceleration. planned: (T, 2, 2),
    position and velocity of the plan at those times, NaN if there was none.
    """

    began_ns: int
    told_s: Array
    told: Array
    told_yaw_rps: Array
    seen_s: Array
    seen: Array
    planned: Array


@dataclass(slots=True)
class ResponseRecords:
    """The records of one flight that show the vehicle's response: telemetry, setpoints, and plans, in order."""

    telemetry: list[VehicleState] = field(default_factory=list)
    setpoints: list[tuple[int, Setpoint]] = field(default_factory=list)
    plans: list[Plan] = field(default_factory=list)

    def take(self, record: FlightRecord, drone: str) -> None:
        """Add a record of the flight, if it is telemetry, a setpoint or a plan; records of other kinds are ignored."""
        if record.topic == topics.VEHICLE:
            self.telemetry.append(topics.decode_state(record.data))
        elif record.topic == topics.COMMAND:
            command = msgspec.json.decode(record.data, type=VehicleCommand)
            if command.request is Request.OFFBOARD and command.setpoint is not None:
                self.setpoints.append((record.log_ns, command.setpoint))
        elif record.topic == topics.PUBLICATION:
            key, payload = topics.decode_message(record.data)
            if key.endswith(f"/{drone}/plan"):
                message = decode_from(key, payload)
                if isinstance(message, Plan):
                    self.plans.append(message)

    def pieces(self) -> list[Piece]:
        """Return the parts of the flight by setpoints without a gap that are long enough to be evaluated."""
        groups: list[list[VehicleState]] = []
        stamps = [stamp_ns for stamp_ns, _ in self.setpoints]
        for state in self.telemetry:
            last = bisect_right(stamps, state.stamp_ns) - 1
            if last < 0 or state.stamp_ns - stamps[last] > _GAP_NS or state.mode is not FlightMode.OFFBOARD or not state.in_air:
                groups.append([])
                continue
            group = groups[-1] if groups else []
            if not group or group[-1].epoch != state.epoch or state.stamp_ns - group[-1].stamp_ns > _GAP_NS:
                group = []
                groups.append(group)
            group.append(state)
        return [
            self._piece(group, stamps) for group in groups if group and group[-1].stamp_ns - group[0].stamp_ns > SHORTEST_S * 1e9
        ]

    def _piece(self, states: list[VehicleState], stamps: list[int]) -> Piece:
        began_ns = states[0].stamp_ns
        first, last = max(bisect_right(stamps, began_ns) - 1, 0), bisect_right(stamps, states[-1].stamp_ns)
        told = [
            (setpoint.position_m[:2], setpoint.velocity_mps[:2], setpoint.acceleration_mps2[:2])
            for _, setpoint in self.setpoints[first:last]
        ]
        begins = [plan.stamp_ns for plan in self.plans]
        return Piece(
            began_ns,
            1e-9 * np.array([stamp - began_ns for stamp in stamps[first:last]], dtype=np.float64),
            np.array(told),
            np.array([setpoint.yaw_rate_rps for _, setpoint in self.setpoints[first:last]]),
            1e-9 * np.array([state.stamp_ns - began_ns for state in states], dtype=np.float64),
            np.array([(state.position_m[:2], state.velocity_mps[:2], _thrust(state)) for state in states]),
            np.array([self._planned(state, begins) for state in states]),
        )

    def _planned(self, state: VehicleState, begins: list[int]) -> list[tuple[float, float]]:
        index = bisect_right(begins, state.stamp_ns) - 1
        nothing = [(np.nan, np.nan)] * 2
        if index < 0:
            return nothing
        plan = self.plans[index]
        place = (state.stamp_ns - plan.stamp_ns) / plan.step_ns
        step = int(place)
        if plan.epoch != state.epoch or step >= len(plan.positions_m) - 1:
            return nothing
        (x, y, _), (u, v, _) = plan.positions_m[step : step + 2]
        share, rate = place - step, 1e9 / plan.step_ns
        return [(x + share * (u - x), y + share * (v - y)), (rate * (u - x), rate * (v - y))]


def read(flight: RecordedFlight, progress: Callable[[float], None]) -> ResponseRecords:
    """Read the records of a flight that show the vehicle's response. ``progress``: called with the share read, 0 to 1.

    Raises:
        FlightRecordError: a record cannot be read, or nothing was flown by setpoints.
    """
    records = ResponseRecords()
    for record in counted(flight.records(), lambda: progress(flight.read_bytes / max(1, flight.size_bytes))):
        try:
            records.take(record, flight.header.drone.id)
        except (msgspec.MsgspecError, ProtocolError, ValueError, TypeError) as error:
            raise FlightRecordError(f"{flight.files[0]}: a record of {record.topic} cannot be read: {error}") from None
    return records


def counted(items: Iterable[T], tell: Callable[[], None]) -> Iterable[T]:
    """Yield the items unchanged, and call ``tell`` after every few hundred items, to report progress."""
    for count, item in enumerate(items):
        if count % _EVERY == 0:
            tell()
        yield item


def _thrust(state: VehicleState) -> tuple[float, float]:
    return horizontal_thrust(state.quaternion) or (0.0, 0.0)
