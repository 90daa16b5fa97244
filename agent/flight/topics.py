"""The topics of a flight's records, and their contents.

``in/`` and ``call/`` are the pilot's inputs, in the order of the calls; the results of each call follow under ``out/``.
``log_time`` is the pilot's own time where a call has one, else wall time; ``publish_time`` is the wall time of the record: of a
call when it was made, of a result when it was there. ``sequence`` counts the records of a flight, so that a lost one is noticed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from math import isfinite
from typing import Protocol

import msgpack
import msgspec

from radron.agent.detector.readout import Readout
from radron.agent.detector.wire import Unpacker, pack
from radron.agent.errors import DetectorError, FlightRecordError
from radron.agent.fusion.estimator import Hypothesis
from radron.agent.vehicle.interface import GnssFix, SeenDrone, VehicleCommand, VehicleState
from radron.protocol.texts import CodedText

VEHICLE = "in/vehicle"  # JSON: telemetry
DETECTOR = "in/detector"  # readout as in agent/detector/wire.py
FIX = "in/fix"  # JSON: of a satellite receiver
SIGHTINGS = "in/sightings"  # JSON: list of relative observations made at one time
MESSAGE = "in/message"  # msgpack: [key, payload]
QUERY = "in/query"  # a peer's request for missing log entries: protocol/summary.py
WARN = "in/warn"  # JSON: as ``encode_texts``
BLOCK = "in/block"
NOTICE = "in/notice"
ANSWERED = "in/answered"  # JSON: number of a question of the estimator, at the time of its answer: agent/fusion/deferred.py
CLOCK = "in/clock"  # JSON: lead of UTC over the pilot's own time, ns, from then on; 0 before the first
DECLINE = "in/decline"  # JSON: why an uploaded mission is not taken over
OUT = "out/"  # prefix of the topics of results
ADVANCE = "call/advance"  # JSON: {}
STEP = "call/step"
HYPOTHESIS = "out/hypothesis"  # JSON, after every update; null once withdrawn
COMMAND = "out/command"  # JSON: the command to the autopilot
VERDICT = "out/verdict"  # JSON: what became of the command in this message; of refused ones a bounded number
PUBLICATION = "out/publication"  # msgpack: [key, payload]
ANSWER = "out/answer"  # JSON: {entries, bytes} given to a query
ERROR = "out/error"  # JSON: the exception that a call ended in

ENCODINGS = {DETECTOR: "radron-readout", QUERY: "msgpack", MESSAGE: "msgpack", PUBLICATION: "msgpack"}  # all others: json


class Sink(Protocol):
    """Interface of the destination to which records of a flight are written."""

    def write(self, topic: str, data: bytes, log_ns: int | None = None) -> None:
        """Keep a record of the flight under its topic. ``log_ns``: its time; None: now. Never raises, never waits."""


def encode_state(state: VehicleState) -> bytes:
    """Encode telemetry as JSON for the flight record. Numbers that JSON lacks (NaN) are written as Python and JavaScript do."""
    numbers = (*state.position_m, *state.velocity_mps, *state.quaternion, state.height_m)
    if isfinite(sum(numbers) + state.position_sigma_m + state.yaw_sigma_rad):
        return msgspec.json.encode(state)
    return json.dumps(msgspec.to_builtins(state)).encode()


def decode_state(data: bytes) -> VehicleState:
    """Decode telemetry from a flight record; every float comes back with the bits it had."""
    return msgspec.convert(json.loads(data), VehicleState)


def encode_given(given: GnssFix | list[SeenDrone]) -> bytes:
    """Encode a satellite position or relative observations as JSON for the flight record, with NaN as in telemetry."""
    return json.dumps(msgspec.to_builtins(given)).encode()


def decode_fix(data: bytes) -> GnssFix:
    """Decode a satellite position from a flight record."""
    return msgspec.convert(json.loads(data), GnssFix)


def decode_sightings(data: bytes) -> list[SeenDrone]:
    """Decode relative observations of other drones from a flight record."""
    return msgspec.convert(json.loads(data), list[SeenDrone])


def encode_readout(readout: Readout) -> bytes:
    """Encode a readout of the camera for the flight record; empty if too large: the flight cannot be replayed beyond it."""
    try:
        return pack(readout)
    except DetectorError:
        return b""


def decode_readout(data: bytes) -> Readout:
    """Decode a readout of the camera from a flight record.

    Raises:
        FlightRecordError: the bytes are not exactly one readout.
    """
    readouts = list(Unpacker().feed(data))
    if len(readouts) != 1:
        raise FlightRecordError(f"a record of {DETECTOR} holds {len(readouts)} readouts instead of one")
    return readouts[0]


def encode_message(key: str, payload: bytes) -> bytes:
    """Encode a message with its key (address) for the flight record."""
    packed: bytes = msgpack.packb((key, payload))
    return packed


def decode_message(data: bytes) -> tuple[str, bytes]:
    """Decode key (address) and payload of a message from a flight record."""
    key, payload = msgpack.unpackb(data)
    return key, payload


def encode_texts(texts: Iterable[CodedText]) -> bytes:
    """Encode texts for the operator as JSON for the flight record: a list of [words, code, drone that the text is about]."""
    return msgspec.json.encode([(str(text), text.code, text.about) for text in texts])


def decode_texts(data: bytes) -> tuple[CodedText, ...]:
    """Decode texts for the operator from a flight record; older records have the words alone."""
    rows = msgspec.json.decode(data, type=tuple[str | tuple[str, str, str | None], ...])
    return tuple(CodedText("", row) if isinstance(row, str) else CodedText(row[1], row[0], row[2]) for row in rows)


def encode_command(command: VehicleCommand) -> bytes:
    """Encode a command to the autopilot as JSON for the flight record: equal commands give equal bytes."""
    return msgspec.json.encode(command)


def encode_hypothesis(hypothesis: Hypothesis | None, digest: str) -> bytes:
    """Encode a source estimate as JSON for the flight record, with the hash of the log from which it was computed; None gives
    "null".
    """
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
