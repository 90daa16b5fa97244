"""The topics of a flight's records, and what stands in each.

``in/`` and ``call/`` are what the pilot was given, in the order of the calls; after each follow under ``out/`` its results.
``log_time`` is the pilot's time where a call has one, else wall time; ``publish_time`` is the wall time of the record: of a call
when it came, of a result when it was there. ``sequence`` counts the records of a flight, so that a lost one is noticed.
"""

from __future__ import annotations

import json
from math import isfinite
from typing import Protocol

import msgpack
import msgspec

from agent.detector.readout import Readout
from agent.detector.wire import Unpacker, pack
from agent.errors import DetectorError, FlightRecordError
from agent.fusion.estimator import Hypothesis
from agent.vehicle.interface import GnssFix, SeenDrone, VehicleCommand, VehicleState

VEHICLE = "in/vehicle"  # JSON: telemetry
DETECTOR = "in/detector"  # readout as in agent/detector/wire.py
FIX = "in/fix"  # JSON: of a satellite receiver
SIGHTINGS = "in/sightings"  # JSON: list of what was seen of other drones at once
MESSAGE = "in/message"  # msgpack: [key, payload]
QUERY = "in/query"  # a peer's request for what its log lacks: protocol/summary.py
WARN = "in/warn"  # JSON: list of texts
BLOCK = "in/block"
ADVANCE = "call/advance"  # JSON: {}
STEP = "call/step"
HYPOTHESIS = "out/hypothesis"  # JSON, whenever it was made anew; null where it was taken back
COMMAND = "out/command"  # JSON: what the autopilot is to do
PUBLICATION = "out/publication"  # msgpack: [key, payload]
ANSWER = "out/answer"  # JSON: {entries, bytes} given to a query
ERROR = "out/error"  # JSON: the exception that a call ended in

ENCODINGS = {DETECTOR: "radron-readout", QUERY: "msgpack", MESSAGE: "msgpack", PUBLICATION: "msgpack"}  # all others: json


class Sink(Protocol):
    """Where records go."""

    def write(self, topic: str, data: bytes, log_ns: int | None = None) -> None:
        """Keep a record. ``log_ns``: its time; None: now. Never raises, never waits."""


def encode_state(state: VehicleState) -> bytes:
    """Telemetry as JSON. Numbers that JSON does not know (NaN) are written as Python and JavaScript do."""
    numbers = (*state.position_m, *state.velocity_mps, *state.quaternion, state.height_m)
    if isfinite(sum(numbers) + state.position_sigma_m + state.yaw_sigma_rad):
        return msgspec.json.encode(state)
    return json.dumps(msgspec.to_builtins(state)).encode()


def decode_state(data: bytes) -> VehicleState:
    """Telemetry from JSON; every float comes back with the same bits."""
    return msgspec.convert(json.loads(data), VehicleState)


def encode_given(given: GnssFix | list[SeenDrone]) -> bytes:
    """A fix or sights as JSON, with numbers that JSON does not know as in telemetry."""
    return json.dumps(msgspec.to_builtins(given)).encode()


def decode_fix(data: bytes) -> GnssFix:
    """A fix from JSON."""
    return msgspec.convert(json.loads(data), GnssFix)


def decode_sightings(data: bytes) -> list[SeenDrone]:
    """Sights from JSON."""
    return msgspec.convert(json.loads(data), list[SeenDrone])


def encode_readout(readout: Readout) -> bytes:
    """A readout; nothing for one that is too large to be kept: such a flight cannot be replayed beyond it."""
    try:
        return pack(readout)
    except DetectorError:
        return b""


def decode_readout(data: bytes) -> Readout:
    """A readout.

    Raises:
        FlightRecordError: not exactly one.
    """
    readouts = list(Unpacker().feed(data))
    if len(readouts) != 1:
        raise FlightRecordError(f"a record of {DETECTOR} holds {len(readouts)} readouts instead of one")
    return readouts[0]


def encode_message(key: str, payload: bytes) -> bytes:
    """A message with its key."""
    packed: bytes = msgpack.packb((key, payload))
    return packed


def decode_message(data: bytes) -> tuple[str, bytes]:
    """Key and payload."""
    key, payload = msgpack.unpackb(data)
    return key, payload


def encode_command(command: VehicleCommand) -> bytes:
    """A command as JSON: the same bytes for the same bits."""
    return msgspec.json.encode(command)


def encode_hypothesis(hypothesis: Hypothesis | None, digest: str) -> bytes:
    """A hypothesis (mission frame) as JSON, with the digest of the log that it follows from."""
    if hypothesis is None:
        return b"null"
    return msgspec.json.encode(
        {
            "stamp_ns": hypothesis.stamp_ns,
            "position_m": hypothesis.position.tolist(),
            "covariance_m2": hypothesis.covariance.tolist(),
            "velocity_mps": hypothesis.velocity.tolist(),
            "cones": hypothesis.cones,
            "x0_stamp_ns": hypothesis.x0_stamp_ns,
            "activity_bq": hypothesis.activity_bq,
            "activity_sigma_bq": hypothesis.activity_sigma_bq,
            "digest": digest,
        }
    )
