"""The pilot of a run of the agent, recorded where records are wanted."""

from __future__ import annotations

import secrets
import time

from msgspec import Struct

from agent.config.drone import DroneConfig
from agent.errors import FlightRecordError
from agent.flight.header import FlightHeader
from agent.flight.recorded import RecordedPilot
from agent.flight.recorder import FlightRecorder
from agent.pilot import Pilot
from agent.shell.missionstore import InForce
from agent.shell.statestore import State
from protocol.identity import Identity
from protocol.trust import trust_of

NONCE_KEY_BYTES = 16


class Aboard(Struct, frozen=True):
    """The pilot, its recorder, and why there is no recorder although records are wanted."""

    pilot: Pilot | RecordedPilot
    recorder: FlightRecorder | None = None
    unrecorded: str | None = None


def aboard(drone: DroneConfig, force: InForce, boot: str, saved: State, identity: Identity | None) -> Aboard:
    """The pilot for the mission in force. Records that cannot be written prevent a start, but not the rejoining of a flight."""
    trust = trust_of(identity)
    nonce_key = secrets.token_bytes(NONCE_KEY_BYTES)
    pilot = Pilot(force.mission, drone, boot, memory=saved.memory, trust=trust, nonce_key=nonce_key)
    records = drone.recorder
    if records.folder is None:
        return Aboard(pilot)
    now_ns = time.time_ns()
    header = FlightHeader.of(force.mission, drone, boot, now_ns, saved.memory, trust, force.origin, nonce_key=nonce_key)
    try:
        recorder = FlightRecorder(records.folder, records.limit_mb, header)
    except FlightRecordError as error:
        return Aboard(pilot, unrecorded=str(error))
    return Aboard(RecordedPilot(pilot, recorder), recorder)
